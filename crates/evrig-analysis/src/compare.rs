//! Real events against simulated events, on one pixel grid and in one time window.
//!
//! [`compare`] computes measures with errors ([`Measure`]), curves and maps. Each stream is read
//! once into a profile of counts and intervals. Every measure is a function of the two profiles and
//! has a file of its own with its definition, source and limitations.
//!
//! # Errors of the measures
//! Events are not independent: one edge triggers many pixels, a noisy pixel fires repeatedly.
//! Errors therefore come from a bootstrap over **clusters**, real and simulated events of a cluster
//! as a pair:
//! - *time blocks*, 40 equal parts of the window, all pixels of each: count_ratio, polarity_delta,
//!   spatial_emd, temporal_emd, the likeness of event images. Valid when blocks are nearly
//!   independent.
//! - *tiles*, squares of pixels with their whole history: active_pixel_ratio,
//!   spatial_entropy_ratio, interval_tv, interval_emd, interval_ks, the interval fits, the
//!   correlation and the rate-map error. Valid when tiles are nearly independent.
//!
//! # Unknown values
//! A measure without data (no events, one event per pixel) is unknown: NaN here, `null` in JSON,
//! with the reason in `unknown_because`. With a single cluster only the error is unknown.

mod active_pixel_ratio;
mod bootstrap;
mod contrast_correlation;
mod count_ratio;
mod event_image;
mod interval_bins;
mod interval_emd;
mod interval_fit;
mod interval_ks;
mod interval_tv;
mod measure;
mod polarity_delta;
mod profile;
mod rate;
mod rate_map;
mod sinkhorn;
mod spanning_tree;
mod spatial_emd;
mod spatial_entropy_ratio;
mod temporal_emd;
mod transport;

pub use contrast_correlation::{ContrastCorrelation, FrameChanges, FrameCorrelation};
pub use interval_fit::{IntervalCurve, IntervalDensity, IntervalFit};
pub use measure::{Cluster, IdealValue, Measure, MeasureId};
pub use rate::{RateBand, RateCurve};
pub use rate_map::{Maps, RateMapError};

use bootstrap::Bootstrap;
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use profile::{ClusterLayout, StreamProfile};
use serde::{Deserialize, Serialize};

/// Schema of the result; a change of keys changes the number.
pub const SCHEMA: &str = "evrig.comparison/1";

/// What is compared, and with how many replicates.
#[derive(Clone, Copy)]
pub struct Setup<'a> {
    /// Pixel grid of both streams.
    pub size: Size,
    /// Microseconds of the streams' clock, start inclusive, end exclusive.
    pub window: [i64; 2],
    /// Pixels of the region, row-major, one entry per pixel; all when absent.
    pub region: Option<&'a [bool]>,
    /// Seed of the resampling: the same seed gives the same errors on any number of threads.
    pub seed: u64,
    /// Number of bootstrap replicates, such as 400; 0 gives unknown errors.
    pub n_bootstrap: usize,
    /// Change of log intensity between frames, for the correlation with signed counts.
    pub frames: Option<FrameChanges<'a>>,
}

/// The result without its maps: what goes into JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// [`SCHEMA`].
    pub schema: String,
    /// Microseconds, start inclusive, end exclusive.
    pub window_us: [i64; 2],
    /// Pixels of the region.
    pub n_pixels: u64,
    /// Real events in window and region.
    pub n_real: u64,
    /// Simulated events in window and region.
    pub n_simulated: u64,
    /// Seed of the errors.
    pub seed: u64,
    /// Bootstrap replicates behind the errors.
    pub n_bootstrap: u64,
    /// The measures in the order of [`MeasureId`].
    pub measures: Vec<Measure>,
    /// Curves.
    pub curves: Curves,
    /// Event maps, kept out of the JSON.
    #[serde(skip)]
    pub maps: Maps,
}

/// Curves of a comparison, small enough for JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Curves {
    /// Densities of the per-pixel intervals, with fitted laws.
    pub intervals: IntervalCurve,
    /// Events per second over time, by polarity.
    pub rate: RateCurve,
    /// Difference of the two rate maps in one number.
    pub rate_map: RateMapError,
    /// Signed counts against the change of log intensity; absent without frames.
    pub contrast_correlation: Option<ContrastCorrelation>,
}

impl Comparison {
    /// The measure with this id; every comparison has each of them.
    #[must_use]
    pub fn measure(&self, id: MeasureId) -> Option<&Measure> {
        self.measures.iter().find(|measure| measure.id == id)
    }
}

/// One of the two streams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComparedStream {
    /// The camera's events.
    Real,
    /// The generator's events.
    Simulated,
}

impl std::fmt::Display for ComparedStream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Real => "real",
            Self::Simulated => "simulated",
        })
    }
}

