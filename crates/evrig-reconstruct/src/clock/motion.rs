//! Offset and rate between two cameras from a motion that both saw.
//!
//! Both tracks are noisy samples of one path `q(t)`: the reference sees it as it is, the other
//! camera scaled, rolled, shifted, and `tau + kappa (t - middle)` later. Path, geometry and
//! time are fitted together; the path is a spline that is profiled out exactly, so the error
//! of `tau` is its Cramér-Rao limit given that nothing else is known.
//!
//! A circle run at constant speed in one direction moves as a roll does, and no fit can tell
//! them apart: the information left for `tau`, less what the path's own noise feigns, decides
//! whether an answer is given.
//!
//! What no statistics sees stays outside: pixel latency of the event camera, the sign of the
//! exposure ([`super::ExposureSign`]), the first row's delay. State them as
//! [`MotionOptions::systematic`].

use super::error::ClockError;
use super::estimate::{
    ClockEstimate, Diagnostics, Method, MinimumLatency, Segment, SegmentError, SegmentStart,
};
use super::input::PairTally;
use super::order::longest_increasing;
use coarse::Start;
use evrig_core::stats::Estimate;
use evrig_core::time::{Clock, ClockMap, Span, Stamp};
use evrig_core::units::Pixels;
use serde::{Deserialize, Serialize};
use solve::{Fit, Solver};

mod banded;
mod coarse;
mod equations;
mod path;
mod solve;

/// Where a camera saw the tag, and when: rows and exposure already reckoned with
/// ([`super::RowTiming::middle`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackSample<C: Clock> {
    /// Middle of the exposure of the row the position lies on.
    pub at: Stamp<C>,
    /// Column.
    pub x: Pixels,
    /// Row.
    pub y: Pixels,
    /// Standard error of each coordinate.
    pub error: Pixels,
}

/// What the fit is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionOptions {
    /// How far from the initial map the offset may lie.
    pub search: Span,
    /// Whether the rate is fitted too; over seconds it is hardly known, and does no harm.
    pub fits_skew: bool,
    /// Roll of the other camera against the reference in degrees, where it was measured otherwise.
    pub roll_deg: Option<Estimate>,
    /// Largest factor by which unknown geometry may inflate the error before the motion is refused.
    pub max_ratio: f64,
    /// Half width of what statistics do not see.
    pub systematic: Span,
}

impl Default for MotionOptions {
    fn default() -> Self {
        Self {
            search: Span::from_micros(500_000),
            fits_skew: true,
            roll_deg: None,
            max_ratio: 10.0,
            systematic: Span::ZERO,
        }
    }
}

/// The offset that motion tells, and what the fit saw on the way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct MotionEstimate<A: Clock, B: Clock> {
    /// The map from the other camera's clock to the reference's.
    pub clock: ClockEstimate<A, B>,
    /// Correction to the initial map in the middle of the tracks, µs; > 0: the initial map came too early.
    pub correction_us: Estimate,
    /// Correction to the initial map's rate.
    pub skew_ppm: Option<Estimate>,
    /// Size in the other camera over size in the reference.
    pub scale: Estimate,
    /// Roll of the other camera's picture against the reference's.
    pub roll_deg: Estimate,
    /// Cramér-Rao limit of the offset's standard error for this motion, all else unknown.
    pub cramer_rao_us: f64,
    /// The same were the geometry known.
    pub cramer_rao_known_geometry_us: f64,
    /// What unknown geometry costs: the first over the second, the path's noise allowed for.
    pub ratio: f64,
    /// Sum of squared residuals over its expectation; the errors above grow with it where it exceeds
    /// one, and with what residuals have in common for a quarter of a second.
    pub chi2_per_dof: f64,
    /// Share of the other track's motion that is left unexplained: mean square over mean square.
    #[serde(default)]
    pub unexplained: f64,
    /// Distance of the path's knots, seconds.
    pub knot_s: f64,
    /// Samples left out as outliers, reference and other.
    pub n_outliers: [u64; 2],
}

