//! Reads events in every format as `evrig import` does, and prints for each the million events per
//! second of processor time and the peak of memory in bytes per event, 13 of which are the events.
//!
//! `cargo run --release -p evrig-session --example reader_speed -- [MILLIONS]`

#![allow(clippy::expect_used, clippy::print_stdout)]

use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Compression, StreamSpec, Writer};
use evrig_format::npy::ArrayWriter;
use evrig_format::{hdf5, parquet, prophesee, rosbag2};
use evrig_session::import::{EventTableOptions, read_recording};
use rustix::time::{ClockId, clock_gettime};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::Command;

const SIZE: Size = Size::new(346, 260);

const FILES: [(&str, &str); 12] = [
    ("text, us, commas", "us.csv"),
    ("text, s, blanks", "s.txt"),
    ("EVT 3.0", "a.raw"),
    ("AEDAT 2", "2.aedat"),
    ("AEDAT 3.1", "3.aedat"),
    ("DAT", "a.dat"),
    ("ROS 2 MCAP, evt3, zstd", "a.mcap"),
    ("HDF5 (v2e)", "a.h5"),
    ("HDF5 (DSEC, gzip)", "b.h5"),
    ("Parquet, zstd", "a.parquet"),
    ("npy, N x 4, int64", "a.npy"),
    ("AEDAT4, LZ4", "4.aedat4"),
];

fn main() {
    let argument = std::env::args().nth(1);
    if let Some(path) = argument.as_ref().map(Path::new).filter(|path| path.is_file()) {
        return measure(path);
    }
    let millions: i64 = argument.and_then(|n| n.parse().ok()).unwrap_or(10);
    let directory = std::env::temp_dir().join("evrig-reader-speed");
    std::fs::create_dir_all(&directory).expect("a folder");
    write_all(&directory, millions * 1_000_000);
    let program = std::env::current_exe().expect("this program");
    for (name, file) in FILES {
        print!("{name:24}");
        std::io::stdout().flush().expect("a terminal");
        // A program of its own has no memory left from another file.
        let status = Command::new(&program).arg(directory.join(file)).status();
        assert!(status.is_ok_and(|status| status.success()), "{name}");
    }
    std::fs::remove_dir_all(&directory).expect("the folder is removed");
}

fn write_all(directory: &Path, n: i64) {
    let mut x = 1_u64;
    let events: Events = (0..n)
        .map(|i| {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let [a, b] = [(x >> 33) % 346, (x >> 40) % 260];
            Event { t: i / 3, x: a as u16, y: b as u16, on: x >> 63 == 1 }
        })
        .collect();
    let at = |name: &str| directory.join(name);
    write_texts(&events, &at("us.csv"), &at("s.txt")).expect("texts");
    prophesee::write_evt3(&at("a.raw"), events.as_slice(), SIZE).expect("EVT 3");
    write_words(&events, &at("2.aedat"), &at("3.aedat"), &at("a.dat")).expect("words");
    rosbag2::write_packets(&at("a.mcap"), "/e", events.as_slice(), SIZE).expect("MCAP");
    hdf5::write_v2e(&at("a.h5"), events.as_slice()).expect("HDF5");
    hdf5::write_dsec(&at("b.h5"), events.as_slice(), &[], "{}").expect("HDF5");
    parquet::write_events(&at("a.parquet"), events.as_slice(), &[]).expect("Parquet");
    let mut array = ArrayWriter::<i64>::create(&at("a.npy"), &[n as u64, 4]).expect("npy");
    for e in events.as_slice().iter() {
        array.extend(&[e.t, e.x.into(), e.y.into(), e.on.into()]).expect("npy");
    }
    array.finish().expect("npy");
    write_aedat4(&events, &at("4.aedat4"));
}

fn measure(path: &Path) {
    let mut best = f64::INFINITY;
    let [before, mut peak] = [resident(), 0];
    let mut n = 0;
    for _ in 0..3 {
        let begin = processor_seconds();
        let found = read_recording(path, None, &EventTableOptions::default()).expect("events");
        best = best.min(processor_seconds() - begin);
        n = found.events.len();
        peak = if peak == 0 { resident() } else { peak };
    }
    let (speed, bytes) = (n as f64 / best / 1e6, (peak - before) as f64 / n as f64);
    println!("{speed:7.1} Mev/s {bytes:7.1} B/event");
}

/// Processor time of all threads, which other programs on the machine do not change.
fn processor_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// The most bytes that this process has had in memory (Linux).
fn resident() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let line = status.lines().find(|line| line.starts_with("VmHWM")).expect("a peak");
    line.split_whitespace().nth(1).and_then(|kb| kb.parse().ok()).unwrap_or(0) * 1024
}

fn write_texts(events: &Events, us: &Path, s: &Path) -> std::io::Result<()> {
    let mut us = BufWriter::new(File::create(us)?);
    let mut s = BufWriter::new(File::create(s)?);
    us.write_all(b"t_us,x,y,p\n")?;
    s.write_all(b"# time in s\n")?;
    for e in events.as_slice().iter() {
        let p = u8::from(e.on);
        writeln!(us, "{},{},{},{p}", e.t, e.x, e.y)?;
        writeln!(s, "{}.{:06} {} {} {p}", e.t / 1_000_000, e.t % 1_000_000, e.x, e.y)?;
    }
    us.flush()?;
    s.flush()
}

fn write_words(events: &Events, aedat2: &Path, aedat3: &Path, dat: &Path) -> std::io::Result<()> {
    let mut two = BufWriter::new(File::create(aedat2)?);
    two.write_all(b"#!AER-DAT2.0\r\n# AEChip: Davis346\r\n")?;
    let mut three = BufWriter::new(File::create(aedat3)?);
    three.write_all(b"#!AER-DAT3.1\r\n#!END-HEADER\r\n")?;
    let mut dat = BufWriter::new(File::create(dat)?);
    dat.write_all(b"% Data file containing CD events\n% Height 260\n% Width 346\n\x0c\x08")?;
    for (i, e) in events.as_slice().iter().enumerate() {
        let (t, x, y, on) = (e.t as u32, u32::from(e.x), u32::from(e.y), u32::from(e.on));
        let address = ((259 - y) << 22) | ((345 - x) << 12) | (on << 11);
        two.write_all(&address.to_be_bytes())?;
        two.write_all(&t.to_be_bytes())?;
        if i.is_multiple_of(8_192) {
            let n = (events.len() - i).min(8_192) as u32;
            three.write_all(&[1, 0, 1, 0])?;
            for word in [8, 4, 0, n, n, n] {
                three.write_all(&word.to_le_bytes())?;
            }
        }
        three.write_all(&((x << 17) | (y << 2) | (on << 1) | 1).to_le_bytes())?;
        three.write_all(&t.to_le_bytes())?;
        dat.write_all(&t.to_le_bytes())?;
        dat.write_all(&(x | (y << 14) | (on << 28)).to_le_bytes())?;
    }
    two.flush()?;
    three.flush()?;
    dat.flush()
}

fn write_aedat4(events: &Events, path: &Path) {
    let spec = StreamSpec::events(SIZE, "speed");
    let mut writer = Writer::create(path, Compression::Lz4, &[spec]).expect("AEDAT4");
    writer.write_events(0, events.as_slice()).expect("AEDAT4");
    writer.finish().expect("AEDAT4");
}
