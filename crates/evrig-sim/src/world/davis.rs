//! The twin of the DAVIS346: events, frames and inertial samples of one world.

mod aps;
mod circuit;
mod comparator;
mod pixel;
mod pixel_input;
mod readout;
mod slab;
mod slab_scene;
mod spontaneous;
mod traits;

use super::imu::SimulatedImu;
use super::scene::World;
use aps::Aps;
use circuit::Circuit;
use evrig_core::event::{Event, Events};
use evrig_core::frame::Frame;
use evrig_core::imu::ImuSample;
use evrig_core::time::{Davis, Span};
use evrig_format::aedat4::Content;
use pixel::{EventRequest, PixelState, PixelTraits};
use rayon::prelude::*;
use readout::DavisReadout;
use slab::{SLAB, Slab};
use slab_scene::{PixelBuffers, SlabScene};
use spontaneous::Spontaneous;
use std::sync::Arc;

/// Time step of the twin.
pub const DAVIS_STEP: Span = SLAB;

/// The event camera in a world. It gives packet after packet; what they hold does not depend on how
/// they are asked for, nor on the number of threads.
#[derive(Debug)]
pub struct DavisTwin {
    world: Arc<World>,
    from: Span,
    n_slabs: u64,
    states: Vec<PixelState>,
    traits: Vec<PixelTraits>,
    /// With the pixels' own effects, and without them (outside the region).
    circuits: [Circuit; 2],
    spontaneous: Spontaneous,
    readout: DavisReadout,
    aps: Aps,
    imu: SimulatedImu,
}

/// Output of the camera for one time step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DavisPacket {
    /// In ascending time, microseconds of the DAVIS's stamps.
    pub events: Events,
    /// Frames whose exposure ended meanwhile; the stamp is the start of the exposure, as in AEDAT4.
    pub frames: Vec<Frame<Davis>>,
    /// Inertial samples, in ascending time.
    pub imu: Vec<ImuSample>,
}

impl DavisPacket {
    /// Its content by stream number: events, frames if the camera has them, inertial samples.
    pub fn contents(self, has_frames: bool) -> impl Iterator<Item = (u32, Content)> {
        let events = (!self.events.is_empty()).then_some((0, Content::Events(self.events)));
        let frames = self.frames.into_iter().filter(move |_| has_frames);
        let frames = frames.map(|frame| (1, Content::Frame(frame)));
        let behind = 1 + u32::from(has_frames);
        let imu = (!self.imu.is_empty()).then_some((behind, Content::Imu(self.imu)));
        events.into_iter().chain(frames).chain(imu)
    }
}

impl DavisTwin {
    /// The camera, switched on at world time `from` with every pixel at rest.
    #[must_use]
    pub fn new(world: Arc<World>, from: Span) -> Self {
        let effects = &world.description.effects;
        let threshold = world.description.davis.threshold;
        let size = world.davis.camera.size;
        let grid = [usize::from(size.width), usize::from(size.height)];
        let unaffected = Circuit::new(&super::effects::WorldEffects::default(), threshold);
        Self {
            from,
            n_slabs: 0,
            states: vec![PixelState::default(); size.n_pixels()],
            traits: traits::all(&world.description, size, world.seed),
            circuits: [Circuit::new(effects, threshold), unaffected],
            spontaneous: Spontaneous::new(effects, world.seed),
            readout: DavisReadout::new(effects, grid, world.seed),
            aps: Aps::new(&world, from),
            imu: SimulatedImu::new(&world, from),
            world,
        }
    }

    /// World time up to which events were simulated.
    #[must_use]
    pub fn position(&self) -> Span {
        self.from + Span::from_nanos(SLAB.as_nanos() * self.n_slabs as i64)
    }

    /// The next ten milliseconds. A stamp that may still be overtaken by an earlier one (a full
    /// bus, latency, jitter) comes with a later packet.
    pub fn next_packet(&mut self) -> DavisPacket {
        let start = self.position();
        let noise_rate_hz = self.circuits[0].noise_rate_hz();
        let slab = Slab::new(&self.world, self.n_slabs, start, noise_rate_hz);
        let requests = self.requests(&slab);
        self.n_slabs += 1;
        let end = self.position();
        let events = self.readout.run(requests, end.as_nanos());
        let frames = self.aps.frames_until(&self.world, end);
        let imu = self.imu.samples_until(&self.world, end);
        let width = u32::from(self.world.davis.camera.size.width);
        let clocks = &self.world.clocks;
        let stamped = events.into_iter().map(|EventRequest { at_ns, pixel, on }| Event {
            t: clocks.davis(Span::from_nanos(at_ns)).as_micros(),
            x: (pixel % width) as u16,
            y: (pixel / width) as u16,
            on,
        });
        DavisPacket { events: stamped.collect(), frames, imu }
    }

    /// All packets that end at or before `until`, as one.
    pub fn advance_to(&mut self, until: Span) -> DavisPacket {
        let mut all = DavisPacket::default();
        while self.position() + SLAB <= until {
            let packet = self.next_packet();
            all.events.extend_from_slice(packet.events.as_slice());
            all.frames.extend(packet.frames);
            all.imu.extend(packet.imu);
        }
        all
    }

    /// What all pixels ask for in a slab.
    fn requests(&mut self, slab: &Slab) -> Vec<EventRequest> {
        let world = &self.world;
        let size = world.davis.camera.size;
        let width = usize::from(size.width);
        let reach = self.spontaneous.reach_s(usize::from(size.height));
        let exposures = self.aps.exposures_within(
            world,
            slab.start - Span::from_secs_f64(reach[1]),
            slab.start + SLAB - Span::from_secs_f64(reach[0]),
        );
        let white = world.target.white() as f32;
        let lamps = world.lamps();
        let scene =
            SlabScene { view: &world.davis, light: &lamps.light, slab, seed: world.seed, white };
        let (traits, circuits, spontaneous) = (&self.traits, &self.circuits, &self.spontaneous);
        let rows = self.states.par_chunks_mut(width).enumerate().map_init(
            PixelBuffers::default,
            |scratch, (row, states)| {
                let mut requests = Vec::new();
                for (column, state) in states.iter_mut().enumerate() {
                    let pixel = row * width + column;
                    let own = &traits[pixel];
                    if !spontaneous.is_silent() {
                        let forced = &mut scratch.forced;
                        let affected = own.is_affected;
                        spontaneous.events(pixel, row, affected, slab, &exposures, forced);
                    }
                    let circuit = &circuits[usize::from(!own.is_affected)];
                    state.run(pixel, own, circuit, &scene, scratch, &mut requests);
                }
                requests
            },
        );
        rows.collect::<Vec<_>>().concat()
    }
}
