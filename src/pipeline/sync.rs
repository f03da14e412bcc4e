//! The stage `sync`: the session's clocks, and the time of each Pi frame on the events' clock.

use super::error::missing;
use super::streams::pi_streams;
use super::track::{self, AnyTrack};
use super::{Freshness, PipelineError, clear, fresh_record, inputs, read_json};
use evrig_core::time::{Clock, PiSensor, Span, Unix};
use evrig_core::units::Pixels;
use evrig_format::npy::NpzWriter;
use evrig_reconstruct::clock::{
    ClockObservations, FramePair, MotionOptions, SessionClocks, TimeReference, TrackSample,
    host_reading, synchronise,
};
use evrig_reconstruct::roi::Track;
use evrig_session::rig::Rig;
use evrig_session::{
    Origin, RigLogContents, Session, SessionError, StageRecord, StreamKind, write_stage,
};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

/// What the stage found.
#[derive(Debug, Clone)]
pub struct Synced {
    /// The clocks with their errors.
    pub clocks: SessionClocks,
    /// What went in.
    pub tally: SyncTally,
    /// Whether it ran now.
    pub freshness: Freshness,
}

/// Counts of the evidence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SyncTally {
    /// Frames with a SensorTimestamp.
    pub n_frames: u64,
    /// Of them with a RealTime that can be read.
    pub n_real_times: u64,
    /// Frames with the SensorTimestamp of another one.
    pub n_duplicate: u64,
    /// Frames missing between others, by their SensorTimestamps.
    pub n_missing: u64,
    /// Readings of the Pi's clocks.
    pub n_readings: u64,
    /// Packets of events with the time of their arrival.
    pub n_arrivals: u64,
}

/// Runs the stage, unless its result is fresh. Tracks of both cameras, where they are there, let
/// their motion decide.
///
/// # Errors
/// When the session has no frames of the Pi, its stamps make no clock, or the disk refuses.
pub fn sync(session: &Session, force: bool) -> Result<Synced, PipelineError> {
    let streams = pi_streams(session);
    if streams.is_empty() {
        let what =
            "it has no frames of the Pi's camera; there is nothing to put on the events' clock";
        return Err(missing(session, what.into()));
    }
    let mut inputs = inputs::Inputs::new();
    for name in &streams {
        let entry = session.stream(StreamKind::Frames, name)?;
        inputs.extend(inputs::of_recorded(session, entry));
    }
    let tracks = pair_of_tracks(session)?;
    let late = rgb_and_raw(session)?;
    let names = tracks.iter().flatten().map(|(name, _)| name.as_str());
    let of_late = late.iter().flat_map(|_| RGB_AND_RAW);
    for name in names.chain(of_late) {
        inputs.extend(track::outputs(session, name)?);
    }
    let wanted = StageRecord::new("sync", None, inputs, json!({}));
    let directory = session.layout().derived("sync", None);
    if !force
        && let Some(record) = fresh_record(&directory, &wanted)
        && let Some(clocks) = read_clocks(session)?
    {
        let tally = record.tally_as().unwrap_or_default();
        return Ok(Synced { clocks, tally, freshness: Freshness::Fresh });
    }
    let (evidence, tally) = evidence(session)?;
    let mut clocks = synchronise(&evidence)
        .map_err(|source| PipelineError::Clock { session: session.root().to_owned(), source })?;
    if let Some([(davis, AnyTrack::Davis(real)), (pi, AnyTrack::Pi(seen))]) = &tracks {
        // Two clocks read side by side are nearly right; else the offset may be anywhere in a
        // second.
        let search = match clocks.reference {
            TimeReference::Host => Span::from_micros(50_000),
            TimeReference::PiWall => Span::from_micros(500_000),
        };
        let options = MotionOptions { search, ..MotionOptions::default() };
        clocks.refine([davis, pi], &samples(real), &samples(seen), &options);
    }
    if let Some([rgb, raw]) = &late {
        clocks.stream_delays.push(evrig_reconstruct::clock::estimate_stream_delay(
            RGB_AND_RAW,
            &samples(rgb),
            &samples(raw),
        ));
    }
    clear(&directory)?;
    write_clocks(session, &clocks)?;
    write_frames(session, &evidence, &clocks)?;
    let record = StageRecord { tally: json!(tally), ..wanted };
    write_stage(&directory, record, &["clock.json", "frames.npz"])?;
    Ok(Synced { clocks, tally, freshness: Freshness::Ran })
}

/// The clocks that the stage found; none before it ran.
///
/// # Errors
/// When its file cannot be read.
pub fn read_clocks(session: &Session) -> Result<Option<SessionClocks>, PipelineError> {
    read_json(clock_path(session))
}

