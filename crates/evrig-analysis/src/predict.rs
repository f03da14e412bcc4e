//! The teacher-forced predictor: how likely are the events that were seen, given the light?
//!
//! Each pixel is a point process that depends on its own past. At an event, and after its blind
//! time, the pixel memorises the light; from there on the signal `y` is the light's change since,
//! in log intensity, with leak. On and Off each have a threshold that is drawn anew for every event
//! about its mean (log-logistic, so that it is positive), and an event comes when the running
//! maximum of `y`, or of `-y`, passes it. The compensator of a monotone stretch is therefore a
//! difference of two values of one function: nothing is summed over a grid in time, however sharp
//! the crossing. To this come two hazards that need no new maximum: the noise's own movement, which
//! lets the signal cross while the light stands still (after Rice, Bell Syst. Tech. J. 24, 1945),
//! and background events. What a pixel memorised before its first event is not known: it then lies
//! anywhere between its two thresholds, so that silent pixels count too. Where something came about
//! behind the pixel (a filter of events took some out, an event was added) it may have memorised one
//! thing or another: a few cases are then followed side by side, each with its weight.
//!
//! The score is the log-likelihood of the process, events and silences, in nats per event with time
//! in seconds. Pixels are independent of each other given the light: they are worked on in
//! parallel and summed in a fixed order, so the result has the same bits on any number of threads.

mod bends;
mod blocks;
mod by_pixel;
mod course;
mod law;
mod light;
mod lost;
mod mask;
mod memory;
mod movement;
mod normal;
mod residual;
mod sample;
mod score;
mod softplus;
mod threshold;
mod walk;

pub use bends::Bends;
pub use blocks::{BlockScore, Blocks};
pub use by_pixel::{ByPixel, Spike};
pub use law::{LawError, PixelLaw, SHOT_SPEED};
pub use light::{Light, Lights};
pub use residual::{Previous, Residual, Silence, residuals};
pub use sample::{Followed, Moment, followed, sample};
pub use score::{Score, score, score_lights, score_pixel};
pub use walk::{EventTerm, Stretch, Witness, walk};

#[cfg(test)]
mod tests;
