//! Epochs of a clock: runs of stamps between restarts of the device's clock.
//!
//! A stream's stamps are cut into segments at every step back by more than a late packet, and at
//! every leap ahead. A segment continues the earlier one whose end is nearest before its begin; one
//! that continues none begins an epoch. So a pause continues its epoch, a restart begins one, and
//! one high stamp is an epoch of its own that leaves what follows in place.

use super::DataLoss;
use std::str::FromStr;

/// Deepest step back of a late packet, µs: cameras send packets of 10 ms.
const MAX_LATENESS_US: i64 = 100_000;

/// A pause of a day is another recording.
const MAX_PAUSE_US: i64 = 86_400_000_000;

/// Segments back to which a continuation is sought.
const MAX_LOOK_BACK: usize = 16;

/// More restarts than this are a table that is not in order of time.
const MAX_RESTARTS: usize = 16;

/// Stamps compared together; those of a camera in less than the lateness.
const STAMPS_PER_BLOCK: usize = 1 << 10;

/// Stamps of an epoch, at most, that are called stray.
const MAX_STRAY: u64 = 10;

/// Which epoch to import.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EpochChoice {
    /// The one with the most stamps.
    #[default]
    Longest,
    /// By its number, from 1.
    Number(usize),
    /// All, sorted into one as if the clock had not restarted.
    All,
}

impl FromStr for EpochChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "longest" => Ok(Self::Longest),
            "all" => Ok(Self::All),
            number => match number.parse() {
                Ok(number) if number > 0 => Ok(Self::Number(number)),
                _ => Err("expected longest, all, or an epoch's number from 1".into()),
            },
        }
    }
}

/// A run of stamps without a restart or a leap.
#[derive(Debug, Clone, Copy, PartialEq)]
struct StampRun {
    first_index: u64,
    count: u64,
    begin: i64,
    end: i64,
    epoch: usize,
}

/// One epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Epoch {
    pub(crate) count: u64,
    pub(crate) begin: i64,
    pub(crate) end: i64,
}

/// Cuts stamps into segments as they come.
#[derive(Debug, Clone, Default)]
pub(crate) struct EpochFinder {
    segments: Vec<StampRun>,
    n: u64,
    n_restarts: usize,
}

/// The epochs of a stream.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Epochs {
    segments: Vec<StampRun>,
    pub(crate) all: Vec<Epoch>,
}

impl EpochFinder {
    pub(crate) fn push(&mut self, t: i64) {
        let index = self.n;
        self.n += 1;
        if let Some(last) = self.segments.last_mut() {
            let is_restart = t < last.end.saturating_sub(MAX_LATENESS_US);
            self.n_restarts += usize::from(is_restart);
            // Beyond the limit the stream is unordered, and no further segment is kept.
            let is_cut = is_restart || t > last.end.saturating_add(MAX_LATENESS_US);
            if !is_cut || self.n_restarts > 4 * MAX_RESTARTS {
                last.count += 1;
                last.begin = last.begin.min(t);
                last.end = last.end.max(t);
                return;
            }
        }
        self.segments.push(StampRun { first_index: index, count: 1, begin: t, end: t, epoch: 0 });
    }

    /// Whether a stamp went back by more than a late packet; the epochs are known at the end only.
    pub(crate) fn may_have_restarted(&self) -> bool {
        self.n_restarts > 0
    }

    /// Takes stamps in order, a block at a time where all of it is near the last segment's end.
    pub(crate) fn extend(&mut self, stamps: &[i64]) {
        for block in stamps.chunks(STAMPS_PER_BLOCK) {
            let (begin, end) = block
                .iter()
                .fold((i64::MAX, i64::MIN), |(begin, end), &t| (begin.min(t), end.max(t)));
            let lateness = MAX_LATENESS_US;
            let continues = |last: &&mut StampRun| {
                let latest = last.end.max(end);
                begin >= latest.saturating_sub(lateness) && end <= last.end.saturating_add(lateness)
            };
            match self.segments.last_mut().filter(continues) {
                Some(last) => {
                    last.count += block.len() as u64;
                    last.begin = last.begin.min(begin);
                    last.end = last.end.max(end);
                    self.n += block.len() as u64;
                }
                None => block.iter().for_each(|t| self.push(*t)),
            }
        }
    }

