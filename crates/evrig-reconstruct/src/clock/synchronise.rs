//! Synchronisation of a session: every method runs, the best one is used, the others check it.
//!
//! There are three clocks. SensorTimestamp is the Pi's boot clock. Unix time is the host's where
//! the session read both clocks together, otherwise that of the Pi's wall clock, the only one of an
//! import. The events' clock is Unix time as well, read once at the recorder's reset; it is
//! rejected when packets arrive before their own stamps or a second late. [`motion`] maps the Pi's
//! clock to the events' without Unix time.

use super::agreement::{Disagreement, cross_check};
use super::clock_pair::{PairOptions, clock_pair};
use super::envelope::{EnvelopeOptions, RateModel, envelope};
use super::error::ClockError;
use super::estimate::{ClockEstimate, ClockSegment, Method, MinimumLatency};
use super::hull::hull;
use super::input::{FramePair, FramePairs, TwoSidedReading};
use super::motion::{MotionEstimate, MotionOptions, TrackSample, motion};
use super::olson2::olson2;
use super::paper_interval::{PaperUnit, paper_interval};
use super::paper_window::paper_window;
use super::stream_delay::StreamDelay;
use evrig_core::time::{Clock, ClockMap, Davis, PiSensor, Span, Stamp, Unix};
use serde::{Deserialize, Serialize};

/// Clock observations of a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClockObservations {
    /// SensorTimestamp and RealTime of each frame, in the order of recording.
    pub frames: Vec<FramePair>,
    /// The Pi's wall clock between two readings of its boot clock.
    pub wall_readings: Vec<TwoSidedReading>,
    /// The host's clock between bounds of the Pi's boot clock; see [`host_reading`].
    pub host_readings: Vec<TwoSidedReading>,
    /// Last stamp of each packet of events, and the host's clock when it was complete.
    pub arrivals: Vec<FramePair<Unix, Davis>>,
    /// Least time from SensorTimestamp to RealTime: readout of all rows.
    pub readout: Option<Span>,
}

/// Result of one method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct MethodResult<A: Clock = Unix, B: Clock = PiSensor> {
    /// The method.
    pub method: Method,
    /// Its estimate.
    pub estimate: Option<ClockEstimate<A, B>>,
    /// Why it gives no estimate.
    pub refused: Option<String>,
}

/// The host whose Unix time is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeReference {
    /// The host's.
    Host,
    /// The Pi's wall clock in place of the host's: at best both were set by a time server.
    PiWall,
}

/// Map from the events' stamps to Unix time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EventsClock {
    /// Whether the stamps are used as Unix time, or mapped by their arrivals.
    pub is_as_stamped: bool,
    /// The map.
    pub unix_from_davis: ClockMap<Unix, Davis>,
    /// Minimum time from stamp to arrival, with its method; a stamp cannot be later than that.
    pub arrivals: Option<MethodResult<Unix, Davis>>,
    /// Reason in words.
    #[serde(alias = "because")]
    pub reason: String,
}

/// Result of the motion fit between both cameras.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MotionResult {
    /// Names of the two tracks: of the DAVIS and of the Pi.
    pub tracks: [String; 2],
    /// The estimate.
    pub estimate: Option<MotionEstimate<Davis, PiSensor>>,
    /// Why it is not used as the session's map; None if it is.
    pub refused: Option<String>,
}

/// The clocks of a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SessionClocks {
    /// The Pi's wall clock from SensorTimestamp by every applicable method.
    pub wall: Vec<MethodResult>,
    /// The host's clock from SensorTimestamp, where both were read together.
    pub host: Option<MethodResult>,
    /// The host whose Unix time `unix_from_sensor` maps to.
    pub reference: TimeReference,
    /// The map used.
    pub unix_from_sensor: ClockEstimate,
    /// Difference of the Pi's wall clock to the host's in the middle of the session, where both are
    /// known by two-sided readings.
    pub wall_minus_host: Option<Span>,
    /// Methods whose intervals are disjoint from that of the best map to the same clock.
    pub disagreements: Vec<Disagreement<PiSensor>>,
    /// The events' clock.
    pub events: EventsClock,
    /// The motion fit, where there are tracks.
    pub motion: Option<MotionResult>,
    /// Map from SensorTimestamp to the events' stamps.
    pub davis_from_sensor: ClockEstimate<Davis, PiSensor>,
    /// Streams of the Pi with delayed exposures.
    #[serde(default, alias = "late")]
    pub stream_delays: Vec<StreamDelay>,
}

