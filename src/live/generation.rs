//! Events generated while the Pi's frames arrive, and served like those of a camera.
//!
//! A thread of its own generates the events from a queue of two frames. A frame older than the
//! bound is dropped and counted, so the latency of events is at most the bound and the work of two
//! frames.

use super::LiveError;
use evrig_core::event::Events;
use evrig_core::frame::{Luminance, luma};
use evrig_core::geometry::Size;
use evrig_core::keyword::UnknownKeyword;
use evrig_core::pi_camera::{FrameMetadata, PiFrame};
use evrig_core::raw10;
use evrig_core::time::{HostMonotonic, Span, Stamp};
use evrig_device::stream_server::{StreamServer, StreamServerError};
use evrig_format::aedat4::{Compression, StreamSpec};
use evrig_generate::input::{Colour, FramePreparation, FramePreparer, SourceFrame};
use evrig_generate::live::{FrameOutcome, LiveCounts, LiveGenerator};
use evrig_generate::{GenerateParameters, Generator, RowTimes, build};
use evrig_record::host_clock;
use serde::Serialize;
use std::net::SocketAddr;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

/// Frames that may wait for the generator.
const N_WAITING: usize = 2;

/// Which image of the Pi's frames the events are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PiLight {
    /// The raw mosaic.
    Raw,
    /// The processed colours, weighed to luma.
    Rgb,
}

/// What is generated, and how old it may be.
#[derive(Debug, Clone)]
pub struct GenerationSettings {
    /// The image.
    pub light: PiLight,
    /// Columns and rows of the frames.
    pub size: Size,
    /// What decides the events.
    pub parameters: GenerateParameters,
    /// Delay from row to row of the camera's frames; zero where it is not known.
    pub row_time: Span,
    /// What is done to an image first.
    pub preparation: FramePreparation,
    /// Frames older than this are left out.
    pub bound: Span,
    /// Where the events are served as AEDAT4.
    pub address: SocketAddr,
}

impl GenerationSettings {
    /// Camera rows behind each row of the prepared frame: two in one colour of a mosaic.
    fn rows_by(&self) -> u16 {
        let colour = self.preparation.colour;
        let is_halved = matches!(colour, Colour::Red | Colour::Green | Colour::Blue);
        if is_halved && self.light == PiLight::Raw { 2 } else { 1 }
    }
}

/// What became of the frames, from first to last.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct GenerationTally {
    /// What the generator did.
    #[serde(flatten)]
    pub generator: LiveCounts,
    /// Frames left out because two were waiting.
    pub n_dropped: u64,
    /// Frames without the wanted image, or with one that cannot be read.
    pub n_unreadable: u64,
    /// Why the first frame that could not be used could not.
    pub first_refusal: Option<String>,
}

struct GenerationJob {
    frame: Box<PiFrame>,
    /// When it was exposed, or reached this machine.
    born: Stamp<HostMonotonic>,
}

/// A generation under way.
#[derive(Debug)]
pub struct Generation {
    address: SocketAddr,
    jobs: Option<SyncSender<GenerationJob>>,
    worker: Option<JoinHandle<Result<GenerationTally, StreamServerError>>>,
    n_dropped: u64,
}

impl Generation {
    /// Serves events of frames to come.
    ///
    /// # Errors
    /// When the address is taken, or the parameters make no generator.
    pub fn start(settings: &GenerationSettings) -> Result<Self, LiveError> {
        if !settings.address.ip().is_loopback() {
            return Err(LiveError::NotLoopback { address: settings.address });
        }
        let generator = build(&settings.parameters, None)?;
        let by = settings.rows_by();
        let size = Size::new(settings.size.width / by, settings.size.height / by);
        let spec = StreamSpec::events(size, &format!("evrig {}", generator.name()));
        let server = StreamServer::bind(settings.address, &spec, Compression::Lz4)?;
        let address = server.address();
        let (jobs, queue) = sync_channel(N_WAITING);
        let worker = Worker::new(settings, generator, server);
        let failed = |source| StreamServerError::Listen { address: address.to_string(), source };
        let worker = std::thread::Builder::new()
            .name("generation".to_owned())
            .spawn(move || worker.run(&queue))
            .map_err(failed)?;
        Ok(Self { address, jobs: Some(jobs), worker: Some(worker), n_dropped: 0 })
    }

    /// Where the events are.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Hands a frame on that was born at an instant; never waits.
    pub fn offer(&mut self, frame: Box<PiFrame>, born: Stamp<HostMonotonic>) {
        let Some(jobs) = &self.jobs else { return };
        match jobs.try_send(GenerationJob { frame, born }) {
            Ok(()) => {}
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => self.n_dropped += 1,
        }
    }

    /// Works off what waits, and ends.
    ///
    /// # Errors
    /// When events could not be written.
    pub fn finish(mut self) -> Result<GenerationTally, LiveError> {
        self.jobs = None;
        let tally = match self.worker.take().map(JoinHandle::join) {
            Some(Ok(tally)) => tally?,
            // A worker that panicked has printed why; there is no tally to give.
            Some(Err(_)) | None => GenerationTally::default(),
        };
        Ok(GenerationTally { n_dropped: self.n_dropped, ..tally })
    }
}