fn clock_path(session: &Session) -> PathBuf {
    session.layout().derived("sync", None).join("clock.json")
}

fn write_clocks(session: &Session, clocks: &SessionClocks) -> Result<(), PipelineError> {
    let path = clock_path(session);
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = serde_json::to_string_pretty(clocks).map_err(|error| io(error.into()))?;
    std::fs::write(&path, text + "\n").map_err(io)
}

/// Each frame's stamps as they were recorded, and beside them what the maps make of them.
fn write_frames(
    session: &Session,
    evidence: &ClockObservations,
    clocks: &SessionClocks,
) -> Result<(), PipelineError> {
    let path = session.layout().derived("sync", None).join("frames.npz");
    let frames = &evidence.frames;
    let unix = frames.iter().map(|f| clocks.unix_from_sensor.map(f.sensor));
    let davis = frames.iter().map(|f| clocks.davis_from_sensor.map(f.sensor));
    let columns: [(&str, Vec<i64>); 4] = [
        ("sensor_timestamp_ns", frames.iter().map(|f| f.sensor.as_nanos()).collect()),
        ("real_time_us", frames.iter().map(|f| f.real.as_micros()).collect()),
        ("unix_us", unix.map(|at| at.map_or(0, |at| at.as_micros())).collect()),
        ("davis_us", davis.map(|at| at.map_or(0, |at| at.as_micros())).collect()),
    ];
    let mut npz = NpzWriter::create(&path).map_err(SessionError::from)?;
    for (name, column) in columns {
        npz.add(name, &[column.len() as u64], column).map_err(SessionError::from)?;
    }
    Ok(npz.finish().map_err(SessionError::from)?)
}

/// What the session's files say of its clocks.
fn evidence(session: &Session) -> Result<(ClockObservations, SyncTally), PipelineError> {
    let notes = session.rig_log_contents()?;
    let rig = session.rig()?;
    let stamps = if notes.metadata.is_empty() {
        session.imported_pi_stamps()?
    } else {
        notes.metadata.iter().map(|m| (m.sensor_timestamp, Some(m.real_time))).collect()
    };
    let n_frames = stamps.len() as u64;
    let frames: Vec<FramePair> = stamps
        .iter()
        .filter_map(|(sensor, real)| real.map(|real| FramePair::new(*sensor, real)))
        .collect();
    let sensor_ns: Vec<i64> = stamps.iter().map(|(sensor, _)| sensor.as_nanos()).collect();
    let (n_duplicate, n_missing) = doubt(&sensor_ns);
    let evidence = ClockObservations {
        wall_readings: wall_readings(&notes),
        host_readings: host_readings(&notes),
        arrivals: arrivals(session, &notes),
        readout: rig.as_ref().map(readout),
        frames,
    };
    let tally = SyncTally {
        n_frames,
        n_real_times: evidence.frames.len() as u64,
        n_duplicate,
        n_missing,
        n_readings: notes.exchanges.len() as u64,
        n_arrivals: evidence.arrivals.len() as u64,
    };
    Ok((evidence, tally))
}

