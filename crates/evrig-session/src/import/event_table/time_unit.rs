//! The unit of a column of times: stated by a heading, or the only one that fits the data.

use evrig_format::npy::Column;
use std::fmt;
use std::str::FromStr;

/// A unit of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeUnit {
    /// Seconds.
    Seconds,
    /// Milliseconds.
    Milliseconds,
    /// Microseconds.
    Microseconds,
    /// Nanoseconds.
    Nanoseconds,
}

/// All units, the coarsest first.
pub(crate) const TIME_UNITS: [TimeUnit; 4] =
    [TimeUnit::Seconds, TimeUnit::Milliseconds, TimeUnit::Microseconds, TimeUnit::Nanoseconds];

impl TimeUnit {
    /// Microseconds in one.
    pub(crate) const fn micros(self) -> f64 {
        match self {
            Self::Seconds => 1e6,
            Self::Milliseconds => 1e3,
            Self::Microseconds => 1.0,
            Self::Nanoseconds => 1e-3,
        }
    }

    /// Its abbreviation.
    pub(crate) const fn symbol(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Milliseconds => "ms",
            Self::Microseconds => "us",
            Self::Nanoseconds => "ns",
        }
    }

    /// The unit that a word names, as in `t_us`, `time [ns]` or `seconds`.
    pub(crate) fn of_word(word: &str) -> Option<Self> {
        match word {
            "s" | "sec" | "secs" | "second" | "seconds" => Some(Self::Seconds),
            "ms" | "msec" | "millisecond" | "milliseconds" | "millis" => Some(Self::Milliseconds),
            "us" | "usec" | "microsecond" | "microseconds" | "micros" | "µs" | "μs" => {
                Some(Self::Microseconds)
            }
            "ns" | "nsec" | "nanosecond" | "nanoseconds" | "nanos" => Some(Self::Nanoseconds),
            _ => None,
        }
    }

    /// A whole number of this unit in µs; none where it does not fit.
    fn whole_to_micros(self, value: i64) -> Option<i64> {
        match self {
            Self::Nanoseconds => Some(value.div_euclid(1_000)),
            unit => value.checked_mul(unit.micros() as i64),
        }
    }

    /// A number of this unit in µs, rounded; none where it does not fit.
    fn to_micros(self, value: f64) -> Option<i64> {
        let micros = value * self.micros();
        (micros.is_finite() && micros.abs() < 9.2e18).then(|| micros.round() as i64)
    }
}

impl fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

impl FromStr for TimeUnit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unit = TIME_UNITS.into_iter().find(|unit| unit.symbol() == text);
        unit.ok_or_else(|| "expected s, ms, us or ns".to_owned())
    }
}

/// Times of a column in µs.
///
/// # Errors
/// The index of the first value that does not fit.
pub(crate) fn to_micros(column: Column, unit: TimeUnit) -> Result<Vec<i64>, usize> {
    let convert = |(i, micros): (usize, Option<i64>)| micros.ok_or(i);
    match column {
        Column::Float(values) => {
            let micros = values.into_iter().map(|value| unit.to_micros(value));
            micros.enumerate().map(convert).collect()
        }
        whole if unit == TimeUnit::Microseconds => whole.into_integers(),
        whole => {
            let micros = whole.into_integers()?.into_iter().map(|t| unit.whole_to_micros(t));
            micros.enumerate().map(convert).collect()
        }
    }
}

/// The only unit that the words of a text name beside a word for time, as `# time in s`.
pub(crate) fn stated_in(text: &str) -> Option<TimeUnit> {
    let lower = text.to_lowercase().replace("'s", "");
    if lower.contains("timecode format v2") {
        return Some(TimeUnit::Milliseconds);
    }
    let is_part = |c: char| c.is_alphanumeric() || c == 'µ' || c == 'μ';
    let words: Vec<&str> = lower.split(|c| !is_part(c)).filter(|word| !word.is_empty()).collect();
    let is_time = |word: &&str| {
        matches!(*word, "t" | "ts") || word.starts_with("time") || word.starts_with("stamp")
    };
    if !words.iter().any(is_time) {
        return None;
    }
    let mut units = words.iter().filter_map(|word| TimeUnit::of_word(word));
    let first = units.next()?;
    units.all(|unit| unit == first).then_some(first)
}

/// What is known of a column of event times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TimeEvidence {
    /// Number of events.
    pub(super) n: usize,
    /// Earliest and latest, as stored.
    pub(super) range: [f64; 2],
    /// Smallest power of ten, 1, 0.001 or less, of which all values are multiples.
    pub(super) resolution: StampResolution,
    /// Pixels of the grid.
    pub(super) n_pixels: f64,
    /// First and last frame, µs, where the events come with frames.
    pub(super) frames_us: Option<[i64; 2]>,
}

/// How finely a column is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StampResolution {
    /// Finer than a thousandth.
    Finer,
    /// Thousandths.
    Thousandths,
    /// Whole numbers.
    Whole,
}

/// Fewer events give no rate.
const MIN_EVENTS_FOR_RATE: usize = 20;

/// Events per second of a pixel, on average over the sensor, that no camera delivers: refractory
/// periods are some 0.1 ms, and a readout of 12 Mev/s gives 130 per pixel of a DAVIS346.
const MAX_RATE_PER_PIXEL: f64 = 2_000.0;

/// A day, µs: no recording is longer.
const MAX_DURATION_US: f64 = 86_400e6;

/// Rates per pixel that are ordinary, and one that is doubtful where another unit has an
/// ordinary one: the noise of a resting pixel is about 0.1 events per second.
const ORDINARY_RATES: [f64; 2] = [0.1, 100.0];
const DOUBTFUL_RATE: f64 = 0.05;

