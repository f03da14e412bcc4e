//! Tables whose meaning is planted come back as it is, or are refused.

use super::*;
use evrig_format::npy::{ArrayWriter, NpzWriter};

const N: usize = 200;

/// Planted events: time in us, column, row, ON.
fn planted() -> Vec<[i64; 4]> {
    (0..N as i64).map(|k| [500 * k, k * 7 % 12, k * 5 % 8, k % 2]).collect()
}

fn table(order: [usize; 4], names: [&str; 4], t: impl Fn(i64) -> f64) -> StoredTable {
    let rows = planted();
    let column = |i: usize| {
        let values = rows.iter().map(|row| if i == 0 { t(row[0]) } else { row[i] as f64 });
        let values: Vec<f64> = values.collect();
        match values.iter().all(|value| value.fract() == 0.0) {
            true => Column::Int(values.iter().map(|value| *value as i64).collect()),
            false => Column::Float(values),
        }
    };
    StoredTable::of_columns(order.map(|i| (names[i].to_owned(), column(i))).to_vec())
}

const UNNAMED: [&str; 4] = [""; 4];
const USUAL: [usize; 4] = [0, 1, 2, 3];
const FRAMES: EventSetting =
    EventSetting { size: Some(Size::new(12, 8)), frames_us: Some([0, 90_000]) };

fn read(table: StoredTable, setting: EventSetting) -> Result<ImportedEvents, String> {
    interpret(table, "real", &EventTableOptions::default(), setting)
}

fn is_planted(found: &ImportedEvents) {
    let rows: Vec<[i64; 4]> = found
        .events
        .as_slice()
        .iter()
        .map(|e| [e.t, e.x.into(), e.y.into(), e.on.into()])
        .collect();
    assert_eq!(rows, planted());
}

#[test]
fn seconds_milliseconds_and_nanoseconds_are_found_beside_frames() {
    for scale in [1e-6, 1e-3, 1.0, 1e3] {
        let found = read(table(USUAL, UNNAMED, |t| t as f64 * scale), FRAMES);
        let found = found.unwrap_or_else(|error| panic!("{scale}: {error}"));
        is_planted(&found);
        assert!(found.decisions[1].contains("times are in"), "{:?}", found.decisions);
    }
}

#[test]
fn without_frames_a_unit_is_found_or_two_are_named() {
    let alone = EventSetting { size: FRAMES.size, frames_us: None };
    for (scale, expected) in [(1e-6, None), (1.0, None), (1e-3, Some("s or ms")), (1e3, Some("ns"))]
    {
        let found = read(table(USUAL, UNNAMED, |t| t as f64 * scale), alone);
        match (found, expected) {
            (Ok(found), None) => is_planted(&found),
            (Err(error), Some(units)) => {
                assert!(error.contains(units) && error.contains("--time-unit"), "{error}");
            }
            (found, _) => panic!("{scale}: {found:?}"),
        }
    }
}

#[test]
fn every_order_of_unnamed_columns_is_found_from_the_data() {
    for order in [[0, 1, 2, 3], [1, 2, 3, 0], [1, 2, 0, 3], [3, 0, 1, 2], [0, 3, 1, 2]] {
        let found = read(table(order, UNNAMED, |t| t as f64), FRAMES);
        is_planted(&found.unwrap_or_else(|error| panic!("{order:?}: {error}")));
    }
}

#[test]
fn headings_name_columns_and_units() {
    for (names, scale) in [
        (["timestamp_us", "x", "y", "polarity"], 1.0),
        (["time [ns]", "xs", "ys", "pol"], 1e3),
        (["t (s)", "x", "y", "p"], 1e-6),
        (["ts", "X", "Y", "on"], 1.0),
    ] {
        let found = read(table([2, 3, 1, 0], names, |t| t as f64 * scale), FRAMES);
        is_planted(&found.unwrap_or_else(|error| panic!("{names:?}: {error}")));
    }
}

#[test]
fn times_since_1970_beside_frames_from_zero_do_not_overlap() {
    let error = read(table(USUAL, UNNAMED, |t| 1_461_581_614.5 + t as f64 * 1e-6), FRAMES);
    let error = error.unwrap_err();
    assert!(error.contains("do not overlap") && error.contains("0 to 90000 us"), "{error}");
    let options = EventTableOptions { begin_us: Some(0), ..EventTableOptions::default() };
    let moved = table(USUAL, UNNAMED, |t| 1_461_581_614.5 + t as f64 * 1e-6);
    let found = interpret(moved, "real", &options, FRAMES).unwrap();
    assert_eq!(found.events.as_slice().t[199], 99_500);
}

