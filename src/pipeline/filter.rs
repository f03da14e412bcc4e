//! The stage `filter`: an event stream cropped to the moving target and without noise, by the same
//! code and settings whether it is real or generated.

use super::error::missing;
use super::sync::read_clocks;
use super::track::{self, AnyTrack};
use super::{Freshness, PipelineError, clear, fresh_record, inputs};
use evrig_analysis::filter::region::{RegionPath, RegionSetting};
use evrig_analysis::filter::{
    DropTally, Filtered, background, hot_pixel, rate, refractory, region,
};
use evrig_core::event::Events;
use evrig_core::geometry::{Homography, Size};
use evrig_core::time::{Clock, Davis, PiSensor, Stamp};
use evrig_format::aedat4::{Compression, Reader, StreamSpec, Writer};
use evrig_reconstruct::clock::ClockEstimate;
use evrig_reconstruct::roi::{TargetPlane, Track};
use evrig_session::{
    EventTally, Session, StageRecord, StreamKind, StreamName, read_stage, write_stage,
};
use serde::{Deserialize, Serialize};
use serde_json::json;

/// What to filter, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FilterRequest {
    /// The event stream, real or generated.
    pub stream: StreamName,
    /// Which filters run.
    pub settings: FilterSettings,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// Which filters run, in this order: hot pixels, background, refractory, region, rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FilterSettings {
    /// Whether events outside the tracked target are dropped.
    pub region: bool,
    /// Margin around the target, as a share of its side.
    pub margin: f64,
    /// Side of the square crop in target coordinates; none to leave events at their pixels.
    pub crop_px: Option<u16>,
    /// Whether hot pixels are removed.
    pub hot_pixel: bool,
    /// Longest time since an event of a neighbouring pixel, microseconds.
    pub background_us: Option<i64>,
    /// Least time since the last kept event of the pixel, microseconds.
    pub refractory_us: Option<i64>,
    /// Most events in each millisecond.
    pub max_events_per_ms: Option<u64>,
}

impl Default for FilterSettings {
    /// The region with the published margin of 3 %, and nothing else.
    fn default() -> Self {
        Self {
            region: true,
            margin: 0.03,
            crop_px: None,
            hot_pixel: false,
            background_us: None,
            refractory_us: None,
            max_events_per_ms: None,
        }
    }
}

/// A filtered stream.
#[derive(Debug, Clone, PartialEq)]
pub struct FilteredStream {
    /// Counts.
    pub tally: FilterTally,
    /// Whether it ran now.
    pub freshness: Freshness,
}

/// Counts of events read, kept and dropped by reason.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FilterTally {
    /// Events of the file, with those that are not on the sensor.
    pub read: EventTally,
    /// Events seen by the filters: kept, and dropped by reason.
    pub events: DropTally,
    /// Number of hot pixels found.
    pub n_hot_pixels: u64,
    /// The track behind the region.
    pub track: Option<String>,
    /// Grid of the events that went out.
    pub size: Option<Size>,
}

/// Settings that cut streams of any camera to one grid: the target as wide as the event camera sees
/// it. None without a track of the event camera.
#[must_use]
pub fn common_grid(session: &Session) -> Option<FilterSettings> {
    let tracked = track::tracked(session);
    let of_davis = tracked.iter().find(|name| !session.is_from_pi(name).unwrap_or(true))?;
    let summary = track::read_summary(session, of_davis)?;
    let plain = FilterSettings::default();
    let crop = (summary.picture_px * (1.0 + 2.0 * plain.margin)).round().clamp(1.0, 4096.0);
    Some(FilterSettings { crop_px: Some(crop as u16), ..plain })
}

/// Interval of the knots of a path, µs.
const STEP_US: i64 = 1_000;