/// Frames stamped like the one before, and frames missing between others.
fn doubt(stamps_ns: &[i64]) -> (u64, u64) {
    let steps: Vec<f64> = stamps_ns.windows(2).map(|p| (p[1] - p[0]) as f64).collect();
    let n_duplicate = steps.iter().filter(|step| **step == 0.0).count() as u64;
    let mut sorted: Vec<f64> = steps.iter().copied().filter(|step| *step > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    if sorted.is_empty() {
        return (n_duplicate, 0);
    }
    let typical = evrig_core::stats::quantile_sorted(&sorted, 0.5);
    let gaps = sorted.iter().filter(|step| **step > 1.5 * typical);
    let n_missing: f64 = gaps.map(|step| (step / typical).round() - 1.0).sum();
    (n_duplicate, n_missing as u64)
}

/// The sensor reads its rows one after another until the crop is whole; the image is not handed
/// over before.
fn readout(rig: &Rig) -> Span {
    let rows = i64::from(rig.pi.crop_origin_px[1]) + i64::from(rig.pi.camera.size.height);
    Span::from_nanos(rig.pi.camera.row_time.as_nanos().saturating_mul(rows))
}

fn wall_readings(notes: &RigLogContents) -> Vec<evrig_reconstruct::clock::TwoSidedReading> {
    let numbered = notes.exchanges.iter().zip(0..);
    let reading = |(exchange, group): (&evrig_session::ClockExchange, u64)| {
        let pi = exchange.pi;
        evrig_reconstruct::clock::TwoSidedReading {
            group,
            before: pi.boottime_before,
            real: pi.realtime,
            after: pi.boottime_after,
        }
    };
    numbered.map(reading).collect()
}

fn host_readings(notes: &RigLogContents) -> Vec<evrig_reconstruct::clock::TwoSidedReading> {
    let numbered = notes.exchanges.iter().zip(0..);
    let reading = |(exchange, group): (&evrig_session::ClockExchange, u64)| {
        let inside = [exchange.pi.boottime_before, exchange.pi.boottime_after];
        host_reading(group, exchange.asked.unix, inside, exchange.answered.unix)
    };
    numbered.map(reading).collect()
}

/// Packets of events alone: those of frames wait for their readout.
fn arrivals(
    session: &Session,
    notes: &RigLogContents,
) -> Vec<FramePair<Unix, evrig_core::time::Davis>> {
    let streams = session.manifest().streams.iter();
    let events = streams.filter(|s| s.kind == StreamKind::Events && s.file == "davis.aedat4");
    let ids: Vec<u32> = events.filter_map(|stream| stream.stream_id).collect();
    let of_events = notes.arrivals.iter().filter(|arrival| ids.contains(&arrival.stream));
    of_events
        .map(|arrival| {
            let last = evrig_core::time::Stamp::from_micros(arrival.last_us);
            FramePair::new(last, arrival.arrived.unix)
        })
        .collect()
}

/// A track of the DAVIS and one of the Pi, where there are both.
type TrackPair = [(String, AnyTrack); 2];

fn pair_of_tracks(session: &Session) -> Result<Option<TrackPair>, PipelineError> {
    let mut davis = None;
    let mut pi = None;
    for name in track::tracked(session) {
        match track::read_track(session, &name)? {
            Some(found @ AnyTrack::Davis(_)) if davis.is_none() => davis = Some((name, found)),
            // Raw before RGB, whose frames an import knows to be late.
            Some(found @ AnyTrack::Pi(_)) if pi.is_none() || name == "raw" => {
                pi = Some((name, found))
            }
            _ => {}
        }
    }
    Ok(davis.zip(pi).map(|(davis, pi)| [davis, pi]))
}

/// The streams of the published layout that share their stamps though they come one after another.
const RGB_AND_RAW: [&str; 2] = ["rgb", "raw"];

/// The tracks of both in an import of that layout.
fn rgb_and_raw(session: &Session) -> Result<Option<[Track<PiSensor>; 2]>, PipelineError> {
    if !matches!(session.manifest().origin, Origin::Raw2Event { .. }) {
        return Ok(None);
    }
    let of = |name| -> Result<Option<Track<PiSensor>>, PipelineError> {
        Ok(match track::read_track(session, name)? {
            Some(AnyTrack::Pi(track)) => Some(track),
            _ => None,
        })
    };
    let [rgb, raw] = RGB_AND_RAW;
    Ok(of(rgb)?.zip(of(raw)?).map(|(rgb, raw)| [rgb, raw]))
}

/// A corner's own place shifts with how it falls on the pixels; what all corners of a frame have in
/// common of that is not in their covariance. Pixels; on simulated sessions residuals are then as
/// large as stated.
const COMMON_PX: f64 = 0.003;

/// The middle of the tag in each detection as a perfect lens would show it.
fn samples<C: Clock>(track: &Track<C>) -> Vec<TrackSample<C>> {
    let detections = track.detections.iter();
    detections
        .filter_map(|detection| {
            let mean =
                |axis: usize| detection.corners_px.iter().map(|c| c[axis]).sum::<f64>() / 4.0;
            let [x, y] = track.lens.undistort([0, 1].map(mean))?;
            // The variance of the mean of four corners along x and y, correlations in it.
            let sum = |axis: usize| -> f64 {
                let places = (0..4).flat_map(|a| (0..4).map(move |b| (2 * a + axis, 2 * b + axis)));
                places.map(|(i, j)| detection.covariance_px2[i][j]).sum()
            };
            let variance = track.quality.variance_factor * (sum(0) + sum(1)) / 2.0 / 16.0;
            Some(TrackSample {
                at: detection.time,
                x: Pixels(x),
                y: Pixels(y),
                error: Pixels(variance.max(0.0).sqrt().hypot(COMMON_PX)),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stamped_twice_and_frames_missing_between_others_are_counted() {
        let period = 8_333_000;
        // The third is stamped like the second, and three never came.
        let stamps: Vec<i64> = [0, 1, 1, 3, 6, 7, 8, 9].map(|k| k * period).to_vec();
        assert_eq!(doubt(&stamps), (1, 3));
        assert_eq!(doubt(&[period]), (0, 0));
    }
}
