//! From a selection of effects to the reported diagnosis.

pub(crate) mod conclude;
pub(crate) mod departure;
pub(crate) mod diagnosis_report;
pub(crate) mod findings;
pub(crate) mod fitted_camera;
pub(crate) mod forward_simulation;
pub(crate) mod heat_map;
mod model_camera;
mod untestable;
mod verdict;
