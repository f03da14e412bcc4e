//! A session's images relative to an event stream: exposure times, the events between one and the
//! next, and the position of the target.

use crate::pipeline::{self, AnyTrack, PipelineError};
use evrig_core::time::{Clock, Davis, PiSensor, Stamp};
use evrig_format::hdf5::{SideColumn, SideGroup};
use evrig_format::npy::Column;
use evrig_reconstruct::clock::ClockEstimate;
use evrig_reconstruct::roi::{TargetView, Track};
use evrig_session::{RecordedFrame, Session, SessionError, StreamKind};

/// One image stream, a row an image.
pub(super) struct Images {
    pub(super) stream: String,
    /// The clock of `stamp_ns`.
    pub(super) clock: &'static str,
    columns: Vec<SideColumn>,
    pub(super) track: Option<TrackFacts>,
}

/// How far a track can be trusted.
pub(super) struct TrackFacts {
    pub(super) tag: String,
    pub(super) corner_rms_px: f64,
    /// RecordedFrame corners of each image, bottom left, bottom right, top right, top left; NaN where
    /// there is no path.
    pub(super) picture_px: Vec<[f64; 8]>,
}

impl Images {
    /// The columns as a group of a file.
    pub(super) fn group(&self) -> SideGroup {
        SideGroup { name: self.stream.clone(), columns: self.columns.clone() }
    }

    pub(super) fn columns(&self) -> &[SideColumn] {
        &self.columns
    }

    /// Middle of each image's exposure, µs of the events' clock.
    pub(super) fn times_us(&self) -> &[i64] {
        match self.columns.first().map(|column| &column.values) {
            Some(Column::Int(times)) => times,
            _ => &[],
        }
    }
}

/// The image streams that have a place on the events' clock, and why the others are left out.
pub(super) fn read(
    session: &Session,
    events_t: &[i64],
) -> Result<(Vec<Images>, Vec<String>), PipelineError> {
    let mut images = Vec::new();
    let mut left_out = Vec::new();
    for entry in session.manifest().streams.iter().filter(|s| s.kind == StreamKind::Frames) {
        let name = entry.name.as_str();
        let track = pipeline::read_track(session, name)?;
        if session.is_from_pi(name)? {
            let Some(clocks) = pipeline::read_clocks(session)? else {
                left_out.push(format!(
                    "`{name}` is on the Pi's clock, and `evrig sync` did not find its way to the events'"
                ));
                continue;
            };
            let map: ClockEstimate<Davis, PiSensor> = clocks.davis_from(name);
            let track = match track {
                Some(AnyTrack::Pi(track)) => Some(track),
                _ => None,
            };
            let pictures = session.pi_frames(name)?;
            images.push(rows(name, pictures, events_t, track, |at| map.map(at))?);
        } else {
            let track = match track {
                Some(AnyTrack::Davis(track)) => Some(track),
                _ => None,
            };
            images.push(rows(name, session.davis_frames(name)?, events_t, track, Some)?);
        }
    }
    Ok((images, left_out))
}

