//! Writes the layout of v2e: one dataset `events` of N x 4, uint32, with the columns t (us), x, y, p.

use super::Hdf5Error;
use evrig_core::event::EventSlice;
use hdf5_pure::FileBuilder;
use std::path::Path;

/// Writes events. The dataset is one block without compression, which every version of HDF5 reads.
///
/// # Errors
/// When a time is not in the 32 bits of the layout, or the file cannot be written.
pub fn write_v2e(path: &Path, events: EventSlice<'_>) -> Result<(), Hdf5Error> {
    let wrong = |what: String| Hdf5Error { path: path.to_owned(), what };
    let mut rows = Vec::with_capacity(4 * events.len());
    for event in events.iter() {
        let t = u32::try_from(event.t).map_err(|_| {
            let t = event.t;
            wrong(format!(
                "an event at {t} us; v2e's layout holds 0 to 4294967295 us: take --format hdf5"
            ))
        })?;
        rows.extend([t, event.x.into(), event.y.into(), event.on.into()]);
    }
    let mut file = FileBuilder::new();
    file.create_dataset("events").with_data(&rows).with_shape(&[events.len() as u64, 4]);
    file.write(path).map_err(|error| wrong(format!("cannot be written: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hdf5::read_events;
    use crate::npy::Column;
    use evrig_core::event::{Event, Events};

    #[test]
    fn what_is_written_is_read_back_and_times_beyond_32_bits_are_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.h5");
        let events: Events =
            (0..100).map(|i| Event { t: i * 40_000_000, x: 7, y: 9, on: i % 2 == 0 }).collect();
        write_v2e(&path, events.as_slice()).unwrap();
        let read = read_events(&path, None).unwrap();
        let t: Vec<i64> = (0..100).map(|i| i * 40_000_000).collect();
        assert_eq!(read.columns[0].1, Column::Int(t));
        assert_eq!(read.columns[3].1, Column::Int([1, 0].repeat(50)));
        let late: Events = [Event { t: 1 << 32, x: 0, y: 0, on: true }].into_iter().collect();
        let error = write_v2e(&path, late.as_slice()).unwrap_err().to_string();
        assert!(error.contains("4294967296") && error.contains("--format hdf5"), "{error}");
    }

    #[test]
    fn a_cut_file_is_read_up_to_the_cut_or_refused_where_its_description_is_cut() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a.h5");
        let events: Events = (0..100).map(|i| Event { t: i, x: 7, y: 9, on: true }).collect();
        write_v2e(&path, events.as_slice()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let mut n_read = Vec::new();
        for end in 0..whole.len() {
            std::fs::write(&path, &whole[..end]).unwrap();
            let Ok(read) = read_events(&path, None) else { continue };
            n_read.push(read.n_rows());
            let Column::Short(t) = &read.columns[0].1 else { panic!("short") };
            assert!(t.iter().copied().eq(0..read.n_rows() as i16), "{end}");
            assert_eq!(read.damage.is_some(), read.n_rows() < 100, "{end}");
        }
        assert!(n_read.contains(&1) && n_read.contains(&99), "{n_read:?}");
    }
}