/// Samples without which no path is fitted.
const MIN_SAMPLES: usize = 24;

/// Distance of the other's samples from the ends of the path, seconds: more than the fit still moves.
const EDGE_S: f64 = 0.03;

/// Fits the offset of `other` against `reference`, starting from `initial`.
///
/// The tracks must share more than twice the search on top of what is needed to fit.
///
/// # Errors
/// Too few samples, a motion that does not fix the offset, two offsets that fit alike, or a
/// fit that leaves the search range.
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
            move |point: &&Point| first + early_s <= point.t_s && point.t_s <= last - late_s;
        other.iter().filter(inside).copied().collect::<Vec<Point>>()
    };
    // The grid compares all offsets on the same samples; the fit uses what the best one reaches.
    let common = within(search_s, search_s);
    require("other", common.len())?;
    let path = path::Path::fit(&reference);
    let start = coarse::search(&path, &common, search_s, options.roll_deg)?;
    let other = within(EDGE_S - start.tau_s, EDGE_S + start.tau_s);
    require("other", other.len())?;
    let solver = Solver::new(&reference, &other, options);
    let fit = solver.run(path, start)?;
    judge(&fit, start, options)?;
    Ok(report(&fit, origin, initial, [&reference, &other], n_seen, options))
}

/// Whether the fit is an answer: its information first, since without any it never settles.
fn judge(fit: &Fit, start: Start, options: &MotionOptions) -> Result<(), ClockError> {
    let (search, limit) = (options.search, options.max_ratio);
    if fit.ratio_at_least > limit {
        return Err(ClockError::DegenerateMotion { ratio: fit.ratio, limit });
    }
    if let Some(rival_s) = start.rival_s {
        let [first, second] = [start.tau_s, rival_s].map(Span::from_secs_f64);
        return Err(ClockError::AmbiguousOffset { first, second });
    }
    let error = Span::from_secs_f64(1.96 * fit.sigma_tau_s);
    if error > search {
        return Err(ClockError::WeakMotion { error, search });
    }
    if !fit.is_settled {
        return Err(ClockError::NotConverged { steps: solve::MAX_STEPS });
    }
    if fit.tau_s.abs() > search.as_secs_f64() {
        return Err(ClockError::OutOfRange { search });
    }
    Ok(())
}

/// A sample as numbers: seconds since the reference's first, pixels.
#[derive(Debug, Clone, Copy)]
struct Point {
    t_s: f64,
    p: [f64; 2],
    error: f64,
}

/// Finite samples in order of time.
fn points<C: Clock>(samples: &[TrackSample<C>], since: impl Fn(Stamp<C>) -> Span) -> Vec<Point> {
    let is_sound = |sample: &&TrackSample<C>| {
        let error = sample.error.value();
        sample.x.value().is_finite()
            && sample.y.value().is_finite()
            && error.is_finite()
            && error > 0.0
    };
    let sound: Vec<_> = samples.iter().filter(is_sound).collect();
    let stamps: Vec<i64> = sound.iter().map(|sample| sample.at.as_nanos()).collect();
    let in_order = longest_increasing(&stamps);
    let kept = sound.into_iter().zip(in_order).filter(|(_, is_kept)| *is_kept);
    kept.map(|(sample, _)| Point {
        t_s: since(sample.at).as_secs_f64(),
        p: [sample.x.value(), sample.y.value()],
        error: sample.error.value(),
    })
    .collect()
}

fn require(track: &'static str, found: usize) -> Result<(), ClockError> {
    let enough = found >= MIN_SAMPLES;
    let error = ClockError::TooFewSamples { track, found, needed: MIN_SAMPLES };
    if enough { Ok(()) } else { Err(error) }
}

fn report<A: Clock, B: Clock>(
    fit: &Fit,
    origin: Stamp<A>,
    initial: ClockMap<A, B>,
    [reference, other]: [&[Point]; 2],
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
    let segment = Segment {
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
