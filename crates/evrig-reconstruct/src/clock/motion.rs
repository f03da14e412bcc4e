//! Offset and rate between two cameras from a motion seen by both.
//!
//! Both tracks are noisy samples of one path `q(t)`: the reference sees it directly, the other
//! camera scaled, rolled, shifted, and `tau + kappa (t - middle)` later. Path, geometry and time
//! are fitted jointly; the path is a spline that is eliminated exactly, so that the error of `tau`
//! is its Cramér-Rao bound with everything else unknown.
//!
//! A circle in one direction at constant speed is equivalent to a roll, and no fit can separate
//! them: an answer is given only when the information on `tau`, less the part due to noise of the
//! path, suffices.
//!
//! Systematic errors are not included: pixel latency of the event camera, the sign of the exposure
//! ([`super::ExposureSign`]), the delay of the first row. State them as
//! [`MotionOptions::systematic`].

use super::error::ClockError;
use super::estimate::{
    ClockEstimate, ClockSegment, Diagnostics, Method, MinimumLatency, SegmentError, SegmentStart,
};
use super::input::PairTally;
use coarse::CoarseStart;
use evrig_core::stats::Estimate;
use evrig_core::time::{Clock, ClockMap, Span, Stamp};
use samples::{TrackPoint, points};
use serde::{Deserialize, Serialize};
use solve::{MotionFit, Solver};

mod banded;
mod coarse;
mod equations;
mod path;
mod samples;
mod solve;

pub use samples::{MotionOptions, TrackSample};

/// Result of the motion fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct MotionEstimate<A: Clock, B: Clock> {
    /// The map from the other camera's clock to the reference's.
    pub clock: ClockEstimate<A, B>,
    /// Correction of the initial map in the middle of the tracks, µs; positive: the initial map was
    /// too early.
    pub correction_us: Estimate,
    /// Correction of the initial map's rate.
    pub skew_ppm: Option<Estimate>,
    /// Size in the other camera over size in the reference.
    pub scale: Estimate,
    /// Roll of the other camera's image against the reference's.
    pub roll_deg: Estimate,
    /// Cramér-Rao bound of the offset's standard error for this motion with everything else
    /// unknown.
    pub cramer_rao_us: f64,
    /// The same with known geometry.
    pub cramer_rao_known_geometry_us: f64,
    /// Inflation by unknown geometry: the first over the second, corrected for noise of the path.
    pub ratio: f64,
    /// Sum of squared residuals over its expectation. The errors above are scaled by it where it
    /// exceeds one, and clustered over a quarter of a second.
    pub chi2_per_dof: f64,
    /// Unexplained share of the other track's motion: mean square over mean square.
    #[serde(default)]
    pub unexplained: f64,
    /// Knot spacing of the path, seconds.
    pub knot_s: f64,
    /// Outliers left out, reference and other.
    pub n_outliers: [u64; 2],
}

/// Fewest samples of a track.
const MIN_SAMPLES: usize = 24;
/// Distance of the other's samples from the ends of the path, seconds; it exceeds the change of the
/// offset in the fit.
const EDGE_MARGIN_S: f64 = 0.03;

/// Fits the offset of `other` against `reference`, starting from `initial`.
///
/// The tracks must overlap by more than twice the search range.
///
/// # Errors
/// Too few samples, a motion that does not determine the offset, two equally good offsets, or a fit
/// that leaves the search range.
pub fn motion<A: Clock, B: Clock>(
    reference: &[TrackSample<A>],
    other: &[TrackSample<B>],
    initial: ClockMap<A, B>,
    options: &MotionOptions,
) -> Result<MotionEstimate<A, B>, ClockError> {
    let Some(origin) = reference.first().map(|sample| sample.at) else {
        return Err(ClockError::TooFewSamples {
            track: "reference",
            found: 0,
            needed: MIN_SAMPLES,
        });
    };
    let reference = points(reference, |at| at - origin);
    require("reference", reference.len())?;
    let search_s = options.search.as_secs_f64();
    let (first, last) = (reference[0].t_s, reference[reference.len() - 1].t_s);
    let n_seen = other.len();
    let other = points(other, |at| initial.map(at) - origin);
    let within = |early_s: f64, late_s: f64| {
        let inside =
            move |point: &&TrackPoint| first + early_s <= point.t_s && point.t_s <= last - late_s;
        other.iter().filter(inside).copied().collect::<Vec<TrackPoint>>()
    };
    // The grid compares all offsets on the same samples; the fit uses all that the best offset
    // reaches.
    let common = within(search_s, search_s);
    require("other", common.len())?;
    let path = path::PathSpline::fit(&reference);
    let start = coarse::search(&path, &common, search_s, options.roll_deg)?;
    let other = within(EDGE_MARGIN_S - start.tau_s, EDGE_MARGIN_S + start.tau_s);
    require("other", other.len())?;
    let solver = Solver::new(&reference, &other, options);
    let fit = solver.run(path, start)?;
    check_fit(&fit, start, options)?;
    Ok(report(&fit, origin, initial, [&reference, &other], n_seen, options))
}

