//! The stage `compare`: a simulated stream against the real one.

use super::scene_source::is_scene;
use super::{Freshness, PipelineError, clear, filter, fresh_record, inputs, read_json};
use evrig_analysis::compare::{self, Comparison, FrameChanges, Maps, MeasureId, Setup};
use evrig_core::event::{EventSlice, Events};
use evrig_core::frame::Luminance;
use evrig_core::geometry::Size;
use evrig_format::npy::{Column, Npz, NpzWriter};
use evrig_session::{
    Session, SessionError, StageRecord, StreamKind, StreamName, read_stage, write_stage,
};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

/// Resamplings behind each error.
const N_BOOTSTRAP: usize = 400;

/// What to compare.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompareRequest {
    /// The reference stream.
    pub real: String,
    /// The simulated stream.
    pub simulated: StreamName,
    /// Seed of the resampling.
    pub seed: u64,
    /// Run even when the result is fresh.
    pub force: bool,
}

/// The reference stream of several comparisons, read once.
pub struct ReferenceStream<'a> {
    session: &'a Session,
    name: String,
    whole: Option<Arc<Events>>,
    /// As the stage `filter` left it; none inside when it did not run.
    cut: Option<Option<FilteredEvents>>,
}

/// A stream in the target's own coordinates, with the checksums of its source.
type FilteredEvents = (Arc<Events>, Size, inputs::Inputs);

impl<'a> ReferenceStream<'a> {
    /// The stream `name` of a session; nothing is read before it is needed.
    #[must_use]
    pub fn new(session: &'a Session, name: &str) -> Self {
        Self { session, name: name.to_owned(), whole: None, cut: None }
    }

    fn whole(&mut self) -> Result<Arc<Events>, PipelineError> {
        if let Some(events) = &self.whole {
            return Ok(Arc::clone(events));
        }
        let events = Arc::new(self.session.events(&self.name)?.0);
        Ok(Arc::clone(self.whole.insert(events)))
    }

    fn cut(&mut self) -> Result<Option<FilteredEvents>, PipelineError> {
        if let Some(cut) = &self.cut {
            return Ok(cut.clone());
        }
        let cut = filter::filtered_events(self.session, &StreamName::new(&self.name)?)?;
        let cut = cut.map(|(events, size, inputs)| (Arc::new(events), size, inputs));
        Ok(self.cut.insert(cut).clone())
    }
}

/// Runs the stage, unless its result is fresh.
///
/// The window is the time both streams can have events in: a generated stream's, from its
/// first frame to its last; for a stream simulated elsewhere, the overlap of the two.
///
/// # Errors
/// When a stream is missing, the two do not overlap in time, or the disk refuses.
pub fn compare(
    session: &Session,
    request: &CompareRequest,
) -> Result<(Comparison, Freshness), PipelineError> {
    compare_with(&mut ReferenceStream::new(session, &request.real), request)
}

/// As [`compare()`], with a reference stream that serves several comparisons; it represents
/// [`CompareRequest::real`].
///
/// # Errors
/// As [`compare()`].
pub fn compare_with(
    reference: &mut ReferenceStream<'_>,
    request: &CompareRequest,
) -> Result<(Comparison, Freshness), PipelineError> {
    let session = reference.session;
    let simulated_name = request.simulated.as_str();
    let cut = cut_alike(reference, request)?;
    let mut inputs = inputs::of_events(session, &reference.name)?;
    inputs.extend(inputs::of_events(session, simulated_name)?);
    inputs.extend(cut.iter().flat_map(|cut| cut.inputs.clone()));
    let light = light_of(session, &request.simulated);
    if let Some(light) = &light {
        inputs.extend(super::luminance::inputs_of(session, light)?);
    }
    let parameters = json!({
        "real": reference.name,
        "simulated": simulated_name,
        "light": light,
        "is_cut_to_picture": cut.is_some(),
        "seed": request.seed,
        "n_bootstrap": N_BOOTSTRAP,
        // A result with fewer measures is stale.
        "n_measures": MeasureId::ALL.len(),
    });
    let wanted = StageRecord::new("compare", Some(simulated_name), inputs, parameters);
    let directory = session.layout().derived("compare", Some(&request.simulated));
    if !request.force
        && fresh_record(&directory, &wanted).is_some()
        && let Some(comparison) = read_comparison(session, &request.simulated)?
    {
        return Ok((comparison, Freshness::Fresh));
    }
    let comparison = match cut {
        Some(cut) => run_cut(reference, request, &cut)?,
        None => run(reference, request, light.as_deref())?,
    };
    clear(&directory)?;
    write(&directory, &comparison)?;
    let tally = json!({ "n_real": comparison.n_real, "n_simulated": comparison.n_simulated });
    write_stage(&directory, StageRecord { tally, ..wanted }, &["comparison.json", "maps.npz"])?;
    Ok((comparison, Freshness::Ran))
}

