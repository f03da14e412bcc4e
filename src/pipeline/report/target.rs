//! Results of the stages sync, track, scene and filter in the report.

use crate::pipeline::track::{AnyTrack, read_summary, read_track, tracked};
use crate::pipeline::{PipelineError, read_clocks, read_filter_tally, read_scene};
use evrig_core::time::{Clock, Davis, Stamp};
use evrig_format::npy::Npz;
use evrig_reconstruct::clock::SessionClocks;
use evrig_reconstruct::roi::Track;
use evrig_report::page::{Fact, Section};
use evrig_report::scene::scene_section;
use evrig_report::tracking::{
    FrameInterval, ImagePath, ImagePathPoint, clock_section, filter_section, track_section,
};
use evrig_session::{Session, SessionError, StreamKind, StreamName};

/// Points of a path that are drawn.
const N_POINTS: i64 = 800;

/// The sections of the stages that ran.
///
/// # Errors
/// When a result cannot be read.
pub(super) fn sections(session: &Session) -> Result<Vec<Section>, PipelineError> {
    let mut sections = Vec::new();
    let clocks = read_clocks(session)?;
    if let Some(clocks) = &clocks {
        sections.push(clock_section(clocks, &intervals(session)?));
    }
    let paths = paths(session, clocks.as_ref())?;
    if !paths.is_empty() {
        sections.push(track_section(&paths, facts(session, &paths)));
    }
    if let Some(scene) = read_scene(session)? {
        sections.push(scene_section(&scene).map_err(PipelineError::Image)?);
    }
    let recorded = session.manifest().streams.iter().filter(|s| s.kind == StreamKind::Events);
    let mut names: Vec<StreamName> =
        recorded.filter_map(|stream| StreamName::new(&stream.name).ok()).collect();
    names.extend(session.generated_names());
    let tally =
        |name: &StreamName| Some((name.to_string(), read_filter_tally(session, name)?.events));
    let filtered: Vec<_> = names.iter().filter_map(tally).collect();
    if !filtered.is_empty() {
        sections.push(filter_section(&filtered));
    }
    Ok(sections)
}

fn intervals(session: &Session) -> Result<Vec<FrameInterval>, PipelineError> {
    let path = session.layout().derived("sync", None).join("frames.npz");
    let mut npz = Npz::open(&path).map_err(SessionError::from)?;
    let mut column = |name: &str| -> Result<Vec<i64>, PipelineError> {
        let array = npz.array(name).map_err(SessionError::from)?;
        let column = array.fields.into_iter().next().map(|(_, column)| column);
        Ok(column.unwrap_or_default().into_integers().unwrap_or_default())
    };
    let (sensor_ns, real_us) = (column("sensor_timestamp_ns")?, column("real_time_us")?);
    let began = sensor_ns.first().copied().unwrap_or(0);
    let pairs = sensor_ns.windows(2).zip(real_us.windows(2));
    Ok(pairs
        .map(|(sensor, real)| FrameInterval {
            at_s: sensor[0].saturating_sub(began) as f64 * 1e-9,
            sensor_ms: sensor[1].saturating_sub(sensor[0]) as f64 * 1e-6,
            real_ms: real[1].saturating_sub(real[0]) as f64 * 1e-3,
        })
        .collect())
}

/// Every track over the session's time, which is the events' where the clocks are known.
fn paths(
    session: &Session,
    clocks: Option<&SessionClocks>,
) -> Result<Vec<ImagePath>, PipelineError> {
    let mut found = Vec::new();
    for name in tracked(session) {
        match read_track(session, &name)? {
            Some(AnyTrack::Davis(track)) => {
                found.push((name, true, sampled(&track, Some)));
            }
            Some(AnyTrack::Pi(track)) => {
                let Some(clocks) = clocks else { continue };
                let clock = clocks.davis_from(&name);
                let on_davis = |at| clock.map(at);
                found.push((name, false, sampled(&track, on_davis)));
            }
            None => {}
        }
    }
    let began = found.iter().filter_map(|(.., points)| points.first()).map(|(at, _)| *at).min();
    let path = |(stream, is_davis, points): (String, bool, Vec<(Stamp<Davis>, ImagePathPoint)>)| {
        let since = |at: Stamp<Davis>| began.map_or(0.0, |began| (at - began).as_secs_f64());
        let points = points.into_iter();
        let points =
            points.map(|(at, point)| ImagePathPoint { at_s: since(at), ..point }).collect();
        ImagePath { stream, is_davis, points }
    };
    Ok(found.into_iter().map(path).collect())
}

fn sampled<C: Clock>(
    track: &Track<C>,
    on_davis: impl Fn(Stamp<C>) -> Option<Stamp<Davis>>,
) -> Vec<(Stamp<Davis>, ImagePathPoint)> {
    let Some([first, last]) = track.span() else { return Vec::new() };
    let length = (last - first).as_nanos();
    let mut last_angle: Option<f64> = None;
    let point = |k: i64| {
        let at = first + evrig_core::time::Span::from_nanos(length / N_POINTS * k);
        let roi = track.at(at).ok().map(|view| view.roi());
        let none = ImagePathPoint {
            at_s: 0.0,
            centre_px: [f64::NAN; 2],
            side_px: f64::NAN,
            angle_deg: f64::NAN,
        };
        let point = roi.map_or(none, |roi| {
            // A turn beyond half a circle goes on instead of jumping back.
            let turns = last_angle.map_or(0.0, |last| ((last - roi.angle.0) / 360.0).round());
            let angle_deg = roi.angle.0 + 360.0 * turns;
            last_angle = Some(angle_deg);
            let side_px = (roi.size[0].0 * roi.size[1].0).sqrt();
            ImagePathPoint { at_s: 0.0, centre_px: roi.centre, side_px, angle_deg }
        });
        Some((on_davis(at)?, point))
    };
    (0..=N_POINTS).filter_map(point).collect()
}

fn facts(session: &Session, paths: &[ImagePath]) -> Vec<Fact> {
    let words = |path: &ImagePath| {
        let summary = read_summary(session, &path.stream)?;
        let mut words = format!(
            "{} in {} of {} frames, corners {:.3} px rms from the path",
            summary.tag, summary.n_used, summary.n_seen, summary.corner_rms_px
        );
        if !summary.lost.is_empty() {
            words += &format!("; lost: {}", summary.lost);
        }
        if summary.n_gaps > 0 {
            words += &format!("; {} gaps of {:.3} s together", summary.n_gaps, summary.gaps_s);
        }
        Some(Fact::new(&path.stream, words))
    };
    paths.iter().filter_map(words).collect()
}
