//! A plain DAVIS recording becomes a session.

use super::aedat4_epochs::PartedFile;
use super::builder::SessionBuilder;
use super::event_table::{check_overlap, check_stamps};
use crate::checksum::copy_with_sha256;
use crate::epochs::EpochChoice;
use crate::file_counts::{FileCounts, StreamCounts, count_file, count_packets};
use crate::manifest::file_name;
use crate::{
    Damage, DataLoss, FileEntry, Journal, Manifest, Origin, SessionError, SessionStatus, Sha256Hex,
    StreamEntry, StreamKind, sha256_of_file,
};
use evrig_format::aedat4::{Reader, StreamHeader};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Copies an AEDAT4 file into a new session and counts what is in it.
///
/// The bytes are copied unchanged, a damaged tail included, unless the camera's clock restarted: then
/// the chosen epoch is written alone. `progress` gets the number of
/// bytes done, out of twice the file's length (copy and count).
///
/// # Errors
/// When the file is no AEDAT4 file or nothing in it can be read, `root` is taken, or writing fails.
pub fn import_aedat4(
    source: &Path,
    root: &Path,
    epoch: EpochChoice,
    progress: &mut dyn FnMut(u64),
) -> Result<Manifest, SessionError> {
    // Refuse what is no AEDAT4 file before anything is made.
    drop(Reader::open(source)?);
    let builder = SessionBuilder::take(root)?;
    let origin = Origin::Aedat4 { file: file_name(source) };
    let (decisions, losses) = (Vec::new(), Vec::new());
    let source = Aedat4Source { file: source, path: source, origin, epoch, decisions, losses };
    adopt(builder, source, progress)
}

/// An AEDAT4 file that becomes the file of a session.
pub(super) struct Aedat4Source<'a> {
    /// What the user gave.
    pub(super) file: &'a Path,
    /// The AEDAT4 file: what the user gave, or what was made of it inside the session.
    pub(super) path: &'a Path,
    pub(super) origin: Origin,
    pub(super) epoch: EpochChoice,
    /// What was decided and lost in making it.
    pub(super) decisions: Vec<String>,
    pub(super) losses: Vec<DataLoss>,
}

/// Counts, checks and takes in an AEDAT4 file. One inside the session is moved, others are copied.
pub(super) fn adopt(
    builder: SessionBuilder,
    given: Aedat4Source<'_>,
    progress: &mut dyn FnMut(u64),
) -> Result<Manifest, SessionError> {
    let Aedat4Source { file: source, path: from, origin, epoch, mut decisions, losses } = given;
    let n_bytes = std::fs::metadata(from).map_or(0, |about| about.len());
    let path = builder.layout.davis();
    let is_inside = from.starts_with(builder.layout.root());
    let (found, taken) = count_and_take(source, from, &path, is_inside, epoch, progress)?;
    let (found, taken, parted) = match PartedFile::write(from, &path, &found, epoch)? {
        Some(parted) => {
            let damage = found.damage;
            let again = count_file(&path, &mut |offset| progress(n_bytes + offset))?;
            (FileCounts { damage, ..again }, sha256_of_file(&path)?, parted)
        }
        None => {
            if is_inside {
                std::fs::rename(from, &path).map_err(SessionError::io(from))?;
            }
            let whole = || copy_with_sha256(from, &path, &AtomicBool::new(false));
            (found, taken.map_or_else(whole, Ok)?, PartedFile::default())
        }
    };
    if is_inside && from.exists() {
        std::fs::remove_file(from).map_err(SessionError::io(from))?;
    }
    progress(2 * n_bytes);
    check_counts(source, &found, epoch)?;
    let whole = manifest(&builder, origin, builder.named_entry(&path, taken), &found);
    decisions.extend(parted.decisions);
    decisions.extend(named_streams(&whole.streams, &found));
    let losses = losses.into_iter().chain(whole.losses.iter().cloned()).chain(parted.losses);
    let losses = losses.collect();
    let manifest = Manifest { losses, decisions, ..whole };
    let mut journal = Journal::open(&builder.layout.journal())?;
    let note = json!({
        "file": file_name(source), "decisions": manifest.decisions, "losses": manifest.losses,
    });
    journal.note("import", &note)?;
    builder.seal(&manifest)?;
    Ok(manifest)
}

