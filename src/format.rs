//! File formats, one a file: bytes in, values out, in bounded memory.

pub mod npy;
//! Formats, one file each: bytes in, values out, in bounded memory.

pub mod aedat4;