/// Runs the stage, unless its result is fresh.
///
/// # Errors
/// When there is no such stream, the region is asked for and there is no track for it, a setting
/// makes no sense, or the disk refuses.
pub fn filter(session: &Session, request: &FilterRequest) -> Result<FilteredStream, PipelineError> {
    let (name, settings) = (&request.stream, &request.settings);
    let mut inputs = inputs::of_events(session, name.as_str())?;
    let track = if settings.region { Some(track_for(session, name)?) } else { None };
    if let Some(track) = &track {
        inputs.extend(track::outputs(session, track)?);
        if session.is_from_pi(track)? {
            inputs.extend(super::luminance::inputs_of(session, track)?);
        }
    }
    let parameters = json!({ "settings": settings, "track": track });
    let wanted = StageRecord::new("filter", Some(name.as_str()), inputs, parameters);
    let directory = session.layout().derived("filter", Some(name));
    if !request.force
        && let Some(record) = fresh_record(&directory, &wanted)
        && let Ok(tally) = record.tally_as()
    {
        return Ok(FilteredStream { tally, freshness: Freshness::Fresh });
    }
    let (events, read) = session.events(name.as_str())?;
    let size = grid(session, name)?;
    let path = match &track {
        Some(track) => Some(region_path(session, track, size, &events)?),
        None => None,
    };
    let chain = Chain { settings, size, path: path.as_ref() };
    let (filtered, n_hot_pixels) = chain.run(events).map_err(|source| PipelineError::Filter {
        session: session.root().to_owned(),
        stream: name.to_string(),
        source,
    })?;
    let out = settings.crop_px.filter(|_| track.is_some()).map_or(size, |px| Size::new(px, px));
    let tally = FilterTally { read, events: filtered.tally, n_hot_pixels, track, size: Some(out) };
    clear(&directory)?;
    let spec = StreamSpec::events(out, &format!("evrig filter of {name}"));
    let mut writer = Writer::create(directory.join("events.aedat4"), Compression::Lz4, &[spec])?;
    writer.write_events(0, filtered.events.as_slice())?;
    writer.finish()?;
    write_stage(&directory, StageRecord { tally: json!(tally), ..wanted }, &["events.aedat4"])?;
    Ok(FilteredStream { tally, freshness: Freshness::Ran })
}

/// The tally of a stream that was filtered; none before the stage ran on it.
#[must_use]
pub fn read_filter_tally(session: &Session, stream: &StreamName) -> Option<FilterTally> {
    let record = read_stage(&session.layout().derived("filter", Some(stream)))?;
    record.tally_as().ok()
}

/// The filtered events of a stream with their grid, and the checksums of their source; none when
/// the stage did not run on the stream as it is now.
pub(super) fn filtered_events(
    session: &Session,
    stream: &StreamName,
) -> Result<Option<(Events, Size, inputs::Inputs)>, PipelineError> {
    let directory = session.layout().derived("filter", Some(stream));
    let Some(record) = read_stage(&directory) else { return Ok(None) };
    let now = inputs::of_events(session, stream.as_str())?;
    let is_current = now.iter().all(|(file, sha256)| record.inputs.get(file) == Some(sha256));
    let size = read_filter_tally(session, stream).and_then(|tally| tally.size);
    let (true, Some(size)) = (is_current, size) else { return Ok(None) };
    let mut events = Events::new();
    let reader =
        Reader::open(directory.join("events.aedat4")).map_err(evrig_session::SessionError::from)?;
    for packet in reader {
        let packet = packet.map_err(evrig_session::SessionError::from)?;
        if let evrig_format::aedat4::Content::Events(found) = packet.content {
            events.extend_from_slice(found.as_slice());
        }
    }
    let inside = |(file, sha256)| (format!("derived/filter-{stream}/{file}"), sha256);
    Ok(Some((events, size, record.outputs.into_iter().map(inside).collect())))
}

/// The events of a stream as the stage left them, in the target's own coordinates, with their grid;
/// none when the stage did not run on the stream as it is now.
///
/// # Errors
/// When a file cannot be read.
pub fn picture_events(
    session: &Session,
    stream: &StreamName,
) -> Result<Option<(Events, Size)>, PipelineError> {
    Ok(filtered_events(session, stream)?.map(|(events, size, _)| (events, size)))
}

/// The track that shows where the image is on the grid of a stream's events.
///
/// # Errors
/// When the tag was not tracked in the stream's own camera.
pub fn track_for(session: &Session, stream: &StreamName) -> Result<String, PipelineError> {
    let record = read_stage(&session.layout().derived("generate", Some(stream)));
    let light = record.and_then(|r| r.parameters.get("from")?.as_str().map(str::to_owned));
    let is_from_pi = light.as_ref().is_some_and(|light| session.is_from_pi(light).unwrap_or(false));
    let tracked = track::tracked(session);
    let same_camera = |name: &&String| session.is_from_pi(name).unwrap_or(false) == is_from_pi;
    let own = tracked.iter().find(|name| Some(*name) == light.as_ref());
    own.or_else(|| tracked.iter().find(same_camera)).cloned().ok_or_else(|| {
        let camera = if is_from_pi { "the Pi's camera" } else { "the event camera" };
        let what = format!(
            "no track of {camera} locates the target image in `{stream}`; run `evrig track`, \
             or filter the whole sensor with --no-region"
        );
        missing(session, what)
    })
}

/// The pixel grid of an event stream.
///
/// # Errors
/// When there is no such stream, or it states no grid.
pub fn stream_grid(session: &Session, stream: &StreamName) -> Result<Size, PipelineError> {
    grid(session, stream)
}