/// Counts a file, and meanwhile computes its checksum and copies it. The copy of a file that is
/// refused, or of which one epoch may be written, would be of no use: it is stopped, and no checksum
/// is given.
fn count_and_take(
    source: &Path,
    from: &Path,
    path: &Path,
    is_inside: bool,
    epoch: EpochChoice,
    progress: &mut dyn FnMut(u64),
) -> Result<(FileCounts, Option<(Sha256Hex, u64)>), SessionError> {
    let is_stopped = AtomicBool::new(false);
    let mut may_restart = false;
    let (found, taken) = std::thread::scope(|scope| {
        let taking = scope.spawn(|| match is_inside {
            true => sha256_of_file(from),
            false => copy_with_sha256(from, path, &is_stopped),
        });
        let found = count_packets(from, &mut |offset, does_step_back| {
            progress(offset);
            may_restart |= does_step_back && epoch != EpochChoice::All;
            is_stopped.store(may_restart, Ordering::Relaxed);
        });
        // The spans of a clock that restarted are checked of the epoch that is written.
        let checked = found.and_then(|found| {
            let checked = if may_restart { Ok(()) } else { check_counts(source, &found, epoch) };
            checked.map(|()| found)
        });
        is_stopped.fetch_or(checked.is_err(), Ordering::Relaxed);
        (checked, taking.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let (found, taken) = (found?, taken?);
    let is_whole = is_inside || !is_stopped.into_inner();
    Ok((found, is_whole.then_some(taken)))
}

/// The names of streams of which the file has several of a kind.
fn named_streams(entries: &[StreamEntry], found: &FileCounts) -> Vec<String> {
    let has_others =
        |entry: &StreamEntry| entries.iter().filter(|other| other.kind == entry.kind).count() > 1;
    let named = entries.iter().zip(&found.streams).filter(|(entry, _)| has_others(entry));
    let decision = |(entry, counted): (&StreamEntry, &StreamCounts)| {
        let StreamHeader { id, name, source, .. } = &counted.stream;
        format!("stream {id} of the file (`{name}` of `{source}`) is `{}`", entry.name)
    };
    named.map(decision).collect()
}

/// Refuses a file of which nothing can be read, events that no camera gives, and events and frames
/// that share no time.
fn check_counts(source: &Path, found: &FileCounts, epoch: EpochChoice) -> Result<(), SessionError> {
    let n_read: u64 = found.streams.iter().map(|stream| stream.count).sum();
    if let (Some(damage), 0) = (&found.damage, n_read) {
        return Err(SessionError::import(source, format!("nothing can be read: {damage}")));
    }
    // Epochs that are laid into each other have no one span.
    if epoch == EpochChoice::All {
        return Ok(());
    }
    let span = |kind: StreamKind| {
        let of_kind = found.streams.iter().filter(move |stream| stream.kind == kind);
        let stream = of_kind.filter(|stream| stream.count > 1).max_by_key(|stream| stream.count)?;
        Some(<[i64; 2]>::from(stream.first_us.zip(stream.last_us)?))
    };
    let wrong = |what: String| SessionError::import(source, what);
    let events = span(StreamKind::Events);
    if let (Some(events), Some(frames)) = (events, span(StreamKind::Frames)) {
        check_overlap(events, frames).map_err(wrong)?;
    }
    let of_events = found.streams.iter().filter(|stream| stream.kind == StreamKind::Events);
    for stream in of_events.filter(|stream| stream.first_us == stream.last_us) {
        let n = stream.count.min(1_000) as usize;
        check_stamps(&vec![stream.first_us.unwrap_or(0); n]).map_err(wrong)?;
    }
    Ok(())
}

fn manifest(
    builder: &SessionBuilder,
    origin: Origin,
    file: (String, FileEntry),
    found: &FileCounts,
) -> Manifest {
    let DescribedFile { streams, file, losses } = describe(file, found);
    let is_whole = found.damage.is_none();
    let status = if is_whole { SessionStatus::Complete } else { SessionStatus::Recovered };
    Manifest::new(builder.layout.root(), origin, status, streams, [file], losses)
}

/// An AEDAT4 file as a manifest describes it.
pub(super) struct DescribedFile {
    pub(super) streams: Vec<StreamEntry>,
    /// Its path inside the session, with length and checksum.
    pub(super) file: (String, FileEntry),
    pub(super) losses: Vec<DataLoss>,
}

/// Describes a counted AEDAT4 file inside the session.
pub(super) fn describe(
    (file, mut entry): (String, FileEntry),
    found: &FileCounts,
) -> DescribedFile {
    let mut losses = found.losses.clone();
    if let Some(what) = &found.damage {
        entry.damage = Some(Damage { what: what.clone() });
        losses.push(DataLoss { stream: file.clone(), what: what.clone(), count: 0 });
    }
    let streams = found.entries(&file);
    DescribedFile { streams, file: (file, entry), losses }
}
