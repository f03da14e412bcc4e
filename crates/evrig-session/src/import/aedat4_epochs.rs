//! One epoch of a recording whose clock restarted, as a file of its own.

use crate::epochs::{EpochChoice, Epochs};
use crate::file_counts::{FileCounts, StreamCounts, stream_names};
use crate::{DataLoss, SessionError, StreamKind};
use evrig_core::event::Events;
use evrig_core::imu::{ImuSample, Trigger};
use evrig_format::aedat4::{Content, Reader, StreamSpec, Writer};
use std::collections::BTreeMap;
use std::path::Path;

/// What was left out of a file, and why.
#[derive(Debug, Default)]
pub(super) struct PartedFile {
    pub(super) losses: Vec<DataLoss>,
    pub(super) decisions: Vec<String>,
}

/// What is kept of one stream.
struct StreamPart {
    kind: StreamKind,
    name: String,
    epochs: Epochs,
    /// Its epoch that is kept; none where that of the leading stream decides.
    own: Option<usize>,
    next: u64,
    n_left_out: u64,
}

impl PartedFile {
    /// Writes the chosen epoch of `source` to `path`; none where there is only one.
    pub(super) fn write(
        source: &Path,
        path: &Path,
        found: &FileCounts,
        choice: EpochChoice,
    ) -> Result<Option<Self>, SessionError> {
        let wrong = |what: String| SessionError::import(source, what);
        let epochs = |stream: &StreamCounts| stream.epochs.clone().finish();
        let all: Vec<Epochs> = found.streams.iter().map(epochs).collect();
        let is_parted = all.iter().any(|epochs| epochs.all.len() > 1);
        if choice == EpochChoice::All || !is_parted {
            if let EpochChoice::Number(number) = choice
                && number > 1
            {
                return Err(wrong(format!("has 1 epoch of the clock; there is no epoch {number}")));
            }
            return Ok(None);
        }
        // The stream with the most stamps leads: its restarts are those of the clock.
        let is_fuller = |i: &usize| (all[*i].all.len() > 1, found.streams[*i].count);
        let leader = (0..all.len()).max_by_key(is_fuller).unwrap_or(0);
        let leading = all[leader].clone();
        let name = stream_names(&found.streams);
        let what = found.streams[leader].kind.to_string();
        let mut losses = leading.losses(&name[leader], &what, choice).map_err(wrong)?;
        let chosen = leading.chosen(choice).unwrap_or(0);
        let mut parts: BTreeMap<u32, StreamPart> = BTreeMap::new();
        for (i, (stream, epochs)) in found.streams.iter().zip(all).enumerate() {
            let own = epoch_of_its_own(&epochs, &leading, chosen, i == leader);
            let (kind, name) = (stream.kind, name[i].clone());
            let part = StreamPart { kind, name, epochs, own, next: 0, n_left_out: 0 };
            parts.insert(stream.stream.id, part);
        }
        let leader = found.streams[leader].stream.id;
        copy(source, path, &mut parts, (leader, chosen))?;
        let others = parts.iter().filter(|(id, part)| **id != leader && part.n_left_out > 0);
        losses.extend(others.map(|(_, part)| DataLoss {
            stream: part.name.clone(),
            what: format!("{} of other epochs of the clock left out", part.kind),
            count: part.n_left_out,
        }));
        let n = leading.all.len();
        let decision = format!(
            "the file was written anew without what is off the clock's epoch {} of {n}",
            chosen + 1
        );
        Ok(Some(Self { losses, decisions: vec![decision] }))
    }
}

/// The stream's own epoch that belongs to the chosen one of the leading stream; none where the two
/// do not restart equally often.
fn epoch_of_its_own(
    epochs: &Epochs,
    leading: &Epochs,
    chosen: usize,
    leads: bool,
) -> Option<usize> {
    if leads {
        return Some(chosen);
    }
    if epochs.all.len() == leading.all.len() {
        return Some(chosen);
    }
    let (own, main) = (epochs.main(), leading.main());
    let place = main.iter().position(|epoch| *epoch == chosen)?;
    (own.len() == main.len()).then(|| own[place])
}

/// Copies what belongs to the chosen epoch.
fn copy(
    source: &Path,
    path: &Path,
    parts: &mut BTreeMap<u32, StreamPart>,
    (leader, chosen): (u32, usize),
) -> Result<(), SessionError> {
    let reader = Reader::open(source)?;
    let known = reader.streams().iter().filter(|stream| parts.contains_key(&stream.id));
    let headers: Vec<_> = known.cloned().collect();
    let specs: Vec<StreamSpec> = headers
        .iter()
        .map(|stream| StreamSpec {
            name: stream.name.clone(),
            kind: stream.kind.clone(),
            size: stream.size,
            source: stream.source.clone(),
        })
        .collect();
    let mut writer = Writer::create(path, reader.compression(), &specs)?;
    let mut current = None;
    for packet in reader.map_while(Result::ok) {
        let number = headers.iter().position(|stream| stream.id == packet.stream);
        let (Some(number), Some(part)) = (number, parts.get_mut(&packet.stream)) else { continue };
        if packet.stream == leader {
            let epoch = part.epochs.epoch_of(part.next);
            current = part.epochs.main().contains(&epoch).then_some(epoch).or(current);
        }
        let is_current = current.is_none_or(|current| current == chosen);
        if let Some(content) = part.keep(packet.content, is_current) {
            content.write(&mut writer, number as u32)?;
        }
    }
    writer.finish()?;
    Ok(())
}

