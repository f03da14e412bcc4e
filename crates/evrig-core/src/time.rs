//! Time: each clock is a type.
//!
//! A [`Stamp`] belongs to one clock; stamps of two clocks neither subtract nor
//! compare. Only a [`ClockMap`] converts from one clock to another, and it is
//! named `to_from`: `unix_from_sensor`. Time is integral nanoseconds; event
//! columns hold integral microseconds of their stream's clock.

use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::fmt;
use std::marker::PhantomData;
use std::ops::{Add, Neg, Sub};

/// A clock, known by its type alone.
pub trait Clock: Copy + Eq + fmt::Debug + Send + Sync + 'static {
    /// The clock's name in manifests and messages.
    const NAME: &'static str;
}

macro_rules! clock {
    ($(#[$doc:meta])* $name:ident, $text:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {}
        impl Clock for $name {
            const NAME: &'static str = $text;
        }
    };
}

clock!(
    /// Unix time of the host, `CLOCK_REALTIME`; it may step.
    Unix,
    "unix"
);
clock!(
    /// The host's monotonic clock; its zero is arbitrary.
    HostMonotonic,
    "host-monotonic"
);
clock!(
    /// The DAVIS's stamps as its recorder writes them (Unix microseconds taken at its reset, then
    /// its own crystal).
    Davis,
    "davis"
);
clock!(
    /// The Pi's SensorTimestamp: nanoseconds since boot.
    PiSensor,
    "pi-sensor"
);

/// A duration in nanoseconds, independent of a clock.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct Span(i64);

impl Span {
    /// Zero.
    pub const ZERO: Self = Self(0);

    /// A span of whole nanoseconds.
    #[must_use]
    pub const fn from_nanos(ns: i64) -> Self {
        Self(ns)
    }

    /// A span of whole microseconds; saturates at the ends of the range (292 years).
    #[must_use]
    pub const fn from_micros(us: i64) -> Self {
        Self(us.saturating_mul(1_000))
    }

    /// A span of seconds, rounded to the nanosecond; saturates, and NaN is zero.
    #[must_use]
    pub fn from_secs_f64(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as i64)
    }

    /// Whole nanoseconds.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Whole microseconds, rounded towards minus infinity.
    #[must_use]
    pub const fn as_micros(self) -> i64 {
        self.0.div_euclid(1_000)
    }

    /// Seconds, for ratios and plots.
    #[must_use]
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Sub for Span {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

impl Neg for Span {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.saturating_neg())
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ns = self.0.unsigned_abs();
        if ns >= 1_000_000_000 {
            write!(f, "{:.3} s", self.as_secs_f64())
        } else if ns >= 1_000_000 {
            write!(f, "{:.3} ms", self.0 as f64 * 1e-6)
        } else {
            write!(f, "{:.3} us", self.0 as f64 * 1e-3)
        }
    }
}

/// An instant on clock `C`, in nanoseconds since that clock's zero.
#[derive(Serialize, Deserialize)]
#[serde(transparent, bound = "")]
pub struct Stamp<C> {
    ns: i64,
    #[serde(skip)]
    clock: PhantomData<C>,
}

impl<C> Stamp<C> {
    /// An instant from whole nanoseconds of the clock.
    #[must_use]
    pub const fn from_nanos(ns: i64) -> Self {
        Self { ns, clock: PhantomData }
    }

    /// An instant from whole microseconds of the clock; saturates at the ends of the range.
    #[must_use]
    pub const fn from_micros(us: i64) -> Self {
        Self::from_nanos(us.saturating_mul(1_000))
    }

    /// Nanoseconds since the clock's zero.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.ns
    }

    /// Microseconds since the clock's zero, rounded towards minus infinity.
    #[must_use]
    pub const fn as_micros(self) -> i64 {
        self.ns.div_euclid(1_000)
    }
}

