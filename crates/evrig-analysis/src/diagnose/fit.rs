//! Scoring and fitting of hypotheses, and the scan over the library.

pub(crate) mod bound_escape;
pub(crate) mod cell_scores;
pub(crate) mod curvature_probes;
pub(crate) mod effect_scan;
pub(crate) mod fitted;
pub(crate) mod gauss_newton;
pub(crate) mod laplace;
pub(crate) mod local_refinement;
pub(crate) mod multistart;
pub(crate) mod pixel_strata;
pub(crate) mod shared_grid;
pub(crate) mod spatial_region;
pub(crate) mod standard_errors;
