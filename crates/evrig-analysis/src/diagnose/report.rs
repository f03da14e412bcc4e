//! What a diagnosis returns: its result types, and the fitted camera.

pub(crate) mod conclusion;
pub(crate) mod departure;
pub(crate) mod diagnosis_report;
pub(crate) mod fitted_camera;
pub(crate) mod forward_simulation;
pub(crate) mod heat_map;
pub(crate) mod model_error;
pub(crate) mod parameter_intervals;
pub(crate) mod proposed_term;
