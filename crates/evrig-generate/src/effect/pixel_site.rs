//! What an effect gets to see of the pixel it acts on, and of its light.

use crate::random::{CounterRng, RandomSource};
use evrig_core::drive::{Drive, TimeGrid};
use evrig_core::effect_id::EffectId;
use evrig_core::geometry::Size;

/// What effects need to know of the recording beside the light.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RecordingContext {
    /// Starts of exposure of the event camera's own frames, µs, ascending.
    pub aps_starts_us: Vec<i64>,
    /// Times of the frames that the drive was made of, µs, ascending.
    pub frame_times_us: Vec<i64>,
}

/// One event pixel.
#[derive(Debug, Clone, Copy)]
pub struct PixelSite<'a> {
    /// Column.
    pub x: u16,
    /// Row.
    pub y: u16,
    /// Columns and rows of the event camera.
    pub size: Size,
    /// What white paper reads in the frames, digital units above black.
    pub white_dn: f64,
    /// The recording.
    pub context: &'a RecordingContext,
    pub(crate) source: RandomSource,
}

impl PixelSite<'_> {
    /// Row-major number of the pixel.
    #[must_use]
    pub fn number(&self) -> u32 {
        self.size.index(self.x, self.y) as u32
    }

    /// From the middle of the sensor to the middle of the pixel, pixels.
    #[must_use]
    pub fn from_middle(&self) -> [f64; 2] {
        let from = |p: u16, n: u16| f64::from(p) + 0.5 - 0.5 * f64::from(n);
        [from(self.x, self.size.width), from(self.y, self.size.height)]
    }

    /// The draws of an effect at this pixel, the same in every run of one seed.
    pub(crate) fn draws(&self, id: EffectId) -> CounterRng {
        self.source.draws(self.number(), stream_of(id))
    }
}

/// The number of an effect's own stream of draws: far above those that count intervals.
pub(crate) fn stream_of(id: EffectId) -> u64 {
    (1 << 63) | id as u64
}

/// The light of one pixel: natural logarithm of intensity over white at the instants of a grid.
pub struct SiteSignal<'a> {
    drive: &'a dyn Drive,
    place: [f64; 2],
    grid: TimeGrid,
    /// The signal as changed so far; `NaN` where nothing is known.
    pub values: &'a mut [f32],
    /// The drive's own signal before any change.
    own: Vec<f32>,
}

impl<'a> SiteSignal<'a> {
    /// The drive at a place, on the grid; none where nothing is known of it.
    pub(crate) fn sample(
        drive: &'a dyn Drive,
        place: [f64; 2],
        grid: TimeGrid,
        values: &'a mut [f32],
    ) -> Option<Self> {
        drive.sample(place, grid, values).then(|| Self {
            drive,
            place,
            grid,
            values,
            own: Vec::new(),
        })
    }

    /// Instants of the signal, on the drive's clock.
    #[must_use]
    pub const fn grid(&self) -> TimeGrid {
        self.grid
    }

    /// From one instant to the next, seconds.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        f64::from(self.grid.step_us) * 1e-6
    }

    /// Adds to the signal what `of` makes of the drive at `offsets` (pixels) from the place,
    /// less the drive at the place: `of` gets the signals at one instant in the order of
    /// `offsets`, the signal at the place, and the number of the instant.
    pub fn add_from_around<const N: usize>(
        &mut self,
        offsets: [[f64; 2]; N],
        of: impl Fn(&[f32; N], f32, usize) -> f32,
    ) {
        if self.own.is_empty() {
            self.own = vec![f32::NAN; self.grid.n];
            self.drive.sample(self.place, self.grid, &mut self.own);
        }
        let around = offsets.map(|[dx, dy]| {
            let mut values = vec![f32::NAN; self.grid.n];
            self.drive.sample([self.place[0] + dx, self.place[1] + dy], self.grid, &mut values);
            values
        });
        for (i, (value, own)) in self.values.iter_mut().zip(&self.own).enumerate() {
            let mut there = [0.0; N];
            for (there, signal) in there.iter_mut().zip(&around) {
                // Beyond the edge of what is known the light is taken as that of the place.
                *there = if signal[i].is_finite() { signal[i] } else { *own };
            }
            *value += of(&there, *own, i) - own;
        }
    }
}
