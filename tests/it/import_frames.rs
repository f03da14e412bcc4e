//! Frames and events from third-party files become sessions, or give one clear error.

use crate::sessions::{evrig, run};
use evrig::event::{Event, Events};
use evrig::format::npy::{ArrayWriter, NpzWriter};
use evrig::frame::Luminance;
use evrig::session::Session;
use std::path::{Path, PathBuf};

/// A bright bar that moves across a 12 x 8 grid, one column per frame.
fn clip(directory: &Path, n: u64) -> PathBuf {
    let path = directory.join("clip.npy");
    let mut writer = ArrayWriter::<u8>::create(&path, &[n, 8, 12]).unwrap();
    for k in 0..n {
        let frame: Vec<u8> = (0..96).map(|i| if i % 12 == k % 12 { 200 } else { 40 }).collect();
        writer.extend(&frame).unwrap();
    }
    writer.finish().unwrap();
    path
}

fn some_events() -> Events {
    (0..50_u16)
        .map(|i| Event { t: 1_000 * i64::from(i), x: i % 12, y: i % 8, on: i % 3 == 0 })
        .collect()
}

fn rows(events: &Events) -> Vec<i64> {
    let row = |e: Event| [e.t, e.x.into(), e.y.into(), e.on.into()];
    events.as_slice().iter().flat_map(row).collect()
}

/// Imports; the exit code and both outputs.
fn import(frames: &Path, session: &Path, more: &[&str]) -> (i32, String) {
    run(evrig().args(["import", "frames"]).arg(frames).arg("--out").arg(session).args(more))
}

#[test]
fn events_are_read_from_every_supported_table() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let frames = clip(root, 12);
    let events = some_events();
    let n = events.len() as u64;

    let mut table = NpzWriter::create(&root.join("table.npz")).unwrap();
    table.add("events", &[n, 4], rows(&events)).unwrap();
    table.finish().unwrap();
    let mut columns = NpzWriter::create(&root.join("columns.npz")).unwrap();
    let slice = events.as_slice();
    columns.add("t", &[n], slice.t.iter().map(|t| *t as f64)).unwrap();
    columns.add("x", &[n], slice.x.iter().copied()).unwrap();
    columns.add("y", &[n], slice.y.iter().copied()).unwrap();
    columns.add("p", &[n], slice.on.iter().map(|on| if *on { 1_i64 } else { -1 })).unwrap();
    columns.finish().unwrap();
    let mut plain = ArrayWriter::<i64>::create(&root.join("plain.npy"), &[n, 4]).unwrap();
    plain.extend(&rows(&events)).unwrap();
    plain.finish().unwrap();
    let line = |e: Event| format!("{},{},{},{}\n", e.x, e.y, u8::from(e.on), e.t);
    let text: String = slice.iter().map(line).collect();
    std::fs::write(root.join("heading.csv"), format!("x,y,p,t\n{text}")).unwrap();
    let line = |e: Event| format!("{} {} {} {}\n", e.t, e.x, e.y, u8::from(e.on));
    let text: String = slice.iter().map(line).collect();
    std::fs::write(root.join("blanks.txt"), format!("# the layout of v2e\n{text}")).unwrap();

    let mut dsec = hdf5_pure::FileBuilder::new();
    let mut group = dsec.create_group("events");
    let t: Vec<u32> = slice.t.iter().map(|t| u32::try_from(*t).unwrap()).collect();
    group.create_dataset("t").with_data(&t);
    group.create_dataset("x").with_data(slice.x);
    group.create_dataset("y").with_data(slice.y);
    let p: Vec<u8> = slice.on.iter().map(|on| u8::from(*on)).collect();
    group.create_dataset("p").with_data(&p);
    dsec.add_group(group.finish());
    dsec.create_dataset("t_offset").with_data(&[0_i64]).with_shape(&[]);
    dsec.write(root.join("dsec.h5")).unwrap();

    for file in ["table.npz", "columns.npz", "plain.npy", "heading.csv", "blanks.txt", "dsec.h5"] {
        let session = root.join(format!("session-{file}"));
        let path = root.join(file);
        let more = ["--fps", "120", "--events", path.to_str().unwrap()];
        let (code, printed) = import(&frames, &session, &more);
        assert_eq!(code, 0, "{file}: {printed}");
        let (found, _) = Session::open(&session).unwrap().events("real").unwrap();
        assert_eq!(found, events, "{file}");
    }
}

#[test]
fn frames_keep_their_times_and_values() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let frames = clip(root, 3);
    std::fs::write(
        root.join("times.csv"),
        "frame,t_us\n0,1700000000000000\n1,1700000000008333\n2,1700000000016666\n",
    )
    .unwrap();
    let session = root.join("session");
    let times = root.join("times.csv");
    let (code, printed) = import(&frames, &session, &["--timestamps", times.to_str().unwrap()]);
    assert_eq!(code, 0, "{printed}");
    let session = Session::open(&session).unwrap();
    let found: Vec<Luminance> =
        session.luminance("frames").unwrap().collect::<Result<_, _>>().unwrap();
    let times: Vec<i64> = found.iter().map(|frame| frame.t_us).collect();
    assert_eq!(times, [1_700_000_000_000_000, 1_700_000_000_008_333, 1_700_000_000_016_666]);
    assert_eq!(found[1].values[..3], [40.0, 200.0, 40.0]);
}