/// Share of the frames' time that the events cover where another unit covers most of it.
const MIN_COVERAGE: f64 = 0.005;
const MIN_OWN_COVERAGE: f64 = 0.5;

impl TimeEvidence {
    fn span_us(&self, unit: TimeUnit) -> f64 {
        (self.range[1] - self.range[0]) * unit.micros()
    }

    fn rate_per_pixel(&self, unit: TimeUnit) -> f64 {
        self.n as f64 / (self.span_us(unit) * 1e-6) / self.n_pixels.max(1.0)
    }

    /// Whether the values are times since 1970, between 2001 and 2100.
    fn is_unix(&self, unit: TimeUnit) -> bool {
        let seconds = self.range.map(|value| value * unit.micros() * 1e-6);
        seconds.iter().all(|seconds| (1e9..4.1e9).contains(seconds))
    }

    fn is_possible(&self, unit: TimeUnit) -> bool {
        let is_divided_so = match unit {
            TimeUnit::Seconds => self.resolution != StampResolution::Whole,
            TimeUnit::Milliseconds => self.resolution != StampResolution::Finer,
            TimeUnit::Microseconds => self.resolution != StampResolution::Finer,
            TimeUnit::Nanoseconds => self.resolution == StampResolution::Whole,
        };
        let has_rate = self.n >= MIN_EVENTS_FOR_RATE;
        is_divided_so
            && self.span_us(unit) <= MAX_DURATION_US
            && !(has_rate && self.rate_per_pixel(unit) > MAX_RATE_PER_PIXEL)
    }

    /// Share of the events' time inside the frames' time, and of the frames' time inside theirs.
    fn overlap(&self, unit: TimeUnit) -> [f64; 2] {
        let Some([first, last]) = self.frames_us else { return [1.0; 2] };
        let [begin, end] = self.range.map(|value| value * unit.micros());
        let [first, last] = [first as f64, last as f64];
        let shared = end.min(last) - begin.max(first);
        [shared / (end - begin).max(1.0), shared / (last - first).max(1.0)]
    }

    fn overlaps(&self, unit: TimeUnit) -> bool {
        self.overlap(unit)[0] > 0.01
    }

    /// Decides the unit. `stated` is what the file states, and where.
    ///
    /// # Errors
    /// When no unit fits or two do, with the reason.
    pub(super) fn decide(
        &self,
        stated: Option<(TimeUnit, String)>,
    ) -> Result<(TimeUnit, String), String> {
        if let Some((unit, place)) = stated {
            return Ok((unit, format!("times are in {unit} ({place})")));
        }
        if self.range[0] == self.range[1] {
            return Ok((TimeUnit::Microseconds, "times are in us (all are the same)".into()));
        }
        let possible: Vec<TimeUnit> =
            TIME_UNITS.into_iter().filter(|unit| self.is_possible(*unit)).collect();
        if let Some(unit) = possible.iter().find(|unit| self.is_unix(**unit)) {
            return Ok((*unit, format!("times are in {unit} since 1970, by their size")));
        }
        let beside_frames: Vec<TimeUnit> =
            possible.iter().copied().filter(|unit| self.overlaps(*unit)).collect();
        let fitting = if beside_frames.is_empty() { &possible } else { &beside_frames };
        let why = |unit: TimeUnit| {
            let span = seconds(self.span_us(unit));
            format!("times are in {unit}: they span {span}, {} events", self.n)
        };
        match fitting.as_slice() {
            [] => Err(self.describe("fit no unit of time")),
            [only] => Ok((*only, why(*only))),
            several if several.contains(&TimeUnit::Microseconds) && !self.is_fractional() => {
                let other = several.iter().find(|unit| self.is_better(**unit));
                match other {
                    Some(unit) => Err(self.describe(&format!("could be in us or {unit}"))),
                    None => Ok((TimeUnit::Microseconds, why(TimeUnit::Microseconds))),
                }
            }
            several => {
                let symbols: Vec<&str> = several.iter().map(|unit| unit.symbol()).collect();
                Err(self.describe(&format!("could be in {}", symbols.join(" or "))))
            }
        }
    }

    fn is_fractional(&self) -> bool {
        self.resolution != StampResolution::Whole
    }

    /// Whether another unit than µs explains the data much better.
    fn is_better(&self, unit: TimeUnit) -> bool {
        let micros = TimeUnit::Microseconds;
        if unit == micros || self.n < MIN_EVENTS_FOR_RATE {
            return false;
        }
        if self.frames_us.is_some() {
            let [inside, covered] = self.overlap(unit);
            return self.overlap(micros)[1] < MIN_COVERAGE
                && inside > MIN_OWN_COVERAGE
                && covered > MIN_OWN_COVERAGE;
        }
        let is_ordinary =
            (ORDINARY_RATES[0]..ORDINARY_RATES[1]).contains(&self.rate_per_pixel(unit));
        let is_doubtful = self.rate_per_pixel(micros) < DOUBTFUL_RATE;
        is_ordinary && is_doubtful
    }

    fn describe(&self, what: &str) -> String {
        let [first, last] = self.range;
        format!(
            "the times {first} to {last} of {} events {what}; state it with --time-unit s, ms, us \
             or ns",
            self.n
        )
    }
}

/// A time span in words.
pub(crate) fn seconds(micros: f64) -> String {
    match micros.abs() {
        us if us < 1e3 => format!("{micros:.0} us"),
        us if us < 1e6 => format!("{:.3} ms", micros * 1e-3),
        _ => format!("{:.3} s", micros * 1e-6),
    }
}