pub(super) fn grid(session: &Session, stream: &StreamName) -> Result<Size, PipelineError> {
    let stated = session.stream(StreamKind::Events, stream.as_str()).ok().and_then(|s| s.size);
    if let Some(size) = stated {
        return Ok(size);
    }
    let reader = Reader::open(session.layout().generated(stream))
        .map_err(evrig_session::SessionError::from)?;
    let size = reader.streams().iter().find_map(|stream| stream.size);
    size.ok_or_else(|| missing(session, format!("`{stream}` states no pixel grid")))
}

fn region_path(
    session: &Session,
    stream: &str,
    size: Size,
    events: &Events,
) -> Result<RegionPath, PipelineError> {
    let found = track::read_track(session, stream)?;
    let found =
        found.ok_or_else(|| missing(session, format!("the track of `{stream}` is gone")))?;
    let times = events.as_slice().t;
    let span = [times.first().copied().unwrap_or(0), times.last().copied().unwrap_or(0)];
    let path = match &found {
        AnyTrack::Davis(track) => path_of(track, size, span, Some),
        AnyTrack::Pi(track) => {
            let clocks = read_clocks(session)?;
            let clocks = clocks.ok_or_else(|| {
                missing(session, format!("`{stream}` is on the Pi's clock; run `evrig sync` first"))
            })?;
            let clock: ClockEstimate<Davis, PiSensor> = clocks.davis_from(stream);
            path_of(track, size, span, |at| clock.inverse_map(at))
        }
    };
    path.map_err(|source| PipelineError::Filter {
        session: session.root().to_owned(),
        stream: stream.to_owned(),
        source,
    })
}

/// The way from pixels to the image while events come, cut to the time that the track knows.
fn path_of<C: Clock>(
    track: &Track<C>,
    size: Size,
    [first_us, last_us]: [i64; 2],
    on_its_clock: impl Fn(Stamp<Davis>) -> Option<Stamp<C>>,
) -> Result<RegionPath, evrig_analysis::filter::FilterError> {
    let square_from_plane = square_from_plane(&track.plane);
    let square_from_pixel = |t_us: i64| {
        let view = track.at(on_its_clock(Stamp::from_micros(t_us))?).ok()?;
        Some(view.homography().inverse()?.then(&square_from_plane))
    };
    let bends = track.lens.distortion != [0.0; 5];
    let ideal = |pixel: [f64; 2]| track.lens.undistort(pixel);
    let ideal: Option<&dyn Fn([f64; 2]) -> Option<[f64; 2]>> =
        if bends { Some(&ideal) } else { None };
    RegionPath::new(size, [first_us, last_us], STEP_US, square_from_pixel, ideal)
}

/// From millimetres on the target to the target image, 0 to 1 from left to right and top to bottom.
fn square_from_plane(plane: &TargetPlane) -> Homography {
    let [x, y] = plane.picture_corners_mm()[3];
    let scale = 1.0 / plane.picture_side_mm;
    Homography::from([[scale, 0.0, -x * scale], [0.0, scale, -y * scale], [0.0, 0.0, 1.0]])
}

/// The filters in their order.
struct Chain<'a> {
    settings: &'a FilterSettings,
    size: Size,
    path: Option<&'a RegionPath>,
}

impl Chain<'_> {
    fn run(&self, events: Events) -> Result<(Filtered, u64), evrig_analysis::filter::FilterError> {
        let n = events.len() as u64;
        let mut all =
            Filtered { events, tally: DropTally { seen: n, kept: n, ..DropTally::default() } };
        let mut n_hot = 0;
        let Self { settings, size, path } = *self;
        if settings.hot_pixel {
            let setting = hot_pixel::HotPixelSetting::default();
            let (next, hot) = hot_pixel::filter(all.events.as_slice(), size, setting)?;
            n_hot = hot.len() as u64;
            all = then(all, next);
        }
        if let Some(window_us) = settings.background_us {
            let next = background::filter(all.events.as_slice(), size, window_us)?;
            all = then(all, next);
        }
        if let Some(period_us) = settings.refractory_us {
            let next = refractory::filter(all.events.as_slice(), size, period_us)?;
            all = then(all, next);
        }
        let mut size = size;
        if let Some(path) = path {
            let setting = RegionSetting { margin: settings.margin, crop_px: settings.crop_px };
            let next = region::filter(all.events.as_slice(), path, setting)?;
            size = settings.crop_px.map_or(size, |px| Size::new(px, px));
            all = then(all, next);
        }
        if let Some(max_events) = settings.max_events_per_ms {
            let next = rate::filter(all.events.as_slice(), size, max_events, 1_000)?;
            all = then(all, next);
        }
        Ok((all, n_hot))
    }
}

fn then(before: Filtered, next: Filtered) -> Filtered {
    Filtered { events: next.events, tally: before.tally.then(&next.tally) }
}
