//! Counts the contents of an AEDAT4 file, stream by stream.

use super::epochs::EpochFinder;
use super::{DataLoss, SessionError, StreamEntry, StreamKind};
use evrig_core::event::EventSlice;
use evrig_core::geometry::Size;
use evrig_core::time::{Clock, Davis};
use evrig_format::aedat4::{Content, Losses, Packet, PayloadKind, Reader, StreamHeader};
use std::collections::BTreeMap;
use std::path::Path;

/// Counts of one file.
#[derive(Debug, Clone, Default)]
pub struct FileCounts {
    /// The known streams, in the file's order.
    pub streams: Vec<StreamCounts>,
    /// Description of the damage at which reading stopped.
    pub damage: Option<String>,
    /// What was lost or is doubtful.
    pub losses: Vec<DataLoss>,
}

/// Counts of one stream.
#[derive(Debug, Clone)]
pub struct StreamCounts {
    /// Its entry in the file's header.
    pub stream: StreamHeader,
    /// Kind of its data.
    pub kind: StreamKind,
    /// The pixel grid: the header's, or the first frame's.
    pub size: Option<Size>,
    /// Number of events, frames, samples or edges.
    pub count: u64,
    /// First stamp in the file's order, µs.
    pub first_us: Option<i64>,
    /// Last stamp in the file's order, µs.
    pub last_us: Option<i64>,
    /// How many are earlier than the one before them.
    pub n_disordered: u64,
    /// Events that are not on the sensor.
    pub n_outside: u64,
    /// Number of ON events.
    pub n_on: u64,
    /// Longest time between two neighbours, µs.
    pub longest_gap_us: i64,
    /// Restarts of the clock, in the file's order.
    pub(crate) epochs: EpochFinder,
}

impl StreamCounts {
    fn new(stream: &StreamHeader) -> Option<Self> {
        let kind = match stream.kind {
            PayloadKind::Events => StreamKind::Events,
            PayloadKind::Frames => StreamKind::Frames,
            PayloadKind::Imu => StreamKind::Imu,
            PayloadKind::Triggers => StreamKind::Triggers,
            PayloadKind::Other(_) => return None,
        };
        Some(Self {
            stream: stream.clone(),
            kind,
            size: stream.size,
            count: 0,
            first_us: None,
            last_us: None,
            n_disordered: 0,
            n_outside: 0,
            n_on: 0,
            longest_gap_us: 0,
            epochs: EpochFinder::default(),
        })
    }

    fn add(&mut self, t_us: i64) {
        self.add_stamps(&[t_us]);
    }

    fn add_stamps(&mut self, stamps: &[i64]) {
        let (Some(&first), Some(&last)) = (stamps.first(), stamps.last()) else { return };
        self.epochs.extend(stamps);
        let before = self.last_us.unwrap_or(first);
        let pairs = stamps.windows(2).map(|pair| (pair[0], pair[1]));
        for (earlier, later) in std::iter::once((before, first)).chain(pairs) {
            self.n_disordered += u64::from(later < earlier);
            self.longest_gap_us = self.longest_gap_us.max(later.saturating_sub(earlier));
        }
        self.first_us.get_or_insert(first);
        self.last_us = Some(last);
        self.count += stamps.len() as u64;
    }

    fn add_events(&mut self, events: EventSlice<'_>) {
        self.add_stamps(events.t);
        self.n_on += events.count_on() as u64;
        self.n_outside += self.size.map_or(0, |size| events.count_outside(size) as u64);
    }

    fn losses(&self, name: &str) -> Vec<DataLoss> {
        let counted = [
            (self.n_outside, "off the sensor; they are left out when the stream is read"),
            (self.n_disordered, "earlier than the one before; they are sorted in when it is read"),
        ];
        let loss = |(count, what): (u64, &str)| DataLoss {
            stream: name.to_owned(),
            what: format!("{} {what}", self.kind),
            count,
        };
        let mut losses: Vec<DataLoss> =
            counted.into_iter().filter(|(count, _)| *count > 0).map(loss).collect();
        let epochs = self.epochs.clone().finish().main().len();
        if epochs > 1 {
            let what = "epochs: the device's clock restarted, and they are laid into each other";
            losses.push(DataLoss {
                stream: name.to_owned(),
                what: what.into(),
                count: epochs as u64,
            });
        }
        losses
    }
}