impl StreamPart {
    /// The elements of a packet that belong to the chosen epoch; none where no one does.
    fn keep(&mut self, content: Content, is_current: bool) -> Option<Content> {
        let mut next = || {
            let epoch = self.epochs.epoch_of(self.next);
            self.next += 1;
            let is_kept = match self.own {
                Some(own) => epoch == own,
                None => is_current && self.epochs.main().contains(&epoch),
            };
            self.n_left_out += u64::from(!is_kept);
            is_kept
        };
        match content {
            Content::Events(events) => {
                let kept: Events = events.as_slice().iter().filter(|_| next()).collect();
                (!kept.is_empty()).then_some(Content::Events(kept))
            }
            Content::Frame(frame) => next().then_some(Content::Frame(frame)),
            Content::Imu(samples) => {
                let kept: Vec<ImuSample> = samples.into_iter().filter(|_| next()).collect();
                (!kept.is_empty()).then_some(Content::Imu(kept))
            }
            Content::Triggers(edges) => {
                let kept: Vec<Trigger> = edges.into_iter().filter(|_| next()).collect();
                (!kept.is_empty()).then_some(Content::Triggers(kept))
            }
            Content::Unknown { .. } => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::import::{EpochChoice, import_aedat4};
    use crate::{Manifest, Session};
    use evrig_core::event::{Event, Events};
    use evrig_core::frame::{Frame, FrameTiming, Samples};
    use evrig_core::geometry::Size;
    use evrig_core::time::Stamp;
    use evrig_format::aedat4::{Compression, StreamSpec, Writer};
    use std::path::Path;

    const SIZE: Size = Size::new(64, 48);

    /// Ten frames 40 ms apart with 400 events each, stamped by `clock`; stream 0 holds the events.
    fn recording(path: &Path, clock: impl Fn(i64) -> i64, frame_clock: impl Fn(i64) -> i64) {
        let specs =
            [StreamSpec::events(SIZE, "DAVIS346_0"), StreamSpec::frames(SIZE, "DAVIS346_0")];
        let mut writer = Writer::create(path, Compression::Lz4, &specs).unwrap();
        for k in 0..10 {
            let timing = FrameTiming::from_stamp(Stamp::from_micros(frame_clock(k * 40_000)));
            let samples = Samples::U8(vec![k as u8; SIZE.n_pixels()]);
            writer.write_frame(1, &Frame::gray(timing, SIZE, samples)).unwrap();
            let event = |j: i64| Event {
                t: clock(k * 40_000 + j * 100),
                x: (j * 37 % 64) as u16,
                y: (j * 53 % 48) as u16,
                on: j % 2 == 0,
            };
            let events: Events = (0..400).map(event).collect();
            writer.write_events(0, events.as_slice()).unwrap();
        }
        writer.finish().unwrap();
    }

    /// Imports; the counts of events and frames, and the manifest.
    fn import(
        clock: impl Fn(i64) -> i64,
        frame_clock: impl Fn(i64) -> i64,
        choice: EpochChoice,
    ) -> ([usize; 2], Manifest) {
        let directory = tempfile::tempdir().unwrap();
        let (path, root) = (directory.path().join("a.aedat4"), directory.path().join("s"));
        recording(&path, clock, frame_clock);
        let manifest = import_aedat4(&path, &root, choice, &mut |_| {}).unwrap();
        let session = Session::open(&root).unwrap();
        let (events, _) = session.events("real").unwrap();
        let frames = session.davis_frames("aps").unwrap().count();
        ([events.len(), frames], manifest)
    }

    #[test]
    fn a_restarted_clock_is_imported_epoch_by_epoch() {
        let restarted = |t: i64| if t < 160_000 { t + 1_000 } else { t - 159_000 };
        let (counts, manifest) = import(restarted, restarted, EpochChoice::Longest);
        assert_eq!(counts, [2_400, 6]);
        assert!(manifest.losses[0].what.contains("--epoch 1"), "{:?}", manifest.losses);
        let (counts, _) = import(restarted, restarted, EpochChoice::Number(1));
        assert_eq!(counts, [1_600, 4]);
        let (counts, manifest) = import(restarted, restarted, EpochChoice::All);
        assert_eq!(counts, [4_000, 10]);
        assert!(manifest.losses.iter().any(|loss| loss.what.contains("restarted")));
    }

    #[test]
    fn stray_stamps_of_either_stream_are_left_out() {
        let same = |t: i64| t;
        let high = |t: i64| if t == 120_000 { t + 10_000_000_000 } else { t };
        assert_eq!(import(same, high, EpochChoice::Longest).0, [4_000, 9]);
        assert_eq!(import(high, same, EpochChoice::Longest).0, [3_999, 10]);
        let earlier_run = |t: i64| if t < 40_000 { t + 500_000_000 } else { t };
        let counts = import(earlier_run, earlier_run, EpochChoice::Longest).0;
        assert_eq!(counts, [3_600, 9]);
    }
}