/// Reading of the host's clock against the Pi's boot clock from a request and its reply.
///
/// The Pi read its clock between `asked` and `answered`, with `first` at the beginning and `last`
/// at the end of its own reading. At the middle of the round trip the boot clock was at most half
/// the round trip after `first`, and at most half of it before `last`.
#[must_use]
pub fn host_reading(
    group: u64,
    asked: Stamp<Unix>,
    [first, last]: [Stamp<PiSensor>; 2],
    answered: Stamp<Unix>,
) -> TwoSidedReading {
    let half = Span::from_nanos((answered - asked).as_nanos() / 2);
    TwoSidedReading { group, before: last - half, real: asked + half, after: first + half }
}

/// Greatest chi-squared per degree of freedom without a further check: larger residuals mean either
/// that the tracks state too small errors or that they show different motions.
const MAX_CHI2_PER_DOF: f64 = 4.0;
/// Greatest unexplained share of the motion where the residuals are larger: a hundredth of the
/// amplitude, squared.
const MAX_UNEXPLAINED: f64 = 1e-4;
/// Greatest correction of the rate, ppm: quartz clocks agree to a hundred, larger values are failed
/// fits.
const MAX_SKEW_PPM: f64 = 5_000.0;
/// Greatest share of a track's samples left out as outliers.
const MAX_OUTLIER_SHARE: f64 = 0.25;
/// Longest delay of a link and its buffers from stamp to arrival.
const MAX_TRANSPORT: Span = Span::from_micros(1_000_000);
/// Rate difference of two clocks of one host, ppm: rounding alone.
const SAME_HOST_PPM: f64 = 1.0;
/// Tolerance of a method without an interval of its own.
const NO_INTERVAL_TOLERANCE: Span = Span::from_micros(3_000);

/// Runs every applicable method.
///
/// # Errors
/// When no method gives a map: the reason of the best one.
pub fn synchronise(observations: &ClockObservations) -> Result<SessionClocks, ClockError> {
    let wall = wall_attempts(observations);
    let host = (!observations.host_readings.is_empty()).then(|| {
        attempt(Method::ClockPair, clock_pair(&observations.host_readings, &PairOptions::default()))
    });
    let best_wall = best_estimate(&wall);
    let best_host = host.as_ref().and_then(|host| host.estimate.clone());
    let (reference, chosen) = match (best_host, &best_wall) {
        (Some(host), _) => (TimeReference::Host, host),
        (None, Some(wall)) => (TimeReference::PiWall, wall.clone()),
        (None, None) => return Err(no_map(observations)),
    };
    let disagreements = best_wall
        .iter()
        .flat_map(|best_estimate| {
            let others = wall.iter().filter_map(|attempt| attempt.estimate.as_ref());
            let others = others.filter(|other| other.method != best_estimate.method);
            others.filter_map(|other| cross_check(best_estimate, other, NO_INTERVAL_TOLERANCE))
        })
        .collect();
    let wall_minus_host = wall_minus_host(&wall, host.as_ref());
    let events = events_clock(&observations.arrivals);
    let davis_from_sensor = compose(&chosen, events.unix_from_davis.inverse());
    Ok(SessionClocks {
        wall,
        host,
        reference,
        unix_from_sensor: chosen,
        wall_minus_host,
        disagreements,
        events,
        motion: None,
        davis_from_sensor,
        stream_delays: Vec::new(),
    })
}

impl SessionClocks {
    /// Map from the stamps of a stream of the Pi to the events' clock, corrected for the stream's
    /// delay.
    #[must_use]
    pub fn davis_from(&self, stream: &str) -> ClockEstimate<Davis, PiSensor> {
        let of_stream = self.stream_delays.iter().find(|delay| delay.stream == stream);
        let delay_us = of_stream.and_then(|delay| delay.delay_us).map_or(0.0, |delay| delay.value);
        self.davis_from_sensor.clone().delayed(Span::from_secs_f64(delay_us * 1e-6))
    }

