//! What the world must show: truths planted, and demanded back from what the cameras give.

mod frames;
mod illumination;
mod pixel;
mod readout;
mod whole;