#[test]
fn a_folder_of_images_is_read_in_numerical_order() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let folder = root.join("images");
    std::fs::create_dir(&folder).unwrap();
    for k in [9_u8, 10, 8] {
        let image = image::GrayImage::from_pixel(4, 3, image::Luma([k]));
        image.save(folder.join(format!("frame{k}.png"))).unwrap();
    }
    let session = root.join("session");
    let (code, printed) = import(&folder, &session, &["--fps", "100"]);
    assert_eq!(code, 0, "{printed}");
    let session = Session::open(&session).unwrap();
    let found: Vec<Luminance> =
        session.luminance("frames").unwrap().collect::<Result<_, _>>().unwrap();
    let values: Vec<f32> = found.iter().map(|frame| frame.values[0]).collect();
    assert_eq!(values, [8.0, 9.0, 10.0]);
    assert_eq!(found[2].t_us, 20_000);
}

#[test]
fn events_outside_the_grid_or_out_of_order_are_counted_as_losses() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let frames = clip(root, 3);
    std::fs::write(root.join("events.csv"), "10,1,1,1\n20,12,1,1\n5,2,2,0\n30,-1,0,0\n").unwrap();
    let session = root.join("session");
    let events = root.join("events.csv");
    let (code, printed) =
        import(&frames, &session, &["--fps", "100", "--events", events.to_str().unwrap()]);
    assert_eq!(code, 3, "{printed}");
    assert!(printed.contains("2 events off the 12 x 8 grid"), "{printed}");
    assert!(printed.contains("1 events out of order"), "{printed}");
    let (found, _) = Session::open(&session).unwrap().events("real").unwrap();
    assert_eq!(found.as_slice().t, [5, 10]);
}

/// The same frames with a header that announces more than memory could hold.
fn many_frames(frames: &Path) -> PathBuf {
    let mut bytes = std::fs::read(frames).unwrap();
    let at = bytes.windows(3).position(|bytes| bytes == b"(3,").unwrap();
    let shape = b"(99999999999999999, 8, 12), }";
    bytes[at..at + shape.len()].copy_from_slice(shape);
    let many = frames.with_file_name("many.npy");
    std::fs::write(&many, bytes).unwrap();
    many
}

#[test]
fn invalid_input_gives_a_one_line_error_and_no_session() {
    let directory = tempfile::tempdir().unwrap();
    let root = directory.path();
    let frames = clip(root, 3);
    let write = |name: &str, text: &str| {
        std::fs::write(root.join(name), text).unwrap();
        root.join(name).to_str().unwrap().to_owned()
    };
    let flat = root.join("flat.npy");
    ArrayWriter::<u8>::create(&flat, &[0]).unwrap().finish().unwrap();
    let float = root.join("float.npy");
    let mut writer = ArrayWriter::<f32>::create(&float, &[1, 1, 1]).unwrap();
    writer.extend(&[0.5]).unwrap();
    writer.finish().unwrap();
    let no_frame = root.join("no_frame.npy");
    ArrayWriter::<u8>::create(&no_frame, &[0, 8, 12]).unwrap().finish().unwrap();
    let many = many_frames(&frames);
    let cases: Vec<(&Path, Vec<String>, &str)> = vec![
        (&frames, vec!["--timestamps".into(), write("two.txt", "0\n1\n")], "2 times for 3 frames"),
        (
            &frames,
            vec!["--timestamps".into(), write("back.txt", "0\n9\n9\n")],
            "frame 2 at 9000 us is not later",
        ),
        (&frames, vec!["--timestamps".into(), write("word.txt", "0\n5\nx\n")], "line 3"),
        (&flat, vec!["--fps".into(), "10".into()], "expected N x H x W"),
        (&float, vec!["--fps".into(), "10".into()], "uint8 or uint16"),
        (&no_frame, vec!["--fps".into(), "10".into()], "holds no frame"),
        (&many, vec!["--fps".into(), "10".into()], "ends before the data"),
        (
            &frames,
            vec!["--fps".into(), "10".into(), "--events".into(), write("p.csv", "1,1,1,7\n")],
            "polarity 7",
        ),
        (
            &frames,
            vec![
                "--fps".into(),
                "10".into(),
                "--events".into(),
                write("e.csv", "1,1,1,1\n2,nan,1,1\n"),
            ],
            "line 2",
        ),
        (&frames, vec!["--fps".into(), "10".into(), "--events".into(), write("e.mat", "")], ".mat"),
        (Path::new("no/such/clip.npy"), vec!["--fps".into(), "10".into()], "no such file"),
    ];
    for (frames, more, expected) in cases {
        let session = root.join("session");
        let more: Vec<&str> = more.iter().map(String::as_str).collect();
        let (code, printed) = import(frames, &session, &more);
        assert_eq!(code, 1, "{more:?}: {printed}");
        assert!(printed.contains(expected), "{more:?}: {printed}");
        assert!(printed.starts_with("error: ") && printed.lines().count() == 1, "{printed}");
        assert!(!session.exists(), "{more:?} left a session behind");
    }
    let (code, printed) = import(&frames, &root.join("s"), &["--fps", "0"]);
    assert_eq!(code, 2, "{printed}");
}