    /// Chains the segments to epochs.
    pub(crate) fn finish(mut self) -> Epochs {
        if self.n_restarts > MAX_RESTARTS {
            let whole = self.segments.iter().fold(None, |whole: Option<StampRun>, next| {
                let whole = whole.unwrap_or(*next);
                let (begin, end) = (whole.begin.min(next.begin), whole.end.max(next.end));
                Some(StampRun { count: whole.count, begin, end, ..whole })
            });
            self.segments = whole.into_iter().map(|s| StampRun { count: self.n, ..s }).collect();
        }
        let segments = &mut self.segments;
        // The segment that continues each, with the pause between.
        let mut next: Vec<Option<(usize, i64)>> = vec![None; segments.len()];
        let mut n_epochs = 0;
        let mut n_before = 0;
        for i in 0..segments.len() {
            let before = continued(segments, &next, i, n_before);
            n_before += segments[i].count;
            match before {
                Some((k, pause)) => {
                    let displaced = next[k].replace((i, pause));
                    segments[i].epoch = segments[k].epoch;
                    // What continued that segment with a longer pause is an epoch of its own.
                    if displaced.is_some() {
                        let mut link = displaced;
                        while let Some((j, _)) = link {
                            segments[j].epoch = n_epochs;
                            link = next[j];
                        }
                        n_epochs += 1;
                    }
                }
                None => {
                    segments[i].epoch = n_epochs;
                    n_epochs += 1;
                }
            }
        }
        Epochs::of_segments(self.segments)
    }
}

/// The segment that segment `i` continues, and the pause.
fn continued(
    segments: &[StampRun],
    next: &[Option<(usize, i64)>],
    i: usize,
    n_before: u64,
) -> Option<(usize, i64)> {
    let begin = segments[i].begin;
    let mut n_between = 0;
    let mut best: Option<(usize, i64)> = None;
    for k in (i.saturating_sub(MAX_LOOK_BACK)..i).rev() {
        let pause = begin.saturating_sub(segments[k].end);
        let is_free = next[k].is_none_or(|(_, other)| pause < other);
        let is_after = (-MAX_LATENESS_US..=MAX_PAUSE_US).contains(&pause);
        if is_free && is_after && best.is_none_or(|(_, other)| pause.abs() < other) {
            best = Some((k, pause.abs()));
        }
        // Only a few stamps between may be stray: behind more, the clock has restarted.
        n_between += segments[k].count;
        if n_between > (n_before / 100).max(MAX_STRAY.min(n_before / 4)) {
            break;
        }
    }
    best
}

impl Epochs {
    /// The epochs of stamps in the order of a file.
    pub(crate) fn of_stamps(t_us: &[i64]) -> Self {
        let mut finder = EpochFinder::default();
        finder.extend(t_us);
        finder.finish()
    }

    fn of_segments(mut segments: Vec<StampRun>) -> Self {
        // Numbers in the order in which the epochs begin.
        let mut order: Vec<usize> = Vec::new();
        let mut all: Vec<Epoch> = Vec::new();
        for segment in &mut segments {
            let number = order.iter().position(|epoch| *epoch == segment.epoch);
            let number = number.unwrap_or_else(|| {
                order.push(segment.epoch);
                all.push(Epoch { count: 0, begin: segment.begin, end: segment.end });
                order.len() - 1
            });
            segment.epoch = number;
            let epoch = &mut all[number];
            epoch.count += segment.count;
            epoch.begin = epoch.begin.min(segment.begin);
            epoch.end = epoch.end.max(segment.end);
        }
        Self { segments, all }
    }

    /// The epoch, from 0, of the stamp at an index.
    pub(crate) fn epoch_of(&self, index: u64) -> usize {
        let after = self.segments.partition_point(|segment| segment.first_index <= index);
        self.segments.get(after.saturating_sub(1)).map_or(0, |segment| segment.epoch)
    }

    /// The chosen epoch, from 0; none for all.
    pub(crate) fn chosen(&self, choice: EpochChoice) -> Option<usize> {
        match choice {
            EpochChoice::All => None,
            EpochChoice::Number(number) => Some(number - 1),
            EpochChoice::Longest => {
                let by_count = |(i, epoch): &(usize, &Epoch)| (epoch.count, usize::MAX - i);
                self.all.iter().enumerate().max_by_key(by_count).map(|(i, _)| i)
            }
        }
    }

    /// Whether the stamp at an index is in the chosen epoch.
    pub(crate) fn is_chosen(&self, index: usize, choice: EpochChoice) -> bool {
        self.all.len() < 2
            || self.chosen(choice).is_none_or(|chosen| self.epoch_of(index as u64) == chosen)
    }

    /// The epochs that are not stray, by their numbers from 0.
    pub(crate) fn main(&self) -> Vec<usize> {
        let most = self.all.iter().map(|epoch| epoch.count).max().unwrap_or(0);
        (0..self.all.len()).filter(|i| !is_stray(self.all[*i].count, most)).collect()
    }

