//! File formats, one module each, read and written in bounded memory.

pub mod aedat4;
mod destination;
pub mod hdf5;
pub mod npy;
pub mod parquet;
pub mod raw2event;

pub use destination::Destination;
