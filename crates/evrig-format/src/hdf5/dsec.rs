//! Event tables in the layout of DSEC, written.
//!
//! `events/{x, y, t, p}` with `t` in microseconds since `t_offset`, and `ms_to_idx`, by which
//! `t[ms_to_idx[ms]] >= ms * 1000` (dsec.ifi.uzh.ch/data-format). DSEC itself compresses with
//! Blosc, which h5py reads only with a plugin; gzip needs none.

use super::Hdf5Error;
use crate::npy::Column;
use evrig_core::event::EventSlice;
use hdf5_pure::{FileBuilder, FinishedGroup, GroupBuilder, H5Element};
use std::path::Path;

/// Elements per chunk: what one read decompresses. Below 65,536, whose chunk dimension `hdf5-pure`
/// stores in four bytes: HDF5 2.0 expects three and refuses the file.
const CHUNK_ELEMENTS: u64 = 1 << 15;

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
    let times: Vec<i64> = events.t.iter().map(|t| t - t_offset).collect();
    let ms_to_idx = ms_to_idx(&times).map_err(wrong)?;
    let mut file = FileBuilder::new();
    let mut group = file.create_group("events");
    let narrow: Option<Vec<u32>> = times.iter().map(|&t| u32::try_from(t).ok()).collect();
    match narrow {
        Some(times) => add(&mut group, "t", &times, &[times.len() as u64]),
        None => add(&mut group, "t", &times, &[times.len() as u64]),
    }
    let n = [events.len() as u64];
    add(&mut group, "x", events.x, &n);
    add(&mut group, "y", events.y, &n);
    let p: Vec<u8> = events.on.iter().map(|on| u8::from(*on)).collect();
    add(&mut group, "p", &p, &n);
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
    file.write(path).map_err(unwritable)
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
fn ms_to_idx(times: &[i64]) -> Result<Vec<u64>, String> {
    let Some(&last) = times.last() else { return Ok(vec![0]) };
    let n_ms = last / 1000 + 1;
    if n_ms > MAX_SPAN_MS {
        return Err(format!(
            "the events span {} days; expected at most 100: is a stamp wrong? `evrig info` shows the gaps",
            n_ms / 86_400_000
        ));
    }
    let index = |ms: i64| times.partition_point(|&t| t < ms * 1000) as u64;
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
        for (name, start, step) in [("short", 1_700_000_000_000_000, 7), ("long", -5, 1 << 24)] {
            let path = directory.path().join(name);
            let event = |i: i64| Event {
                t: start + i * step,
                x: (i % 346) as u16,
                y: (i % 260) as u16,
                on: i % 3 == 0,
            };
            let events: Events = (0..1_000).map(event).collect();
            let values = Column::Float(vec![0.5; 18]);
            let group = SideGroup {
                name: "aps".into(),
                columns: vec![SideColumn { name: "homography", values, width: 9 }],
            };
            write_dsec(&path, events.as_slice(), &[group], "{}").unwrap();
            let read = read_events(&path, None).unwrap();
            assert_eq!(read.t_offset_us, start);
            let t = read.columns.into_iter().next().unwrap().1.into_integers().unwrap();
            assert!(t.iter().map(|t| t + start).eq(events.as_slice().t.iter().copied()), "{name}");
        }
    }

    #[test]
    fn the_index_names_the_first_event_of_each_millisecond() {
        let times = [0, 999, 1000, 1000, 4200];
        assert_eq!(ms_to_idx(&times).unwrap(), [0, 2, 4, 4, 4, 5]);
        assert_eq!(ms_to_idx(&[]).unwrap(), [0]);
        assert!(ms_to_idx(&[0, i64::MAX]).unwrap_err().contains("span"));
    }

    #[test]
    fn a_stream_without_events_is_a_file_with_empty_columns() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("none.h5");
        write_dsec(&path, Events::new().as_slice(), &[], "{}").unwrap();
        assert_eq!(read_events(&path, None).unwrap().n_rows(), 0);
    }
}