/// Accepts or rejects the fit; its information first, since without any it does not converge.
fn check_fit(
    fit: &MotionFit,
    start: CoarseStart,
    options: &MotionOptions,
) -> Result<(), ClockError> {
    let (search, limit) = (options.search, options.max_ratio);
    if fit.ratio_at_least > limit {
        return Err(ClockError::DegenerateMotion { ratio: fit.ratio, limit });
    }
    if let Some(alternative_s) = start.alternative_s {
        let [first, second] = [start.tau_s, alternative_s].map(Span::from_secs_f64);
        return Err(ClockError::AmbiguousOffset { first, second });
    }
    let error = Span::from_secs_f64(1.96 * fit.sigma_tau_s);
    if error > search {
        return Err(ClockError::WeakMotion { error, search });
    }
    if !fit.is_converged {
        return Err(ClockError::NotConverged { steps: solve::MAX_STEPS });
    }
    if fit.tau_s.abs() > search.as_secs_f64() {
        return Err(ClockError::OutOfRange { search });
    }
    Ok(())
}

fn require(track: &'static str, found: usize) -> Result<(), ClockError> {
    let enough = found >= MIN_SAMPLES;
    let error = ClockError::TooFewSamples { track, found, needed: MIN_SAMPLES };
    if enough { Ok(()) } else { Err(error) }
}

fn report<A: Clock, B: Clock>(
    fit: &MotionFit,
    origin: Stamp<A>,
    initial: ClockMap<A, B>,
    [reference, other]: [&[TrackPoint]; 2],
    n_seen: usize,
    options: &MotionOptions,
) -> MotionEstimate<A, B> {
    let n = other.len() as u64;
    let back = initial.inverse();
    let stamp = |t_s: f64| back.map(origin + Span::from_secs_f64(t_s));
    let b0 = stamp(fit.middle_s);
    let map = ClockMap {
        a0: initial.map(b0) + Span::from_secs_f64(fit.tau_s),
        b0,
        skew: (1.0 + initial.skew) * (1.0 + fit.kappa) - 1.0,
    };
    let sigma_us = fit.sigma_tau_s * 1e6;
    let half = Span::from_secs_f64(1.96 * fit.sigma_tau_s);
    let wide = half + options.systematic;
    let error = SegmentError {
        offset_us: Estimate::normal(0.0, sigma_us, n),
        statistical95: [-half, half],
        absolute95: [Some(-wide), Some(wide)],
    };
    let skew_ppm =
        options.fits_skew.then(|| Estimate::normal(fit.kappa * 1e6, fit.sigma_kappa * 1e6, n));
    let segment = ClockSegment {
        first: stamp(other[0].t_s),
        last: stamp(other[other.len() - 1].t_s),
        start: SegmentStart::Beginning,
        map,
        skew_ppm,
        error: Some(error),
        n_used: n,
    };
    let clock = ClockEstimate {
        method: Method::Motion,
        segments: vec![segment],
        minimum_latency: MinimumLatency::Motion,
        doubtful: Vec::new(),
        tally: PairTally { n_seen: n_seen as u64, n_kept: n, ..PairTally::default() },
        diagnostics: Diagnostics::default(),
    };
    let scale = fit.ln_scale.exp();
    MotionEstimate {
        clock,
        correction_us: Estimate::normal(fit.tau_s * 1e6, sigma_us, n),
        skew_ppm,
        scale: Estimate::normal(scale, scale * fit.sigma_ln_scale, n),
        roll_deg: Estimate::normal(fit.roll.to_degrees(), fit.sigma_roll.to_degrees(), n),
        cramer_rao_us: fit.limit_s * 1e6,
        cramer_rao_known_geometry_us: fit.limit_known_s * 1e6,
        ratio: fit.ratio,
        chi2_per_dof: fit.chi2_per_dof,
        unexplained: fit.unexplained,
        knot_s: fit.knot_s,
        n_outliers: [
            fit.is_outlier[..reference.len()].iter().filter(|&&out| out).count() as u64,
            fit.is_outlier[reference.len()..].iter().filter(|&&out| out).count() as u64,
        ],
    }
}