    /// Maps the Pi's frames to the events by the motion that both cameras saw.
    ///
    /// The fit is used when it is accepted and both tracks show one motion; otherwise the reason is
    /// stored beside the previous map.
    pub fn refine(
        &mut self,
        names: [&str; 2],
        davis: &[TrackSample<Davis>],
        pi: &[TrackSample<PiSensor>],
        options: &MotionOptions,
    ) {
        let tracks = names.map(str::to_owned);
        let middle = pi.get(pi.len() / 2).map(|sample| sample.at);
        let initial = middle.and_then(|at| self.davis_from_sensor.segment_at(at));
        let found = match initial {
            Some(segment) => motion(davis, pi, segment.map, options),
            None => Err(ClockError::TooFewSamples { track: "other", found: 0, needed: 1 }),
        };
        self.motion = Some(match found {
            Ok(estimate) => {
                let refused = rejection(&estimate, [davis.len(), pi.len()]);
                if refused.is_none() {
                    self.davis_from_sensor = estimate.clock.clone();
                }
                MotionResult { tracks, estimate: Some(estimate), refused }
            }
            Err(error) => MotionResult { tracks, estimate: None, refused: Some(error.to_string()) },
        });
    }
}

/// Why a fit is rejected; None if it is accepted. `n` are the samples of the two tracks.
fn rejection(found: &MotionEstimate<Davis, PiSensor>, n: [usize; 2]) -> Option<String> {
    let has_large_residuals =
        found.chi2_per_dof > MAX_CHI2_PER_DOF && found.unexplained > MAX_UNEXPLAINED;
    let skew_ppm = found.skew_ppm.map_or(0.0, |skew| skew.value);
    // False for NaN, too.
    let is_plausible_rate = skew_ppm.abs() <= MAX_SKEW_PPM;
    let left_out = [0, 1].map(|track| found.n_outliers[track] as f64 / n[track].max(1) as f64);
    let has_many_outliers = left_out.iter().any(|share| *share > MAX_OUTLIER_SHARE);
    let [davis, pi] = left_out.map(|share| 1e2 * share);
    (has_large_residuals || !is_plausible_rate || has_many_outliers).then(|| {
        format!(
            "the residuals are {:.1} times the stated errors and {:.1} % of the motion, \
             {davis:.0} and {pi:.0} % of the samples are outliers, and the clocks would differ by \
             {skew_ppm:.0} ppm: the tracks do not show one motion",
            found.chi2_per_dof.sqrt(),
            1e2 * found.unexplained.sqrt(),
        )
    })
}

fn attempt<A: Clock, B: Clock>(
    method: Method,
    found: Result<ClockEstimate<A, B>, ClockError>,
) -> MethodResult<A, B> {
    match found {
        Ok(estimate) => MethodResult { method, estimate: Some(estimate), refused: None },
        Err(error) => MethodResult { method, estimate: None, refused: Some(error.to_string()) },
    }
}

fn wall_attempts(observations: &ClockObservations) -> Vec<MethodResult> {
    let mut attempts = Vec::new();
    if !observations.wall_readings.is_empty() {
        let readings = &observations.wall_readings;
        attempts.push(attempt(Method::ClockPair, clock_pair(readings, &PairOptions::default())));
    }
    if observations.frames.is_empty() {
        return attempts;
    }
    let latency = observations
        .readout
        .map_or(MinimumLatency::Unknown, |floor| MinimumLatency::ReadoutFloor { floor });
    let options = EnvelopeOptions { latency, ..EnvelopeOptions::default() };
    let checked = FramePairs::check(&observations.frames);
    let checked = checked.as_ref().map_err(Clone::clone);
    attempts.push(attempt(Method::Envelope, checked.clone().and_then(|p| envelope(p, &options))));
    attempts.push(attempt(Method::Hull, checked.clone().and_then(|p| hull(p, latency))));
    attempts.push(attempt(
        Method::Olson2,
        checked.clone().and_then(|p| olson2(p, SAME_HOST_PPM, latency)),
    ));
    attempts.push(attempt(Method::PaperWindow, checked.and_then(paper_window)));
    let published = paper_interval(&observations.frames, PaperUnit::Microseconds);
    attempts.push(attempt(Method::PaperInterval, published));
    attempts
}