/// Why two streams cannot be compared.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum CompareError {
    /// Time must not fall.
    #[error(
        "{stream} event {index} at {t_us} us is earlier than the one before it ({previous_us} us); \
         sort the stream by time"
    )]
    TimeNotAscending {
        /// The stream.
        stream: ComparedStream,
        /// Its number in the stream, from 0.
        index: usize,
        /// Its time.
        t_us: i64,
        /// Time of the event before it.
        previous_us: i64,
    },
    /// Events lie on the grid.
    #[error(
        "{stream} event {index} is at pixel ({x}, {y}), outside the grid of {size}; give both \
         streams' own grid"
    )]
    OutsideGrid {
        /// The stream.
        stream: ComparedStream,
        /// Its number in the stream, from 0.
        index: usize,
        /// Pixel column.
        x: u16,
        /// Pixel row.
        y: u16,
        /// The grid.
        size: Size,
    },
    /// The window must have a length that can be counted.
    #[error(
        "the window [{start_us}, {end_us}) us is empty or too long; its end must lie after its \
         start by less than 290,000 years"
    )]
    BadWindow {
        /// Start.
        start_us: i64,
        /// End.
        end_us: i64,
    },
    /// The grid or the region has no pixel.
    #[error("no pixel to compare: the grid is {size} and the region holds none of it")]
    NoPixels {
        /// The grid.
        size: Size,
    },
    /// A region has one entry for each pixel.
    #[error("the region has {found} entries, expected {expected}, one for each pixel of {size}")]
    RegionSize {
        /// Entries given.
        found: usize,
        /// Pixels of the grid.
        expected: usize,
        /// The grid.
        size: Size,
    },
    /// Frame times ascend.
    #[error("frame {index} at {t_us} us is not later than the frame before it ({previous_us} us)")]
    FramesNotAscending {
        /// Number of the frame, from 0.
        index: usize,
        /// Its time.
        t_us: i64,
        /// Time of the frame before it.
        previous_us: i64,
    },
}

/// Compares a simulated stream with the real one. Events outside the window or the region are
/// left out; both streams may be longer than the window.
///
/// # Errors
/// [`CompareError`]: a stream out of order or off the grid, an empty window or region,
/// frames out of order. Empty streams are no error: they give unknown measures.
pub fn compare(
    real: EventSlice<'_>,
    simulated: EventSlice<'_>,
    setup: &Setup<'_>,
) -> Result<Comparison, CompareError> {
    check_setup(setup)?;
    check_stream(real, setup.size, ComparedStream::Real)?;
    check_stream(simulated, setup.size, ComparedStream::Simulated)?;
    let [start, end] = setup.window;
    let (real, simulated) = (real.between(start, end), simulated.between(start, end));
    let layout = ClusterLayout::new(setup.size, setup.window, setup.region)
        .ok_or(CompareError::NoPixels { size: setup.size })?;
    let (real_profile, simulated_profile) =
        rayon::join(|| StreamProfile::of(real, &layout), || StreamProfile::of(simulated, &layout));
    let pair = ProfilePair {
        layout: &layout,
        real: &real_profile,
        simulated: &simulated_profile,
        bootstrap: Bootstrap::new(setup.seed, setup.n_bootstrap),
    };
    let [ssim, psnr] = event_image::measures(&pair, real, simulated);
    let measures = vec![
        count_ratio::measure(&pair),
        polarity_delta::measure(&pair),
        active_pixel_ratio::measure(&pair),
        spatial_entropy_ratio::measure(&pair),
        spatial_emd::measure(&pair, real, simulated),
        interval_tv::measure(&pair),
        interval_emd::measure(&pair),
        interval_ks::measure(&pair),
        temporal_emd::measure(&pair, real, simulated),
        ssim,
        psnr,
    ];
    let curves = Curves {
        intervals: interval_fit::curve(&pair),
        rate: rate::curve(&pair),
        rate_map: rate_map::error(&pair),
        contrast_correlation: setup
            .frames
            .map(|frames| contrast_correlation::correlate(&pair, real, simulated, frames)),
    };
    Ok(Comparison {
        schema: SCHEMA.to_owned(),
        window_us: setup.window,
        n_pixels: layout.n_region_pixels(),
        n_real: real_profile.n,
        n_simulated: simulated_profile.n,
        seed: setup.seed,
        n_bootstrap: setup.n_bootstrap as u64,
        measures,
        curves,
        maps: rate_map::maps(setup.size, real_profile, simulated_profile),
    })
}

/// Profiles of both streams with the bootstrap for their errors.
struct ProfilePair<'a> {
    layout: &'a ClusterLayout,
    real: &'a StreamProfile,
    simulated: &'a StreamProfile,
    bootstrap: Bootstrap,
}

impl ProfilePair<'_> {
    /// Why a measure that needs events of both streams is unknown, if so.
    fn missing_events(&self) -> Option<&'static str> {
        if self.real.n == 0 {
            Some("there are no real events")
        } else if self.simulated.n == 0 {
            Some("there are no simulated events")
        } else {
            None
        }
    }
}

fn check_setup(setup: &Setup<'_>) -> Result<(), CompareError> {
    let [start_us, end_us] = setup.window;
    // Bin arithmetic multiplies the window's length by the number of bins.
    if end_us.checked_sub(start_us).is_none_or(|width| width <= 0 || width > i64::MAX / 1024) {
        return Err(CompareError::BadWindow { start_us, end_us });
    }
    let expected = setup.size.n_pixels();
    if let Some(found) = setup.region.map(<[bool]>::len).filter(|&found| found != expected) {
        return Err(CompareError::RegionSize { found, expected, size: setup.size });
    }
    let times = setup.frames.map_or(&[][..], |frames| frames.times_us);
    match times.windows(2).position(|pair| pair[1] <= pair[0]) {
        None => Ok(()),
        Some(i) => Err(CompareError::FramesNotAscending {
            index: i + 1,
            t_us: times[i + 1],
            previous_us: times[i],
        }),
    }
}

fn check_stream(
    events: EventSlice<'_>,
    size: Size,
    stream: ComparedStream,
) -> Result<(), CompareError> {
    if let Some(index) = events.first_disorder() {
        let (t_us, previous_us) = (events.t[index], events.t[index - 1]);
        return Err(CompareError::TimeNotAscending { stream, index, t_us, previous_us });
    }
    match events.first_outside(size) {
        None => Ok(()),
        Some(index) => {
            let (x, y) = (events.x[index], events.y[index]);
            Err(CompareError::OutsideGrid { stream, index, x, y, size })
        }
    }
}

#[cfg(test)]
mod coverage;
#[cfg(test)]
mod tests;