/// Both streams as the stage `filter` left them, in the target's own coordinates.
struct ComparedStreams {
    real: Arc<Events>,
    simulated: Events,
    size: Size,
    inputs: inputs::Inputs,
}

/// Both streams cropped to the target; none unless both were, to the same grid.
fn cut_alike(
    reference: &mut ReferenceStream<'_>,
    request: &CompareRequest,
) -> Result<Option<ComparedStreams>, PipelineError> {
    let Some(simulated) = filter::filtered_events(reference.session, &request.simulated)? else {
        return Ok(None);
    };
    let (real, simulated) = (reference.cut()?, Some(simulated));
    Ok(real.zip(simulated).filter(|(real, simulated)| real.1 == simulated.1).map(
        |((real, size, mut inputs), (simulated, _, more))| {
            inputs.extend(more);
            ComparedStreams { real, simulated, size, inputs }
        },
    ))
}

/// Compares in the target's own coordinates, where streams of any camera meet.
fn run_cut(
    reference: &ReferenceStream<'_>,
    request: &CompareRequest,
    cut: &ComparedStreams,
) -> Result<Comparison, PipelineError> {
    let session = reference.session;
    let record = read_stage(&session.layout().derived("generate", Some(&request.simulated)));
    let tally = record.map(|record| record.tally);
    let number = |key: &str| tally.as_ref()?.get(key)?.as_i64();
    let span = |t: &[i64]| t.first().copied().zip(t.last().copied());
    let (real, simulated) = (cut.real.as_slice(), cut.simulated.as_slice());
    let overlap =
        span(real.t).zip(span(simulated.t)).map(|(a, b)| (a.0.max(b.0), a.1.min(b.1) + 1));
    let window = number("first_us").zip(number("last_us")).or(overlap);
    let window = window.filter(|(start, end)| start < end);
    let window = window.ok_or_else(|| no_overlap(reference, request))?;
    let setup = Setup {
        size: cut.size,
        window: [window.0, window.1],
        region: None,
        seed: request.seed,
        n_bootstrap: N_BOOTSTRAP,
        frames: None,
    };
    judge(reference, request, real, simulated, &setup)
}

fn no_overlap(reference: &ReferenceStream<'_>, request: &CompareRequest) -> PipelineError {
    let (real, simulated) = (&reference.name, &request.simulated);
    let what = format!("`{real}` and `{simulated}` do not overlap in time");
    PipelineError::Missing { session: reference.session.root().to_owned(), what }
}

fn judge(
    reference: &ReferenceStream<'_>,
    request: &CompareRequest,
    real: EventSlice<'_>,
    simulated: EventSlice<'_>,
    setup: &Setup<'_>,
) -> Result<Comparison, PipelineError> {
    compare::compare(real, simulated, setup).map_err(|source| PipelineError::Compare {
        session: reference.session.root().to_owned(),
        real: reference.name.clone(),
        simulated: request.simulated.to_string(),
        source,
    })
}

/// The frame stream a generated stream came from.
fn light_of(session: &Session, simulated: &StreamName) -> Option<String> {
    let record = read_stage(&session.layout().derived("generate", Some(simulated)))?;
    let light = record.parameters.get("from")?.as_str()?;
    // The scene has no frames.
    (!is_scene(session, light)).then(|| light.to_owned())
}

fn run(
    reference: &mut ReferenceStream<'_>,
    request: &CompareRequest,
    light: Option<&str>,
) -> Result<Comparison, PipelineError> {
    let session = reference.session;
    let real = reference.whole()?;
    let (simulated, _) = session.events(request.simulated.as_str())?;
    let missing =
        |what: String| PipelineError::Missing { session: session.root().to_owned(), what };
    let size = session.size().ok_or_else(|| missing("no stream states its pixel grid".into()))?;
    let own = filter::grid(session, &request.simulated)?;
    if own != size {
        return Err(missing(format!(
            "`{}` is on a grid of {own}, `{}` on {size}; cut both to the target image with \
             `evrig filter --crop PX`",
            request.simulated, reference.name
        )));
    }
    let (real, simulated) = (real.as_slice(), simulated.as_slice());
    let light = light.map(|light| LogFrames::read(session, light)).transpose()?;
    let span = |t: &[i64]| t.first().copied().zip(t.last().copied());
    let window = match &light {
        Some(frames) => span(&frames.times_us),
        None => span(real.t).zip(span(simulated.t)).map(|(a, b)| (a.0.max(b.0), a.1.min(b.1) + 1)),
    };
    let window = window.filter(|(start, end)| start < end);
    let window = window.ok_or_else(|| no_overlap(reference, request))?;
    let change = |k: usize, out: &mut [f32]| {
        if let Some(frames) = &light {
            frames.change(k, out);
        }
    };
    let setup = Setup {
        size,
        window: [window.0, window.1],
        region: None,
        seed: request.seed,
        n_bootstrap: N_BOOTSTRAP,
        frames: light
            .as_ref()
            .map(|frames| FrameChanges { times_us: &frames.times_us, change: &change }),
    };
    judge(reference, request, real, simulated, &setup)
}

