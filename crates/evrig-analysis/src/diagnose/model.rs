//! The generative model of a recording: nuisances, library effects, and what they make of a pixel.

pub(crate) mod hypothesis;
pub(crate) mod image_pose;
pub(crate) mod library;
pub(crate) mod likelihood_profile;
pub(crate) mod nuisance;
pub(crate) mod pixel_mixture;
pub(crate) mod predicted_pixel;
pub(crate) mod registration;
pub(crate) mod sampled_sine;
pub(crate) mod score_grid;
