//! Event tables in the layout of DSEC, written.
//!
//! `events/{x, y, t, p}` with `t` in microseconds since `t_offset`, and `ms_to_idx`, by which
//! `t[ms_to_idx[ms]] >= ms * 1000` (dsec.ifi.uzh.ch/data-format). DSEC itself compresses with
//! Blosc, which h5py reads only with a plugin; gzip needs none.

use super::Hdf5Error;
use crate::npy::Column;
use evrig_core::event::EventSlice;
use hdf5_pure::{
    File, FileAccessProperties, FileBuilder, FileLocking, FinishedGroup, GroupBuilder, H5Element,
    MaxExtent, SyncPolicy,
};
use std::path::Path;

/// Elements per chunk: what one read decompresses. Below 65,536, whose chunk dimension `hdf5-pure`
/// stores in four bytes: HDF5 2.0 expects three and refuses the file.
const CHUNK_ELEMENTS: u64 = 1 << 15;

/// Events that are converted and appended at once, whole chunks.
const APPENDED_EVENTS: usize = 8 * CHUNK_ELEMENTS as usize;

/// gzip's level: its default is hardly smaller and half as fast.
const GZIP_LEVEL: u32 = 4;

/// Milliseconds that the index may span, 100 days: a stray stamp would make it larger than memory.
const MAX_SPAN_MS: i64 = 100 * 86_400_000;

/// A group of columns of equal length in addition to the events.
#[derive(Debug, Clone, PartialEq)]
pub struct SideGroup {
    /// Its name; one link, so without `/`.
    pub name: String,
    /// The columns.
    pub columns: Vec<SideColumn>,
}

/// One column: a row of `width` numbers per entry.
#[derive(Debug, Clone, PartialEq)]
pub struct SideColumn {
    /// Its name, with the unit.
    pub name: &'static str,
    /// The numbers, row after row.
    pub values: Column,
    /// Numbers per entry.
    pub width: usize,
}

impl SideColumn {
    /// A column of one integer an entry.
    #[must_use]
    pub fn integers(name: &'static str, values: Vec<i64>) -> Self {
        Self { name, values: Column::Int(values), width: 1 }
    }

    /// A column of rows of numbers.
    #[must_use]
    pub fn rows(name: &'static str, values: Vec<f64>, width: usize) -> Self {
        Self { name, values: Column::Float(values), width }
    }

    /// Lengths along each axis.
    #[must_use]
    pub fn shape(&self) -> Vec<u64> {
        let width = self.width.max(1) as u64;
        let n = self.values.len() as u64 / width;
        if self.width == 1 { vec![n] } else { vec![n, width] }
    }
}

/// Writes events in ascending time, groups of columns below `images`, and a text `evrig` that
/// describes them.
///
/// `t` is uint32 as in DSEC, or int64 where the events span more than 71 minutes.
///
/// # Errors
/// When the events span more than 100 days, or writing fails.
pub fn write_dsec(
    path: &Path,
    events: EventSlice<'_>,
    images: &[SideGroup],
    description: &str,
) -> Result<(), Hdf5Error> {
    let wrong = |what: String| Hdf5Error { path: path.to_owned(), what };
    let unwritable = |error: hdf5_pure::Error| wrong(format!("cannot be written: {error}"));
    let t_offset = events.t.first().copied().unwrap_or(0);
    let ms_to_idx = ms_to_idx(events.t, t_offset).map_err(wrong)?;
    let is_narrow = events.t.iter().all(|t| u32::try_from(t - t_offset).is_ok());
    let mut file = FileBuilder::new();
    let mut group = file.create_group("events");
    if is_narrow {
        add_column::<u32>(&mut group, "t")
    } else {
        add_column::<i64>(&mut group, "t")
    }
    add_column::<u16>(&mut group, "x");
    add_column::<u16>(&mut group, "y");
    add_column::<u8>(&mut group, "p");
    file.add_group(group.finish());
    let shape = [ms_to_idx.len() as u64];
    file.create_dataset("ms_to_idx").with_data(&ms_to_idx).with_shape(&shape);
    file.create_dataset("t_offset").with_data(&[t_offset]).with_shape(&[]);
    let text = file.create_dataset("evrig").with_strings(&[description]);
    text.map_err(|error| wrong(format!("cannot be written: {error}")))?.with_shape(&[]);
    if !images.is_empty() {
        let mut all = file.create_group("images");
        for group in images {
            let below = all.create_group(&group.name);
            all.add_group(side(below, group));
        }
        file.add_group(all.finish());
    }
    file.write(path).map_err(unwritable)?;
    append_events(path, events, t_offset, is_narrow).map_err(unwritable)
}