/// The thread's side.
struct Worker {
    light: PiLight,
    preparer: FramePreparer,
    generator: LiveGenerator,
    server: StreamServer,
    tally: GenerationTally,
    /// From the camera's clock to the wall clock, µs: of the first frame, so that nothing steps.
    unix_from_sensor_us: Option<i64>,
}

impl Worker {
    fn new(
        settings: &GenerationSettings,
        generator: Box<dyn Generator>,
        server: StreamServer,
    ) -> Self {
        // A frame's time is its first row's. One colour of a mosaic has half the rows.
        let by = f64::from(settings.rows_by());
        let row_us = settings.row_time.as_nanos() as f64 * 1e-3 * by;
        let rows = RowTimes { row_us, at_row: 0.0 };
        let bound_us = settings.bound.as_micros();
        Self {
            light: settings.light,
            preparer: FramePreparer::new(settings.preparation),
            generator: LiveGenerator::new(generator, None, bound_us, rows),
            server,
            tally: GenerationTally::default(),
            unix_from_sensor_us: None,
        }
    }

    fn run(
        mut self,
        queue: &Receiver<GenerationJob>,
    ) -> Result<GenerationTally, StreamServerError> {
        let mut events = Events::new();
        for GenerationJob { frame, born } in queue {
            let Some(light) = self.prepare(&frame) else { continue };
            events.clear();
            let t_us = light.t_us;
            let mut now_us = || t_us + (host_clock::now() - born).as_micros();
            if let FrameOutcome::Refused(error) =
                self.generator.push(light, &mut now_us, &mut events)
            {
                self.tally.first_refusal.get_or_insert_with(|| error.to_string());
            }
            if !events.is_empty() {
                self.server.send_events(events.as_slice())?;
            }
        }
        events.clear();
        self.generator.finish(&mut events);
        if !events.is_empty() {
            self.server.send_events(events.as_slice())?;
        }
        Ok(GenerationTally { generator: self.generator.tally(), ..self.tally })
    }

    /// The frame's brightness at mid-exposure of its first row, on the wall clock.
    fn prepare(&mut self, frame: &PiFrame) -> Option<Luminance> {
        let metadata = &frame.metadata;
        let sensor_us = metadata.sensor_timestamp.as_micros();
        let wall_us = metadata.frame_wall_clock.unwrap_or(metadata.real_time).as_micros();
        let offset_us = *self.unix_from_sensor_us.get_or_insert(wall_us - sensor_us);
        let t_us = sensor_us + offset_us - metadata.exposure.as_micros() / 2;
        let made = match self.light {
            PiLight::Raw => self.raw(frame, t_us),
            PiLight::Rgb => self.rgb(frame, t_us),
        };
        match made {
            Ok(light) => Some(light),
            Err(because) => {
                self.tally.n_unreadable += 1;
                self.tally.first_refusal.get_or_insert(because);
                None
            }
        }
    }

    fn raw(&mut self, frame: &PiFrame, t_us: i64) -> Result<Luminance, String> {
        let (metadata, size) = (&frame.metadata, frame.metadata.size);
        let packed = frame.raw10.as_ref().ok_or("the camera sends no raw frames")?;
        let row = raw10::row_bytes(size.width).map_err(|error| error.to_string())?;
        let samples = raw10::unpack(packed, size, row).map_err(|error| error.to_string())?;
        let order = metadata.bayer.parse().map_err(|error: UnknownKeyword| error.to_string())?;
        let plain = samples.iter().map(|sample| f32::from(*sample)).collect();
        let image = SourceFrame {
            size,
            mosaic: Some((&samples, order)),
            black_dn: metadata.black_levels.map(f32::from),
            exposure_gain: Some(exposure_gain(metadata)),
        };
        Ok(self.preparer.prepare(t_us, &image, plain))
    }

    fn rgb(&mut self, frame: &PiFrame, t_us: i64) -> Result<Luminance, String> {
        let (metadata, size) = (&frame.metadata, frame.metadata.size);
        let rgb = frame.rgb.as_ref().ok_or("the camera sends no RGB frames")?;
        if rgb.len() != 3 * size.n_pixels() {
            return Err(format!("an RGB frame of {size} has {} bytes", rgb.len()));
        }
        let pixels = rgb.as_chunks::<3>().0.iter();
        let plain = pixels.map(|rgb| luma(rgb.map(f32::from))).collect();
        let image = SourceFrame {
            size,
            mosaic: None,
            black_dn: [0.0; 4],
            exposure_gain: Some(exposure_gain(metadata)),
        };
        Ok(self.preparer.prepare(t_us, &image, plain))
    }
}

