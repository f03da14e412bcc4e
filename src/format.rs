//! File formats, one a file: bytes in, values out, in bounded memory.

pub mod npy;