/// Appends the columns block by block: a `FileBuilder` would hold all of them, plain and
/// compressed, until the file is complete.
fn append_events(
    path: &Path,
    events: EventSlice<'_>,
    t_offset: i64,
    is_narrow: bool,
) -> Result<(), hdf5_pure::Error> {
    // A failed export removes its file, so its blocks need no order on the disk.
    let options = FileAccessProperties::new()
        .with_sync_policy(SyncPolicy::OnClose)
        .with_locking(FileLocking::BestEffort);
    let file = File::open_rw_with_options(path, options)?;
    let mut times = file.dataset("events/t")?;
    for block in events.t.chunks(APPENDED_EVENTS) {
        let since = block.iter().map(|t| t - t_offset);
        if is_narrow {
            times.append(&since.map(|t| t as u32).collect::<Vec<_>>())?;
        } else {
            times.append(&since.collect::<Vec<_>>())?;
        }
    }
    file.dataset("events/x")?.append(events.x)?;
    file.dataset("events/y")?.append(events.y)?;
    let mut polarities = file.dataset("events/p")?;
    for block in events.on.chunks(APPENDED_EVENTS) {
        polarities.append(&block.iter().map(|on| u8::from(*on)).collect::<Vec<_>>())?;
    }
    file.close()
}

/// Adds an empty column, to which events are appended.
fn add_column<T: H5Element>(group: &mut GroupBuilder, name: &str) {
    let dataset = group.create_dataset(name).with_data::<T>(&[]).with_shape(&[0]);
    dataset.with_maxshape(&[MaxExtent::Unlimited]).with_chunks(&[CHUNK_ELEMENTS]);
    dataset.with_shuffle().with_deflate(GZIP_LEVEL);
}

fn side(mut made: GroupBuilder, group: &SideGroup) -> FinishedGroup {
    for column in &group.columns {
        match &column.values {
            Column::Short(values) => add(&mut made, column.name, values, &column.shape()),
            Column::Int(values) => add(&mut made, column.name, values, &column.shape()),
            Column::Float(values) => add(&mut made, column.name, values, &column.shape()),
        }
    }
    made.finish()
}

fn add<T: H5Element>(group: &mut GroupBuilder, name: &str, values: &[T], shape: &[u64]) {
    let dataset = group.create_dataset(name).with_data(values).with_shape(shape);
    // An empty array has no chunk to compress.
    if !values.is_empty() {
        let mut chunk = shape.to_vec();
        if let Some(rows) = chunk.first_mut() {
            *rows = (*rows).min(CHUNK_ELEMENTS);
        }
        dataset.with_chunks(&chunk).with_shuffle().with_deflate(GZIP_LEVEL);
    }
}

/// For each millisecond from 0 the first event that is not before it; one entry more than the
/// events' whole milliseconds, so that the last one has an end.
fn ms_to_idx(times: &[i64], t_offset: i64) -> Result<Vec<u64>, String> {
    let Some(&last) = times.last() else { return Ok(vec![0]) };
    let n_ms = last.saturating_sub(t_offset) / 1000 + 1;
    if n_ms > MAX_SPAN_MS {
        return Err(format!(
            "the events span {} days; expected at most 100: is a stamp wrong? `evrig info` shows the gaps",
            n_ms / 86_400_000
        ));
    }
    let index = |ms: i64| times.partition_point(|&t| t - t_offset < ms * 1000) as u64;
    Ok((0..=n_ms).map(index).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hdf5::read_events;
    use evrig_core::event::{Event, Events};

    #[test]
    fn what_is_written_is_read_back_with_its_offset_added() {
        let directory = tempfile::tempdir().unwrap();
        // Several blocks and chunks with a rest, and times beyond 32 bits.
        let many = 2 * APPENDED_EVENTS as i64 + CHUNK_ELEMENTS as i64 + 5;
        for (name, start, step, n) in
            [("short", 1_700_000_000_000_000, 7, many), ("long", -5, 1 << 24, 1_000)]
        {
            let path = directory.path().join(name);
            let event = |i: i64| Event {
                t: start + i * step,
                x: (i % 346) as u16,
                y: (i % 260) as u16,
                on: i % 3 == 0,
            };
            let events: Events = (0..n).map(event).collect();
            let values = Column::Float(vec![0.5; 18]);
            let group = SideGroup {
                name: "aps".into(),
                columns: vec![SideColumn { name: "homography", values, width: 9 }],
            };
            write_dsec(&path, events.as_slice(), &[group], "{}").unwrap();
            let read = read_events(&path, None).unwrap();
            assert_eq!(read.t_offset_us, start);
            let columns = read.columns.into_iter();
            let columns: Vec<_> = columns.map(|(_, c)| c.into_integers().unwrap()).collect();
            let row = |i: usize| {
                let [t, x, y, p] = [0, 1, 2, 3].map(|column| columns[column][i]);
                Event { t: t + start, x: x as u16, y: y as u16, on: p == 1 }
            };
            assert!((0..columns[0].len()).map(row).eq(events.as_slice().iter()), "{name}");
        }
    }

    #[test]
    fn the_index_names_the_first_event_of_each_millisecond() {
        let times = [7, 1006, 1007, 1007, 4207];
        assert_eq!(ms_to_idx(&times, 7).unwrap(), [0, 2, 4, 4, 4, 5]);
        assert_eq!(ms_to_idx(&[], 0).unwrap(), [0]);
        assert!(ms_to_idx(&[0, i64::MAX], 0).unwrap_err().contains("span"));
    }

    #[test]
    fn a_stream_without_events_is_a_file_with_empty_columns() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("none.h5");
        write_dsec(&path, Events::new().as_slice(), &[], "{}").unwrap();
        assert_eq!(read_events(&path, None).unwrap().n_rows(), 0);
    }
}
