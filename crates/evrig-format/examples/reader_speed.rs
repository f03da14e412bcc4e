//! Writes events in every format that the library writes, reads them back and prints events per second.
//!
//! `cargo run --release -p evrig-format --example reader_speed -- [MILLIONS]`

#![allow(clippy::expect_used, clippy::print_stdout)]

use evrig_core::event::{Event, Events};
use evrig_core::geometry::Size;
use evrig_format::aedat4::{Compression, Content, Reader, StreamSpec, Writer};
use evrig_format::npy::{ArrayReader, ArrayWriter};
use evrig_format::{
    CameraFileError, RecordingNotes, RecordingSink, aedat2, aedat3, hdf5, parquet, prophesee,
    rosbag2, text,
};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

const SIZE: Size = Size::new(346, 260);

fn main() {
    let millions = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(10);
    let n = millions * 1_000_000_i64;
    let mut x = 1_u64;
    let events: Events = (0..n)
        .map(|i| {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let [a, b] = [(x >> 33) % 346, (x >> 40) % 260];
            Event { t: i / 3, x: a as u16, y: b as u16, on: x >> 63 == 1 }
        })
        .collect();
    let directory = std::env::temp_dir().join("evrig-reader-speed");
    std::fs::create_dir_all(&directory).expect("a folder");
    let at = |name: &str| directory.join(name);
    write_texts(&events, &at("us.csv"), &at("s.txt")).expect("texts");
    measure("text, us, commas", &at("us.csv"), n, |path| {
        text::read_table(path).expect("a table").n_rows() as i64
    });
    measure("text, s, blanks", &at("s.txt"), n, |path| {
        text::read_table(path).expect("a table").n_rows() as i64
    });
    prophesee::write_evt3(&at("a.raw"), events.as_slice(), SIZE).expect("EVT 3");
    measure("EVT 3.0", &at("a.raw"), n, |path| count(|sink| prophesee::read(path, sink)));
    write_words(&events, &at("2.aedat"), &at("3.aedat"), &at("a.dat")).expect("words");
    measure("AEDAT 2", &at("2.aedat"), n, |path| count(|sink| aedat2::read(path, None, sink)));
    measure("AEDAT 3.1", &at("3.aedat"), n, |path| count(|sink| aedat3::read(path, sink)));
    measure("DAT", &at("a.dat"), n, |path| count(|sink| prophesee::read(path, sink)));
    rosbag2::write_packets(&at("a.mcap"), "/e", events.as_slice(), SIZE).expect("MCAP");
    measure("ROS 2 MCAP, evt3, zstd", &at("a.mcap"), n, |path| {
        count(|sink| rosbag2::read(path, sink))
    });
    hdf5::write_v2e(&at("a.h5"), events.as_slice()).expect("HDF5");
    measure("HDF5 (v2e)", &at("a.h5"), n, |path| {
        hdf5::read_events(path, None).expect("a table").n_rows() as i64
    });
    hdf5::write_dsec(&at("b.h5"), events.as_slice(), &[], "{}").expect("HDF5");
    measure("HDF5 (DSEC, gzip)", &at("b.h5"), n, |path| {
        hdf5::read_events(path, None).expect("a table").n_rows() as i64
    });
    parquet::write_events(&at("a.parquet"), events.as_slice(), &[]).expect("Parquet");
    measure("Parquet", &at("a.parquet"), n, |path| {
        parquet::read_table(path).expect("a table").n_rows() as i64
    });
    let mut array = ArrayWriter::<i64>::create(&at("a.npy"), &[n as u64, 4]).expect("npy");
    for e in events.as_slice().iter() {
        array.extend(&[e.t, e.x.into(), e.y.into(), e.on.into()]).expect("npy");
    }
    array.finish().expect("npy");
    measure("npy, N x 4, int64", &at("a.npy"), n, |path| {
        let array = ArrayReader::open(path).and_then(ArrayReader::read_all).expect("an array");
        array.fields[0].1.len() as i64 / 4
    });
    write_aedat4(&events, &at("4.aedat4"));
    measure("AEDAT4, LZ4", &at("4.aedat4"), n, |path| {
        let packets = Reader::open(path).expect("AEDAT4").map_while(Result::ok);
        packets.map(|packet| n_events(&packet.content)).sum()
    });
    std::fs::remove_dir_all(&directory).expect("the folder is removed");
}

fn measure(name: &str, path: &Path, n: i64, read: impl Fn(&Path) -> i64) {
    let mut best = f64::INFINITY;
    for _ in 0..3 {
        let begin = Instant::now();
        assert_eq!(read(path), n, "{name}");
        best = best.min(begin.elapsed().as_secs_f64());
    }
    println!("{name:24} {:7.1} Mev/s", n as f64 / best / 1e6);
}

fn n_events(content: &Content) -> i64 {
    match content {
        Content::Events(events) => events.len() as i64,
        _ => 0,
    }
}

fn count(read: impl Fn(&mut RecordingSink<'_>) -> Result<RecordingNotes, CameraFileError>) -> i64 {
    let mut n = 0;
    read(&mut |_, content| {
        n += n_events(&content);
        Ok(())
    })
    .expect("a recording");
    n
}

fn write_texts(events: &Events, us: &Path, s: &Path) -> std::io::Result<()> {
    let mut us = BufWriter::new(File::create(us)?);
    let mut s = BufWriter::new(File::create(s)?);
    us.write_all(b"t,x,y,p\n")?;
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
