//! File formats, one module each, read and written in bounded memory.

pub mod aedat4;
mod destination;
pub mod hdf5;
pub mod npy;
pub mod parquet;
pub mod raw2event;
mod table;
pub mod text;

pub use destination::Destination;
pub use table::StoredTable;
