//! The frame files of the published Raw2Event recorder: `metadata_*.dat`, `raw_frames_*.dat`.
//!
//! Metadata are packed records of a little-endian f64, the SensorTimestamp, and 30 bytes of
//! text, the wall clock, padded with zeros: `2025-06-01 17:04:06.123456` in local time,
//! without the fraction when it is zero. Raw frames are u16 little-endian Bayer samples
//! (RGGB), of 10 bits, right-justified (Pi 4) or left-justified (Pi 5).

use chrono::{NaiveDateTime, TimeZone};

/// Bytes of one metadata record.
pub const RECORD_BYTES: usize = 38;

/// One metadata record of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct MetadataRecord {
    /// SensorTimestamp in the file's own unit.
    pub sensor: f64,
    /// RealTime, Unix µs; `None` where the text is not a time.
    pub real_time_us: Option<i64>,
}

/// Unit of the SensorTimestamps in a file; the two published recorders differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorUnit {
    /// Nanoseconds since boot.
    Nanoseconds,
    /// Microseconds since the first frame.
    Microseconds,
}

/// Justification of a 10-bit raw sample in its 16-bit word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawJustification {
    /// Right-justified: 0..=1023 (Pi 4).
    Right,
    /// Left-justified: value << 6 (Pi 5).
    Left,
}

impl MetadataRecord {
    /// Whether the recorder never filled this record: it sized its file before the take.
    #[must_use]
    pub fn is_unfilled(&self) -> bool {
        self.sensor == 0.0 && self.real_time_us.is_none()
    }
}

/// The whole records of a metadata file, and how many bytes of a last partial one are left.
/// `zone` is the time zone the recorder's wall clock showed.
#[must_use]
pub fn parse_metadata(bytes: &[u8], zone: chrono_tz::Tz) -> (Vec<MetadataRecord>, usize) {
    let records = bytes.chunks_exact(RECORD_BYTES);
    let n_left = records.remainder().len();
    let record = |bytes: &[u8]| {
        let (number, text) = bytes.split_at(8);
        let mut sensor = [0; 8];
        sensor.copy_from_slice(number);
        MetadataRecord { sensor: f64::from_le_bytes(sensor), real_time_us: parse_time(text, zone) }
    };
    (records.map(record).collect(), n_left)
}

fn parse_time(text: &[u8], zone: chrono_tz::Tz) -> Option<i64> {
    let text = std::str::from_utf8(text).ok()?.trim_end_matches('\0').trim();
    let parse = |form| NaiveDateTime::parse_from_str(text, form).ok();
    let local = parse("%Y-%m-%d %H:%M:%S%.f")?;
    // An hour that daylight saving repeats is ambiguous; the earlier of the two is taken.
    Some(zone.from_local_datetime(&local).earliest()?.timestamp_micros())
}

/// The unit of SensorTimestamps, from the typical interval between frames: frames come 1 ms to
/// 1 s apart. `None` when neither unit makes that so.
#[must_use]
pub fn sensor_unit(records: &[MetadataRecord]) -> Option<SensorUnit> {
    let mut intervals: Vec<f64> = records
        .windows(2)
        .map(|pair| pair[1].sensor - pair[0].sensor)
        .filter(|interval| *interval > 0.0)
        .collect();
    intervals.sort_by(f64::total_cmp);
    let median = intervals.get(intervals.len() / 2).copied()?;
    // Exactly 1e6 could be either; an origin far from zero is the time since boot.
    let is_since_boot = records.first().is_some_and(|record| record.sensor > 1e8);
    match median {
        m if (1e3..1e6).contains(&m) => Some(SensorUnit::Microseconds),
        m if m == 1e6 && !is_since_boot => Some(SensorUnit::Microseconds),
        m if (1e6..=1e9).contains(&m) => Some(SensorUnit::Nanoseconds),
        _ => None,
    }
}

/// The justification, from the samples of at least one frame; `None` when neither fits.
#[must_use]
pub fn raw_justification(samples: &[u16]) -> Option<RawJustification> {
    let max = samples.iter().copied().max()?;
    let all = samples.iter().fold(0, |all, sample| all | sample);
    match (max <= 1023, all & 63 == 0) {
        (true, _) => Some(RawJustification::Right),
        (false, true) => Some(RawJustification::Left),
        (false, false) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(sensor: f64, text: &str) -> Vec<u8> {
        let mut bytes = sensor.to_le_bytes().to_vec();
        bytes.extend_from_slice(text.as_bytes());
        bytes.resize(RECORD_BYTES, 0);
        bytes
    }

    #[test]
    fn records_are_read_with_and_without_a_fraction() {
        let mut bytes = record(8333.0, "2025-06-01 17:04:06.123456");
        bytes.extend(record(16_666.0, "2025-06-01 17:04:07"));
        bytes.extend(record(0.0, ""));
        bytes.extend([1, 2, 3]);
        let (records, n_left) = parse_metadata(&bytes, chrono_tz::UTC);
        assert_eq!(n_left, 3);
        // date -u -d "2025-06-01 17:04:06" +%s -> 1748797446
        assert_eq!(records[0].real_time_us, Some(1_748_797_446_123_456));
        assert_eq!(records[1].real_time_us, Some(1_748_797_447_000_000));
        assert!(records[2].is_unfilled());
        let (records, _) = parse_metadata(&bytes, chrono_tz::Europe::Brussels);
        assert_eq!(records[0].real_time_us, Some(1_748_790_246_123_456));
    }

    #[test]
    fn the_unit_follows_from_the_frame_interval() {
        let at = |sensor: f64| MetadataRecord { sensor, real_time_us: None };
        let ns: Vec<MetadataRecord> = (0..9).map(|k| at(5e13 + f64::from(k) * 8.333e6)).collect();
        assert_eq!(sensor_unit(&ns), Some(SensorUnit::Nanoseconds));
        let us: Vec<MetadataRecord> = (0..9).map(|k| at(f64::from(k) * 16_666.0)).collect();
        assert_eq!(sensor_unit(&us), Some(SensorUnit::Microseconds));
        assert_eq!(sensor_unit(&us[..1]), None);
        let still: Vec<MetadataRecord> = (0..9).map(|_| at(7.0)).collect();
        assert_eq!(sensor_unit(&still), None);
    }

    #[test]
    fn the_bits_stand_right_or_left_or_the_data_are_something_else() {
        assert_eq!(raw_justification(&[0, 64, 1023]), Some(RawJustification::Right));
        assert_eq!(raw_justification(&[64 << 6, 1023 << 6]), Some(RawJustification::Left));
        assert_eq!(raw_justification(&[1, 4096]), None);
        assert_eq!(raw_justification(&[]), None);
    }
}