    /// What the choice leaves out.
    ///
    /// # Errors
    /// When there is no such epoch.
    pub(crate) fn losses(
        &self,
        stream: &str,
        what: &str,
        choice: EpochChoice,
    ) -> Result<Vec<DataLoss>, String> {
        let n = self.all.len();
        let Some(chosen) = self.chosen(choice) else { return Ok(Vec::new()) };
        if chosen >= n.max(1) {
            return Err(format!("has {n} epochs of the clock; there is no epoch {}", chosen + 1));
        }
        let others = self.all.iter().enumerate().filter(|(i, _)| *i != chosen);
        let n_chosen = self.all.get(chosen).map_or(0, |epoch| epoch.count);
        let loss = |(i, epoch): (usize, &Epoch)| {
            let number = i + 1;
            let Epoch { count, begin, end } = epoch;
            let what = if is_stray(*count, n_chosen) {
                format!(
                    "stray {what} at {begin} to {end} us, off the clock of the others, left out"
                )
            } else {
                format!(
                    "{what} of epoch {number} of {n} ({begin} to {end} us) left out: the clock \
                     restarted; --epoch {number} imports them, --epoch all sorts them in"
                )
            };
            DataLoss { stream: stream.to_owned(), what, count: *count }
        };
        Ok(others.map(loss).collect())
    }
}

/// Whether stamps are too few to be an epoch beside the chosen one.
fn is_stray(count: u64, n_chosen: u64) -> bool {
    count <= MAX_STRAY && 4 * count <= n_chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(t: &[i64]) -> Vec<u64> {
        Epochs::of_stamps(t).all.iter().map(|epoch| epoch.count).collect()
    }

    fn ramp(begin: i64, n: i64) -> Vec<i64> {
        (0..n).map(|k| begin + 100 * k).collect()
    }

    #[test]
    fn a_restart_begins_an_epoch_and_a_pause_does_not() {
        assert_eq!(counts(&[ramp(1_000, 2_000), ramp(1_000, 3_000)].concat()), [2_000, 3_000]);
        // A restart of a clock that had run for long, then a short recording.
        assert_eq!(counts(&[ramp(500_000_000, 500), ramp(0, 400)].concat()), [500, 400]);
        let pause = 3_600_000_000;
        assert_eq!(counts(&[ramp(0, 2_000), ramp(pause, 2_000)].concat()), [4_000]);
    }

    #[test]
    fn a_stray_stamp_leaves_what_follows_in_place() {
        for stray in [i64::MAX / 2, 1 << 31, 10_700_000, 2_000_000, -5] {
            let t = [ramp(10_000_000, 2_000), vec![stray], ramp(10_200_000, 2_000)].concat();
            let mut found = counts(&t);
            found.sort_unstable();
            assert_eq!(found, [1, 4_000], "{stray}");
        }
    }

    #[test]
    fn frames_are_parted_as_events_are() {
        let frames = |n: i64| (0..n).map(|k| 200_000 * k).collect::<Vec<i64>>();
        for n in [2, 3, 5, 10, 20, 200] {
            assert_eq!(counts(&[frames(n), frames(n)].concat()), [n as u64; 2], "{n}");
        }
        let mut high = frames(40);
        high[20] += 60_000_000;
        assert_eq!(counts(&high), [39, 1]);
    }

    #[test]
    fn stamps_of_an_earlier_run_in_the_first_packet_are_an_epoch() {
        let t = [ramp(900_000_000, 300), ramp(0, 5_000)].concat();
        let epochs = Epochs::of_stamps(&t);
        assert_eq!(epochs.chosen(EpochChoice::Longest), Some(1));
        assert!(!epochs.is_chosen(299, EpochChoice::Longest));
        assert!(epochs.is_chosen(300, EpochChoice::Longest));
        let losses = epochs.losses("real", "events", EpochChoice::Longest).unwrap();
        assert_eq!((losses.len(), losses[0].count), (1, 300));
        assert!(losses[0].what.contains("--epoch 1"), "{}", losses[0].what);
        assert!(epochs.losses("real", "events", EpochChoice::Number(3)).is_err());
    }

    #[test]
    fn late_packets_and_unordered_tables_are_one_epoch() {
        let late = [ramp(0, 100), ramp(20_000, 100), ramp(10_000, 100), ramp(30_000, 100)].concat();
        assert_eq!(counts(&late), [400]);
        let by_pixel: Vec<i64> = (0..50).flat_map(|_| ramp(0, 5_000)).collect();
        assert_eq!(counts(&by_pixel), [250_000]);
    }
}