/// Two-sided readings before minimum latency; no other method has a calibrated interval.
fn best_estimate(attempts: &[MethodResult]) -> Option<ClockEstimate> {
    let of = |method| {
        let mut found = attempts.iter().filter(move |attempt| attempt.method == method);
        found.find_map(|attempt| attempt.estimate.clone())
    };
    of(Method::ClockPair).or_else(|| of(Method::Envelope))
}

fn no_map(observations: &ClockObservations) -> ClockError {
    match FramePairs::check(&observations.frames) {
        Err(error) => error,
        Ok(_) => ClockError::NoReadings { n_seen: observations.wall_readings.len(), n_reversed: 0 },
    }
}

fn wall_minus_host(wall: &[MethodResult], host: Option<&MethodResult>) -> Option<Span> {
    let pair = wall.iter().find(|attempt| attempt.method == Method::ClockPair)?;
    let (wall, host) = (pair.estimate.as_ref()?, host?.estimate.as_ref()?);
    let (first, last) = (host.segments.first()?.first, host.segments.last()?.last);
    let middle = Stamp::from_nanos(first.as_nanos().midpoint(last.as_nanos()));
    Some(wall.map(middle)? - host.map(middle)?)
}

/// The events' clock: Unix time as stamped, unless the arrivals contradict it.
fn events_clock(arrivals: &[FramePair<Unix, Davis>]) -> EventsClock {
    let as_stamped = ClockMap::from_anchor(Stamp::from_nanos(0), Stamp::from_nanos(0));
    if arrivals.is_empty() {
        return EventsClock {
            is_as_stamped: true,
            unix_from_davis: as_stamped,
            arrivals: None,
            reason: "the camera's recorder stamps Unix time; no arrivals were recorded to check it"
                .into(),
        };
    }
    let options = EnvelopeOptions { rate: RateModel::Device, ..EnvelopeOptions::default() };
    let found = FramePairs::check(arrivals).and_then(|pairs| envelope(&pairs, &options));
    let attempt = attempt(Method::Envelope, found);
    let middle = arrivals[arrivals.len() / 2].sensor;
    let segment = attempt.estimate.as_ref().and_then(|estimate| estimate.segment_at(middle));
    let (is_as_stamped, map, reason) = match segment {
        None => (
            true,
            as_stamped,
            "the camera's recorder stamps Unix time; the arrivals give no estimate".into(),
        ),
        Some(segment) => {
            // Packets are delayed, never early: the fastest one bounds the offset.
            let after = arrivals.iter().map(|pair| pair.real - as_stamped.map(pair.sensor));
            let late = after.min().unwrap_or(Span::ZERO);
            if (Span::ZERO..=MAX_TRANSPORT).contains(&late) {
                (
                    true,
                    as_stamped,
                    format!("Unix time as stamped: the fastest packets arrive {late} later"),
                )
            } else {
                let reason = format!(
                    "the stamps are not the host's Unix time: the fastest packets arrive {late} \
                     after them; mapped by their arrivals, with an unknown transport delay"
                );
                (false, segment.map, reason)
            }
        }
    };
    EventsClock { is_as_stamped, unix_from_davis: map, arrivals: Some(attempt), reason }
}

/// Composes a map to Unix time with the map to the events' clock.
fn compose(
    unix_from_sensor: &ClockEstimate,
    davis_from_unix: ClockMap<Davis, Unix>,
) -> ClockEstimate<Davis, PiSensor> {
    let segment = |segment: &ClockSegment| ClockSegment {
        first: segment.first,
        last: segment.last,
        start: segment.start,
        map: ClockMap {
            a0: davis_from_unix.map(segment.map.a0),
            b0: segment.map.b0,
            // Added in this form so that parts per billion survive.
            skew: segment.map.skew + davis_from_unix.skew * (1.0 + segment.map.skew),
        },
        skew_ppm: segment.skew_ppm,
        error: segment.error,
        n_used: segment.n_used,
    };
    ClockEstimate {
        method: unix_from_sensor.method,
        segments: unix_from_sensor.segments.iter().map(segment).collect(),
        minimum_latency: unix_from_sensor.minimum_latency,
        doubtful: unix_from_sensor.doubtful.clone(),
        tally: unix_from_sensor.tally,
        diagnostics: unix_from_sensor.diagnostics.clone(),
    }
}

#[cfg(test)]
mod tests;
