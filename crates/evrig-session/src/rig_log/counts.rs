//! Counts the contents of the rig's log.

use super::source::{PassedOver, ReadStep, RecordSource};
use super::{PacketArrival, RigLogError, Topic, image};
use crate::StreamKind;
use evrig_core::geometry::Size;
use mcap::records::Record;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// What one pass over a log found.
#[derive(Debug, Clone, Default)]
pub(crate) struct RigLogCounts {
    /// Topic by topic, in the order of [`Topic`]; those without messages are left out.
    pub topics: Vec<TopicCounts>,
    /// Where reading had to stop, if the file is cut or damaged.
    pub damage: Option<String>,
}

/// What one pass found of one topic.
#[derive(Debug, Clone)]
pub(crate) struct TopicCounts {
    pub topic: Topic,
    pub count: u64,
    pub first_us: Option<i64>,
    pub last_us: Option<i64>,
    pub longest_gap_us: i64,
    pub size: Option<Size>,
}

impl TopicCounts {
    fn add(&mut self, log_time_ns: u64, data: &[u8]) {
        let t_us = i64::try_from(log_time_ns / 1_000).unwrap_or(i64::MAX);
        if let Some(last) = self.last_us {
            self.longest_gap_us = self.longest_gap_us.max(t_us - last);
        }
        self.first_us.get_or_insert(t_us);
        self.last_us = Some(t_us);
        self.count += 1;
        if self.size.is_none()
            && matches!(self.topic, Topic::Raw | Topic::Rgb)
            && let Some(found) = image::decode(data)
        {
            let [width, height] = [found.width, found.height].map(u16::try_from);
            self.size = width.ok().zip(height.ok()).map(|(w, h)| Size::new(w, h));
        }
    }
}

/// Name and kind of a topic's stream; none for what describes other streams.
pub(crate) const fn stream_names(topic: Topic) -> (&'static str, StreamKind) {
    match topic {
        Topic::Raw => ("raw", StreamKind::Frames),
        Topic::Rgb => ("rgb", StreamKind::Frames),
        Topic::FrameMetadata => ("pi-metadata", StreamKind::Metadata),
        Topic::PiClock => ("pi-clock", StreamKind::ClockReadings),
        Topic::Arrivals => ("davis-arrivals", StreamKind::Metadata),
        Topic::ArmPose => ("arm", StreamKind::Poses),
        Topic::Commanded => ("commanded", StreamKind::Poses),
        Topic::Log => ("log", StreamKind::Log),
    }
}

/// Counts every message up to the end or the first damage.
///
/// # Errors
/// When the file cannot be opened or read.
pub(crate) fn count_log(path: &Path) -> Result<RigLogCounts, RigLogError> {
    let empty = |topic| TopicCounts {
        topic,
        count: 0,
        first_us: None,
        last_us: None,
        longest_gap_us: 0,
        size: None,
    };
    let mut topics = Topic::ALL.map(empty);
    let damage = each_message(path, &mut |topic, log_time_ns, data| {
        topics[topic as usize].add(log_time_ns, data);
    })?;
    let n: u64 = topics.iter().map(|topic| topic.count).sum();
    let damage = damage.map(|what| format!("after {n} messages: {what}"));
    let topics = topics.into_iter().filter(|topic| topic.count > 0).collect();
    Ok(RigLogCounts { topics, damage })
}

/// Elements of each stream of the event camera that are logged as arrived.
///
/// # Errors
/// When the file cannot be opened or read.
pub(crate) fn arrivals(path: &Path) -> Result<BTreeMap<u32, u64>, RigLogError> {
    let mut counts = BTreeMap::new();
    each_message(path, &mut |topic, _, data| {
        if topic == Topic::Arrivals
            && let Ok(arrival) = serde_json::from_slice::<PacketArrival>(data)
        {
            *counts.entry(arrival.stream).or_insert(0) += arrival.count;
        }
    })?;
    Ok(counts)
}

/// Passes topic, log time (ns) and data of every message to `visit`; returns the damage, if any.
fn each_message(
    path: &Path,
    visit: &mut dyn FnMut(Topic, u64, &[u8]),
) -> Result<Option<String>, RigLogError> {
    let failed = |source| RigLogError::Open { path: path.to_owned(), source };
    each_message_of(File::open(path).map_err(failed)?, visit).map_err(failed)
}

/// As [`each_message`], of any source.
pub(crate) fn each_message_of(
    file: impl Read,
    visit: &mut dyn FnMut(Topic, u64, &[u8]),
) -> std::io::Result<Option<String>> {
    let mut source = RecordSource::new(file);
    let mut channels: BTreeMap<u16, Topic> = BTreeMap::new();
    loop {
        match source.step()? {
            ReadStep::Record(Record::Channel(channel)) => {
                let known = Topic::ALL.into_iter().find(|topic| topic.name() == channel.topic);
                channels.extend(known.map(|topic| (channel.id, topic)));
            }
            ReadStep::Record(Record::Message { header, data }) => {
                if let Some(&topic) = channels.get(&header.channel_id) {
                    visit(topic, header.log_time, &data);
                }
            }
            ReadStep::Record(_) | ReadStep::Nothing => {}
            ReadStep::Damage(what) => return Ok(stated(source.passed_over(), Some(what))),
            ReadStep::End => return Ok(stated(source.passed_over(), None)),
        }
    }
}

/// Damage that was passed over, and damage at which reading ended.
fn stated(passed_over: &PassedOver, end: Option<String>) -> Option<String> {
    let passed = passed_over.first.as_ref().map(|first| {
        let n = passed_over.count;
        format!("{n} damaged chunks left out, reading went on behind them; the first: {first}")
    });
    match (passed, end) {
        (Some(passed), Some(end)) => Some(format!("{passed}; then {end}")),
        (passed, end) => passed.or(end),
    }
}