fn exposure_gain(metadata: &FrameMetadata) -> f64 {
    metadata.exposure.as_secs_f64() * metadata.analogue_gain * metadata.digital_gain
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::units::Hertz;
    use evrig_generate::Preset;
    use evrig_pi::order::CaptureSettings;
    use evrig_pi::source::{FrameSource, Synthetic};

    const SIZE: Size = Size { width: 64, height: 32 };

    fn settings(bound: Span, preparation: FramePreparation) -> GenerationSettings {
        GenerationSettings {
            light: PiLight::Raw,
            size: SIZE,
            parameters: GenerateParameters::from_preset(Preset::Raw2Dvs346, 1),
            row_time: Span::ZERO,
            preparation,
            bound,
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
        }
    }

    fn camera(n_frames: u64) -> Synthetic {
        let mut camera = Synthetic::unpaced(n_frames);
        let settings = CaptureSettings {
            size: SIZE,
            frame_rate: Hertz(120.0),
            exposure: Span::from_micros(2_000),
            gain: 1.0,
            raw: true,
            rgb: false,
        };
        camera.configure(&settings).unwrap();
        camera
    }

    #[test]
    fn frames_older_than_the_bound_are_left_out_and_every_frame_has_a_fate() {
        let bound = Span::from_micros(60_000_000);
        let mut generation =
            Generation::start(&settings(bound, FramePreparation::default())).unwrap();
        let mut camera = camera(60);
        for i in 0..60 {
            let frame = camera.next().unwrap().unwrap();
            // Every third frame took ten minutes on its way here.
            let late = Span::from_micros(if i % 3 == 2 { 600_000_000 } else { 0 });
            generation.offer(Box::new(frame), host_clock::now() - late);
        }
        let tally = generation.finish().unwrap();
        let made = tally.generator;
        assert_eq!(made.n_seen + tally.n_dropped, 60, "{tally:?}");
        assert_eq!(made.n_taken + made.n_late + made.n_refused, made.n_seen, "{tally:?}");
        assert!(made.n_late <= 20 && made.n_refused == 0 && tally.n_unreadable == 0, "{tally:?}");
        assert!(made.n_taken >= 1 && made.worst_latency_us < 600_000_000, "{tally:?}");
    }

    #[test]
    fn no_more_frames_wait_than_may_and_those_dropped_are_counted() {
        let settings = settings(Span::from_micros(i64::MAX / 4), FramePreparation::default());
        let spec = StreamSpec::events(SIZE, "test");
        let server = StreamServer::bind(settings.address, &spec, Compression::Lz4).unwrap();
        let worker = Worker::new(&settings, build(&settings.parameters, None).unwrap(), server);
        let (jobs, queue) = sync_channel(N_WAITING);
        let address = settings.address;
        let mut generation = Generation { address, jobs: Some(jobs), worker: None, n_dropped: 0 };
        let mut camera = camera(20);
        // Nobody works yet: what does not fit is gone.
        for _ in 0..20 {
            generation.offer(Box::new(camera.next().unwrap().unwrap()), host_clock::now());
        }
        assert_eq!(generation.n_dropped, 20 - N_WAITING as u64);
        assert_eq!(generation.finish().unwrap().n_dropped, 20 - N_WAITING as u64);
        let tally = worker.run(&queue).unwrap();
        assert_eq!((tally.generator.n_seen, tally.generator.n_taken), (2, 2));
    }

    #[test]
    fn a_camera_that_adapts_its_exposure_makes_no_events_by_that() {
        let light = |gain: f64, k: i64| {
            let mut frame = camera(1).next().unwrap().unwrap();
            let scene = |i: usize| 100.0 + (i % 50) as f64;
            let value = |i: usize| (64.0 + gain * scene(i)).round() as u16;
            let samples: Vec<u16> = (0..SIZE.n_pixels()).map(value).collect();
            frame.raw10 = Some(raw10::pack(&samples, SIZE).unwrap());
            frame.metadata.exposure = Span::from_micros((2_000.0 * gain) as i64);
            frame.metadata.sensor_timestamp = Stamp::from_micros(1_000_000 + k * 8_333);
            frame
        };
        let n_events = |divide_exposure: bool| {
            let preparation = FramePreparation {
                divide_exposure,
                subtract_black: true,
                ..FramePreparation::default()
            };
            let far = Span::from_micros(i64::MAX / 4);
            let made = settings(far, preparation);
            let server = StreamServer::bind(
                made.address,
                &StreamSpec::events(SIZE, "test"),
                Compression::Lz4,
            );
            let generator = build(&made.parameters, None).unwrap();
            let mut worker = Worker::new(&made, generator, server.unwrap());
            for (k, gain) in [1.0, 1.0, 2.0, 2.0, 4.0, 1.0].into_iter().enumerate() {
                let light = worker.prepare(&light(gain, k as i64)).unwrap();
                let mut events = Events::new();
                let _ = worker.generator.push(light, &mut || 0, &mut events);
            }
            let tally = worker.generator.tally();
            assert_eq!((tally.n_taken, tally.n_refused), (6, 0));
            tally.n_events
        };
        assert!(n_events(false) > 4 * SIZE.n_pixels() as u64);
        assert!(n_events(true) < 100, "{}", n_events(true));
    }
}