// Derives would demand the same of the clock, which has no values.
impl<C> Clone for Stamp<C> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<C> Copy for Stamp<C> {}
impl<C> PartialEq for Stamp<C> {
    fn eq(&self, other: &Self) -> bool {
        self.ns == other.ns
    }
}
impl<C> Eq for Stamp<C> {}
impl<C> PartialOrd for Stamp<C> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl<C> Ord for Stamp<C> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.ns.cmp(&other.ns)
    }
}
impl<C: Clock> fmt::Debug for Stamp<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ns {}", self.ns, C::NAME)
    }
}
impl<C> Sub for Stamp<C> {
    type Output = Span;
    fn sub(self, earlier: Self) -> Span {
        Span(self.ns.saturating_sub(earlier.ns))
    }
}
impl<C> Add<Span> for Stamp<C> {
    type Output = Self;
    fn add(self, span: Span) -> Self {
        Self::from_nanos(self.ns.saturating_add(span.0))
    }
}
impl<C> Sub<Span> for Stamp<C> {
    type Output = Self;
    fn sub(self, span: Span) -> Self {
        Self::from_nanos(self.ns.saturating_sub(span.0))
    }
}

/// The fitted map from clock `B` to clock `A`: an anchor on both and the relative rate.
///
/// `a = a0 + (b - b0) * (1 + skew)`. The skew is stored without the one so that
/// parts per billion survive in a double; the anchor keeps the products small.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct ClockMap<A: Clock, B: Clock> {
    /// The anchor as clock `A` shows it.
    pub a0: Stamp<A>,
    /// The same instant as clock `B` shows it.
    pub b0: Stamp<B>,
    /// Relative rate of `A` against `B` minus one (1e-6 is one ppm).
    pub skew: f64,
}

impl<A: Clock, B: Clock> ClockMap<A, B> {
    /// Two clocks of equal rate that differ by a constant.
    #[must_use]
    pub fn from_anchor(a0: Stamp<A>, b0: Stamp<B>) -> Self {
        Self { a0, b0, skew: 0.0 }
    }

    /// The instant `b` as clock `A` shows it, rounded to the nanosecond.
    #[must_use]
    pub fn map(&self, b: Stamp<B>) -> Stamp<A> {
        let since = b - self.b0;
        let correction = (since.as_nanos() as f64 * self.skew).round() as i64;
        self.a0 + since + Span::from_nanos(correction)
    }

    /// The inverse map.
    #[must_use]
    pub fn inverse(&self) -> ClockMap<B, A> {
        ClockMap { a0: self.b0, b0: self.a0, skew: -self.skew / (1.0 + self.skew) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_stamp_reads_back_in_either_unit_even_before_zero() {
        assert_eq!(Stamp::<Unix>::from_micros(-1).as_nanos(), -1_000);
        assert_eq!(Stamp::<Unix>::from_nanos(-1).as_micros(), -1);
        assert_eq!((Stamp::<Davis>::from_micros(5) - Stamp::from_micros(2)).as_micros(), 3);
    }

    #[test]
    fn a_stamp_is_a_bare_number_in_json() {
        let json = serde_json::to_string(&Stamp::<Unix>::from_nanos(42)).unwrap();
        assert_eq!(json, "42");
        assert_eq!(serde_json::from_str::<Stamp<Unix>>("42").unwrap().as_nanos(), 42);
    }

    #[test]
    fn one_ppm_of_skew_is_a_microsecond_a_second() {
        let map = ClockMap::<Unix, PiSensor> {
            a0: Stamp::from_nanos(1_000),
            b0: Stamp::from_nanos(0),
            skew: 1e-6,
        };
        assert_eq!(map.map(Stamp::from_nanos(1_000_000_000)).as_nanos(), 1_000_002_000);
    }

    proptest! {
        #[test]
        fn there_and_back_is_the_same_instant_within_a_nanosecond(
            b in -1_000_000_000_000_i64..1_000_000_000_000, skew in -1e-4..1e-4_f64,
        ) {
            let map = ClockMap::<Unix, PiSensor> {
                a0: Stamp::from_nanos(1_700_000_000_000_000_000),
                b0: Stamp::from_nanos(12_345),
                skew,
            };
            let back = map.inverse().map(map.map(Stamp::from_nanos(b)));
            prop_assert!((back.as_nanos() - b).abs() <= 1);
        }
    }
}