fn rows<C: Clock>(
    stream: &str,
    pictures: impl Iterator<Item = Result<RecordedFrame<C>, SessionError>>,
    events_t: &[i64],
    track: Option<Track<C>>,
    on_events_clock: impl Fn(Stamp<C>) -> Option<Stamp<Davis>>,
) -> Result<Images, SessionError> {
    let mut times = Vec::new();
    let mut own = Vec::new();
    let mut exposures: Option<[Vec<i64>; 2]> = Some([Vec::new(), Vec::new()]);
    let mut views: Vec<Option<TargetView>> = Vec::new();
    let mut residuals = Vec::new();
    for (shown, picture) in pictures.enumerate() {
        let picture = picture?;
        let timing = &picture.frame.timing;
        let middle = timing.mid_exposure(picture.frame.size.height / 2);
        let Some(at) = on_events_clock(middle) else { continue };
        times.push(at.as_micros());
        own.push([picture.number as i64, timing.stamp.as_nanos()]);
        let exposure = timing.exposure.map(|stamps| stamps.map(&on_events_clock));
        match (&mut exposures, exposure) {
            (Some([starts, ends]), Some([Some(start), Some(end)])) => {
                starts.push(start.as_micros());
                ends.push(end.as_micros());
            }
            // A column that does not hold for every image would not be understood.
            _ => exposures = None,
        }
        residuals.push(track.as_ref().and_then(|track| residual_px(track, shown as u64)));
        views.push(track.as_ref().and_then(|track| track.at(middle).ok()));
    }
    let first = |t: &i64| events_t.partition_point(|event| event < t) as i64;
    let mut columns = vec![
        SideColumn::integers("first_event", times.iter().map(first).collect()),
        SideColumn::integers("number", own.iter().map(|own| own[0]).collect()),
        SideColumn::integers("stamp_ns", own.iter().map(|own| own[1]).collect()),
    ];
    columns.insert(0, SideColumn::integers("t_us", times));
    if let Some([starts, ends]) = exposures.filter(|[starts, _]| !starts.is_empty()) {
        columns.push(SideColumn::integers("exposure_start_us", starts));
        columns.push(SideColumn::integers("exposure_end_us", ends));
    }
    let track = track.map(|track| {
        let corners = picture_columns(&views, &mut columns);
        let residuals = residuals.into_iter().map(|found| found.unwrap_or(f64::NAN)).collect();
        columns.push(SideColumn::rows("corner_residual_px", residuals, 1));
        let corner_rms_px = track.quality.corner_rms_px;
        TrackFacts { tag: track.tag, corner_rms_px, picture_px: corners }
    });
    Ok(Images { stream: stream.to_owned(), clock: C::NAME, columns, track })
}

/// Distance of the tag's corners in a frame from where the path puts them, root mean square over the
/// four; none where the tag was not seen, or the path ends between its rows.
fn residual_px<C: Clock>(track: &Track<C>, shown: u64) -> Option<f64> {
    let at = track.detections.binary_search_by_key(&shown, |detection| detection.frame).ok()?;
    let detection = &track.detections[at];
    let mut squares = 0.0;
    for (i, place_mm) in track.plane.tag_corners_mm().into_iter().enumerate() {
        let view = track.at(detection.time + detection.corner_delays[i]).ok()?;
        let ([u, v], [x, y]) = (view.pixel(place_mm), detection.corners_px[i]);
        squares += (x - u).powi(2) + (y - v).powi(2);
    }
    Some((squares / 4.0).sqrt())
}

/// Homographies and the picture's outline with its errors, NaN where there is no path.
fn picture_columns(views: &[Option<TargetView>], columns: &mut Vec<SideColumn>) -> Vec<[f64; 8]> {
    let nowhere = [f64::NAN; 8];
    let flat =
        |corners: [[f64; 2]; 4]| -> [f64; 8] { std::array::from_fn(|i| corners[i / 2][i % 2]) };
    let homographies = views.iter().flat_map(|view| {
        view.as_ref().map_or([f64::NAN; 9], |view| {
            let rows: [[f64; 3]; 3] = (*view.homography()).into();
            std::array::from_fn(|i| rows[i / 3][i % 3])
        })
    });
    let homographies = homographies.collect();
    let rois: Vec<_> = views.iter().map(|view| view.as_ref().map(TargetView::roi)).collect();
    let corners: Vec<[f64; 8]> =
        rois.iter().map(|roi| roi.map_or(nowhere, |roi| flat(roi.polygon))).collect();
    let errors = rois.iter().flat_map(|roi| roi.map_or(nowhere, |roi| flat(roi.polygon_errors)));
    let errors = errors.collect();
    columns.push(SideColumn::rows("ideal_px_from_target_mm", homographies, 9));
    columns.push(SideColumn::rows("picture_px", corners.concat(), 8));
    columns.push(SideColumn::rows("picture_error_px", errors, 8));
    corners
}
