//! Levels of significance and of what counts as a mismatch.

/// Significance of a gain or a mismatch, standard errors over cells: 1 % over a library of thirty
/// effects (the first step of Holm's correction, 0.033 % one-sided).
pub(crate) const SIGNIFICANT_STANDARD_ERRORS: f64 = 3.4;

/// Doubt in a model, standard errors: 2.3 % one-sided. A search that finds nothing costs only time.
pub(crate) const DOUBT_STANDARD_ERRORS: f64 = 2.0;

/// A gain below this is not named: a likelihood ratio of e in a hundred events.
pub(crate) const NEGLIGIBLE_NATS_PER_EVENT: f64 = 0.01;
