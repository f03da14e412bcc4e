//! Event tables written by h5py are imported as streams.
//!
//! Needs a Python with `h5py` and `numpy`, named by `EVRIG_PYTHON`; skipped when unset.

use crate::sessions::python;
use evrig::event::Event;
use evrig::format::npy::ArrayWriter;
use evrig::session::import::{
    EventTableOptions, FrameTimes, ImportFrames, RawFrameOptions, import_frames,
};
use evrig::session::{Session, StreamName};
use std::process::Command;

#[test]
fn every_common_h5py_layout_gives_the_same_events() {
    let Some(python) = python("h5py") else { return };
    let directory = tempfile::tempdir().unwrap();
    let frames = directory.path().join("clip.npy");
    let mut writer = ArrayWriter::<u8>::create(&frames, &[2, 8, 12]).unwrap();
    writer.extend(&[50; 192]).unwrap();
    writer.finish().unwrap();
    // Only DSEC has an offset, which must be added.
    for (layout, offset) in [("dsec", 1_700_000_000_000_000), ("flat", 0), ("table", 0)] {
        let file = directory.path().join(format!("{layout}.h5"));
        let script = "tests/python/write_hdf5.py";
        let status = Command::new(&python).arg(script).arg(&file).arg(layout).status().unwrap();
        assert!(status.success(), "{script} failed");
        let times = directory.path().join(format!("{layout}.txt"));
        std::fs::write(&times, format!("t_us\n{offset}\n{}\n", offset + 10_000)).unwrap();
        let request = ImportFrames {
            frames: &frames,
            times: FrameTimes::File(times),
            frame_time_unit: None,
            events: Some(&file),
            events_name: StreamName::new("real").unwrap(),
            options: EventTableOptions::default(),
            raw: RawFrameOptions::default(),
        };
        let session = directory.path().join(layout);
        import_frames(&request, &session).unwrap();
        let (found, _) = Session::open(&session).unwrap().events("real").unwrap();
        let expected = (0..5_000_i64).map(|i| Event {
            t: offset + i * 7,
            x: (i % 12) as u16,
            y: (i % 8) as u16,
            on: (i / 3) % 2 == 1,
        });
        assert!(found.as_slice().iter().eq(expected), "{layout}");
    }
}