/// Log brightness of a stream's frames, thinned where they would not fit in memory.
struct LogFrames {
    times_us: Vec<i64>,
    logs: Vec<Vec<f32>>,
}

/// Samples of log brightness that are held at once: 512 MiB.
const MAX_SAMPLES: u64 = 1 << 27;

impl LogFrames {
    /// Reads every frame, or every n-th where all would not fit; the last is always kept, so
    /// that the window is the same.
    fn read(session: &Session, light: &str) -> Result<Self, PipelineError> {
        let entry = session.stream(StreamKind::Frames, light)?;
        let n_samples = entry.count * entry.size.map_or(0, |size| size.n_pixels() as u64);
        let step = n_samples.div_ceil(MAX_SAMPLES).max(1);
        let mut frames = Self { times_us: Vec::new(), logs: Vec::new() };
        let mut last = None;
        for (i, frame) in super::luminance::luminance(session, light)?.enumerate() {
            let frame = frame?;
            if (i as u64).is_multiple_of(step) {
                frames.push(&frame);
                last = None;
            } else {
                last = Some(frame);
            }
        }
        last.iter().for_each(|frame| frames.push(frame));
        Ok(frames)
    }

    fn push(&mut self, frame: &Luminance) {
        self.times_us.push(frame.t_us);
        // A pixel without any light has no logarithm and is left out of the correlation.
        let log = |value: &f32| if *value > 0.0 { value.ln() } else { f32::NAN };
        self.logs.push(frame.values.iter().map(log).collect());
    }

    fn change(&self, k: usize, out: &mut [f32]) {
        let Some([before, after]) = self.logs.get(k..k + 2) else { return };
        for ((out, before), after) in out.iter_mut().zip(before).zip(after) {
            *out = after - before;
        }
    }
}

/// The comparison that a session holds for a simulated stream, with its maps; `None` without one.
///
/// # Errors
/// When its files cannot be read.
pub fn read_comparison(
    session: &Session,
    simulated: &StreamName,
) -> Result<Option<Comparison>, PipelineError> {
    let directory = session.layout().derived("compare", Some(simulated));
    let Some(mut comparison) = read_json::<Comparison>(directory.join("comparison.json"))? else {
        return Ok(None);
    };
    let mut npz = Npz::open(&directory.join("maps.npz")).map_err(SessionError::from)?;
    let Maps { size, real_on, real_off, simulated_on, simulated_off } = &mut comparison.maps;
    for (name, map) in MAP_NAMES.into_iter().zip([real_on, real_off, simulated_on, simulated_off]) {
        let array = npz.array(name).map_err(SessionError::from)?;
        if let [height, width] = array.shape[..] {
            let side = |n: u64| u16::try_from(n).unwrap_or(u16::MAX);
            *size = Some(Size::new(side(width), side(height)));
        }
        let column = array.fields.into_iter().next().map(|(_, column)| column);
        if let Some(Ok(counts)) = column.map(Column::into_integers) {
            *map = counts.into_iter().map(|n| u32::try_from(n).unwrap_or(u32::MAX)).collect();
        }
    }
    Ok(Some(comparison))
}

/// Names of the maps in `maps.npz`, in the order of the fields of [`Maps`].
const MAP_NAMES: [&str; 4] = ["real_on", "real_off", "simulated_on", "simulated_off"];

fn write(directory: &Path, comparison: &Comparison) -> Result<(), PipelineError> {
    let path = directory.join("comparison.json");
    let io = |source| PipelineError::Io { path: path.clone(), source };
    let text = serde_json::to_string_pretty(comparison).map_err(|e| io(e.into()))?;
    std::fs::write(&path, text + "\n").map_err(io)?;
    let Maps { size, real_on, real_off, simulated_on, simulated_off } = &comparison.maps;
    let shape = size.map_or([0, 0], |size| [u64::from(size.height), u64::from(size.width)]);
    let mut npz = NpzWriter::create(&directory.join("maps.npz")).map_err(SessionError::from)?;
    for (name, map) in MAP_NAMES.into_iter().zip([real_on, real_off, simulated_on, simulated_off]) {
        npz.add(name, &shape, map.iter().copied()).map_err(SessionError::from)?;
    }
    Ok(npz.finish().map_err(SessionError::from)?)
}
