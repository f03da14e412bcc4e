//! v2e's pixel: brightness on a lin-log scale through a low-pass whose bandwidth falls with
//! the light, a leak, shot noise, thresholds that differ from pixel to pixel
//! (Hu, Liu and Delbruck, CVPRW 2021, section 4).
//!
//! As in the paper the pixel is updated once a frame: the number of events is how often the
//! threshold fits into the change since the last reset, and they are spread evenly over the
//! interval. Shot noise is a Poisson process of its own in continuous time, where the paper's
//! program tosses a coin per update; it leaves the memorised level alone. An event in the
//! refractory period is lost and its reset with it.

mod parameters;
mod pixel;
#[cfg(test)]
mod tests;

pub use parameters::V2eParameters;
pub(super) use pixel::V2e;