#[test]
fn tables_of_no_event_camera_are_refused() {
    let shared = read(table(USUAL, ["t_us", "x", "y", "p"], |t| t as f64 * 1e-6), FRAMES);
    assert!(shared.unwrap_err().contains("200 of 200 events are at 0 us"));
    let mut fractional = table(USUAL, ["t", "x", "y", "p"], |t| t as f64);
    fractional.columns[1].1 = Column::Float((0..N).map(|k| k as f64 % 12.0 + 0.5).collect());
    assert!(read(fractional, FRAMES).unwrap_err().contains("event 0 has x = 0.5"));
    let mut line = table(USUAL, ["t", "x", "y", "p"], |t| t as f64);
    line.columns[1].1 = Column::Int(vec![3; N]);
    assert!(read(line, FRAMES).unwrap_err().contains("the line x = 3"));
    let mut three = table(USUAL, ["t", "x", "y", "p"], |t| t as f64);
    three.columns[3].1 = Column::Int((0..N as i64).map(|k| k % 3 - 1).collect());
    assert!(read(three, FRAMES).unwrap_err().contains("--polarity"));
    let large = EventSetting { size: Some(Size::new(2, 2)), ..FRAMES };
    let named = table(USUAL, ["t", "x", "y", "p"], |t| t as f64);
    assert!(read(named, large).unwrap_err().contains("off the 2 x 2 grid"));
}

#[test]
fn one_high_stamp_changes_neither_the_unit_nor_the_others() {
    let mut stray = table(USUAL, ["t", "x", "y", "p"], |t| t as f64);
    let Column::Int(t) = &mut stray.columns[0].1 else { panic!("whole numbers") };
    t[100] = 1_000_000_000_000;
    let found = read(stray, FRAMES).unwrap();
    assert_eq!((found.events.len(), found.losses[0].count), (199, 1));
    assert_eq!(found.events.as_slice().t[198], 99_500);
}

#[test]
fn rows_named_columns_are_refused() {
    let turned = table([0, 2, 1, 3], ["t", "y", "x", "p"], |t| t as f64);
    let error = read(turned, FRAMES).unwrap_err();
    assert!(error.contains("another order"), "{error}");
}

#[test]
fn minus_one_is_off_also_where_it_is_wrapped() {
    for off in [-1, 255, 4_294_967_295] {
        let mut wrapped = table(USUAL, UNNAMED, |t| t as f64);
        let value = |k: i64| if k % 2 == 1 { 1 } else { off };
        wrapped.columns[3].1 = Column::Int((0..N as i64).map(value).collect());
        is_planted(&read(wrapped, FRAMES).unwrap());
    }
}

#[test]
fn a_restarted_clock_is_parted() {
    let mut restarted = table(USUAL, ["t_us", "x", "y", "p"], |t| t as f64 + 1_000_000.0);
    let Column::Int(t) = &mut restarted.columns[0].1 else { panic!("whole numbers") };
    t[..20].iter_mut().for_each(|t| *t += 900_000_000);
    let alone = EventSetting { size: FRAMES.size, frames_us: None };
    let found = read(restarted, alone).unwrap();
    assert_eq!((found.events.len(), found.losses[0].count), (180, 20));
}

#[test]
fn a_cut_table_gives_its_whole_rows_and_a_loss() {
    let directory = tempfile::tempdir().unwrap();
    let [npy, csv] = ["a.npy", "a.csv"].map(|name| directory.path().join(name));
    let mut writer = ArrayWriter::<i64>::create(&npy, &[N as u64, 4]).unwrap();
    planted().iter().for_each(|row| writer.extend(row).unwrap());
    writer.finish().unwrap();
    let line = |[t, x, y, p]: [i64; 4]| format!("{t},{x},{y},{p}\n");
    std::fs::write(&csv, planted().into_iter().map(line).collect::<String>()).unwrap();
    for path in [npy, csv] {
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 5]).unwrap();
        let found = super::read(&path, "real", &EventTableOptions::default(), FRAMES).unwrap();
        assert_eq!(found.events.as_slice().t.last(), Some(&99_000), "{}", path.display());
        assert!(found.losses[0].what.contains("the file is cut"), "{:?}", found.losses);
    }
}

#[test]
fn columns_before_the_cut_of_an_archive_are_no_table() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.npz");
    let mut npz = NpzWriter::create(&path).unwrap();
    npz.add("t", &[N as u64], 0..N as i64).unwrap();
    npz.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let error = super::read(&path, "real", &EventTableOptions::default(), FRAMES).unwrap_err();
    assert!(error.to_string().contains("is cut, copy or write it again"), "{error}");
}

#[test]
fn options_outweigh_the_data() {
    let options = EventTableOptions {
        time_unit: Some("ms".parse().unwrap()),
        columns: Some("-pyxt".parse().unwrap()),
        polarity: Some("0,1".parse().unwrap()),
        ..EventTableOptions::default()
    };
    let mut five = table([3, 2, 1, 0], ["a", "b", "c", "d"], |t| t as f64 / 1e3);
    five.columns.insert(0, (String::new(), Column::Int(vec![7; N])));
    let found = interpret(five, "real", &options, FRAMES).unwrap();
    assert_eq!(found.events.as_slice().t[3], 1_500);
    assert!(found.events.as_slice().on[0] && !found.events.as_slice().on[1]);
}
