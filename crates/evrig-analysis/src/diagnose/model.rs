//! The camera as it is fitted: constants, terms of effects, thresholds of the pixels.

pub(crate) mod camera_model;
pub(crate) mod constants;
pub(crate) mod image_pose;
pub(crate) mod registration;
pub(crate) mod terms;
pub(crate) mod view;