impl FileCounts {
    /// The streams as a manifest lists them, in the file of that name inside the session.
    pub(super) fn entries(&self, file: &str) -> Vec<StreamEntry> {
        let entry = |(found, name): (&StreamCounts, String)| StreamEntry {
            name,
            kind: found.kind,
            file: file.to_owned(),
            stream_id: Some(found.stream.id),
            size: found.size,
            count: found.count,
            first_us: found.first_us,
            last_us: found.last_us,
            clock: Davis::NAME.into(),
            source: found.stream.source.clone(),
        };
        self.streams.iter().zip(stream_names(&self.streams)).map(entry).collect()
    }
}

/// Counts everything in an AEDAT4 file.
///
/// # Errors
/// When the file cannot be opened or is not AEDAT4; damage after its header is in the result.
pub fn count_file(path: &Path, progress: &mut dyn FnMut(u64)) -> Result<FileCounts, SessionError> {
    count_packets(path, &mut |offset, _| progress(offset))
}

/// The same; `progress` also gets whether stamps of the packet's stream went back so far that its
/// clock may have restarted.
pub(crate) fn count_packets(
    path: &Path,
    progress: &mut dyn FnMut(u64, bool),
) -> Result<FileCounts, SessionError> {
    let mut reader = Reader::open(path)?;
    let mut streams: BTreeMap<u32, StreamCounts> = BTreeMap::new();
    let mut order = Vec::new();
    for stream in reader.streams() {
        if let Some(counted) = StreamCounts::new(stream) {
            order.push(stream.id);
            streams.insert(stream.id, counted);
        }
    }
    let mut found = FileCounts::default();
    while let Some(packet) = reader.next() {
        match packet {
            Ok(packet) => {
                let stream = streams.get_mut(&packet.stream);
                let may_restart = stream.is_some_and(|stream| {
                    add_packet(stream, &packet);
                    stream.epochs.may_have_restarted()
                });
                progress(packet.offset, may_restart);
                if let Content::Events(events) = packet.content {
                    reader.recycle(events);
                }
            }
            // The path is left out: the damage is described by its position in the file.
            Err(damage) => {
                let file = format!("{}: ", path.display());
                found.damage = Some(damage.to_string().replacen(&file, "", 1));
            }
        }
    }
    found.losses = unreadable(reader.losses());
    found.streams = order.iter().filter_map(|id| streams.remove(id)).collect();
    let names = stream_names(&found.streams);
    for (stream, name) in found.streams.iter().zip(&names) {
        found.losses.extend(stream.losses(name));
    }
    Ok(found)
}

/// What the reader could not represent.
fn unreadable(losses: &Losses) -> Vec<DataLoss> {
    let first = losses.first.as_ref().map(|first| format!("; the first: {first}"));
    let first = first.unwrap_or_default();
    let damage = losses.first_damage.as_deref().unwrap_or_default();
    let counted = [
        (
            "packets",
            losses.damaged_packets,
            format!("are damaged and left out, reading went on behind them; the first: {damage}"),
        ),
        ("events", losses.events, format!("have a negative column or row{first}")),
        ("frames", losses.frames, format!("have a size, format and pixels that disagree{first}")),
        ("unknown", losses.unknown_packets, "packets of a kind evrig does not know".to_owned()),
    ];
    let loss = |(stream, count, what): (&str, u64, String)| {
        (count > 0).then(|| DataLoss { stream: stream.to_owned(), what, count })
    };
    counted.into_iter().filter_map(loss).collect()
}

fn add_packet(stream: &mut StreamCounts, packet: &Packet) {
    match &packet.content {
        Content::Events(events) => stream.add_events(events.as_slice()),
        Content::Frame(frame) => {
            stream.size.get_or_insert(frame.size);
            stream.add(frame.timing.stamp.as_micros());
        }
        Content::Imu(samples) => samples.iter().for_each(|s| stream.add(s.stamp.as_micros())),
        Content::Triggers(edges) => edges.iter().for_each(|e| stream.add(e.stamp.as_micros())),
        Content::Unknown { .. } => {}
    }
}

/// The streams' names in evrig: `real`, `aps`, `imu`, `triggers`, with the file's number
/// appended from the second of a kind on.
pub(super) fn stream_names(streams: &[StreamCounts]) -> Vec<String> {
    let mut taken: BTreeMap<StreamKind, u32> = BTreeMap::new();
    let name = |stream: &StreamCounts| {
        let base = match stream.kind {
            StreamKind::Events => "real",
            StreamKind::Frames => "aps",
            StreamKind::Imu => "imu",
            _ => "triggers",
        };
        let n = taken.entry(stream.kind).or_default();
        *n += 1;
        if *n == 1 { base.to_owned() } else { format!("{base}-{}", stream.stream.id) }
    };
    streams.iter().map(name).collect()
}
