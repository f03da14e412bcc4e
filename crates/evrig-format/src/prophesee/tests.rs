//! Words written by hand, as the published layouts describe them, give the planted events.

use super::*;
use evrig_core::event::Events;

fn read(name: &str, header: &str, words: &[u8]) -> CameraEvents {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(name);
    std::fs::write(&path, [header.as_bytes(), words].concat()).unwrap();
    CameraEvents::gather(&path, None, |sink| super::read(&path, sink)).unwrap()
}

fn events(rows: &[(i64, u16, u16, bool)]) -> Events {
    rows.iter().map(|&(t, x, y, on)| Event { t, x, y, on }).collect()
}

#[test]
fn evt2_events_have_a_low_and_a_high_time() {
    let word = |kind: u32, t: u32, x: u32, y: u32| (kind << 28) | (t << 22) | (x << 11) | y;
    let words = [
        word(1, 3, 1, 1),
        (8 << 28) | 1_000,
        word(1, 5, 640, 479),
        word(0, 63, 0, 7),
        (8 << 28) | 0xfff_ffff,
        (8 << 28),
        word(1, 0, 2, 2),
    ];
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let found = read("a.raw", "% evt 2.0\n% geometry 1280x720\n% end\n", &bytes);
    let wrapped = (1_i64 << 28) << 6;
    let expected = [(64_005, 640, 479, true), (64_063, 0, 7, false), (wrapped, 2, 2, true)];
    assert_eq!(found.events, events(&expected));
    assert_eq!(found.size, Some(Size::new(1280, 720)));
    assert_eq!(found.left_out, [("events before the first full time".to_owned(), 1)]);
    let cut = read("a.raw", "% evt 2.0\n", &bytes[..11]);
    assert!(cut.damage.unwrap().contains("3 bytes"));
}

#[test]
fn evt21_words_hold_many_events() {
    let word = |kind: u64, t: u64, x: u64, y: u64, valid: u64| {
        (kind << 60) | (t << 54) | (x << 43) | (y << 32) | valid
    };
    let words = [(8_u64 << 60) | (2 << 32), word(1, 1, 64, 9, 0x8000_0001)];
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let found = read("a.raw", "% format EVT21;height=720;width=1280\n% end\n", &bytes);
    assert_eq!(found.events, events(&[(129, 64, 9, true), (129, 95, 9, true)]));
}

#[test]
fn evt3_vectors_and_wraps_are_decoded() {
    let words: [u16; 12] = [
        0x8001,
        0x6002,
        0x0005,
        0x2803, // one ON event at (3, 5)
        0x3000 | 100,
        0x4003,
        0x5080, // OFF at 100, 101 and 100 + 12 + 7
        0x8fff,
        0x8000,
        0x6001,
        0x2004,
        0xa000, // behind a wrap
    ];
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let found = read("a.raw", "% evt 3.0\n% format EVT3;height=320;width=320\n% end\n", &bytes);
    let t = 4_096 + 2;
    let expected = [
        (t, 3, 5, true),
        (t, 100, 5, false),
        (t, 101, 5, false),
        (t, 119, 5, false),
        ((1 << 24) + 1, 4, 5, false),
    ];
    assert_eq!(found.events, events(&expected));
    assert_eq!(found.left_out, [("trigger edges".to_owned(), 1)]);
}

#[test]
fn a_lower_half_that_steps_back_carries_where_the_upper_one_is_missing() {
    let words: [u16; 8] = [0x8000, 0x6ff0, 0x0001, 0x2001, 0x6010, 0x2002, 0x600f, 0x2003];
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let found = read("a.raw", "% evt 3.0 \n", &bytes);
    assert_eq!(found.events.as_slice().t, [0xff0, 0x1010, 0x100f]);
    let later = read("a.raw", "% evt 3.0\n% t0 91\n", &bytes);
    assert_eq!(later.events.as_slice().t, [0xff0 + 91, 0x1010 + 91, 0x100f + 91]);
}

#[test]
fn dat_events_are_eight_bytes() {
    let event = |t: u32, x: u32, y: u32, p: u32| [t, x | (y << 14) | (p << 28)];
    let words = [event(u32::MAX, 303, 239, 1), event(4, 1, 2, 0)].concat();
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let header = "% Data file containing CD events\n% Version 2\n% Height 240\n% Width 304\n";
    let found = read("a.dat", header, &[&[0x0c, 8][..], &bytes].concat());
    let t = i64::from(u32::MAX);
    assert_eq!(found.events, events(&[(t, 303, 239, true), (t + 5, 1, 2, false)]));
    assert_eq!(found.size, Some(Size::new(304, 240)));
}

/// Whole words of `n_bytes` before a cut give their events, and a part of one is stated.
fn is_read_up_to_every_cut(name: &str, header: &str, words: &[u8], n_bytes: usize) {
    let whole = read(name, header, words);
    assert!(whole.damage.is_none() && !whole.events.is_empty(), "{name}");
    for end in 0..words.len() {
        let cut = read(name, header, &words[..end]);
        let n = cut.events.len();
        assert_eq!(cut.events.as_slice(), whole.events.as_slice().range(0, n), "{name}: {end}");
        let up_to_a_word = read(name, header, &words[..end / n_bytes * n_bytes]);
        assert_eq!(cut.events, up_to_a_word.events, "{name}: {end}");
        let is_stated = cut.damage.is_some_and(|what| what.contains("the file is cut"));
        assert_eq!(is_stated, end % n_bytes > 0, "{name}: {end}");
    }
}

#[test]
fn files_cut_anywhere_are_read_up_to_the_cut() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.raw");
    let planted: Events =
        (0..40).map(|i| Event { t: 700 * i, x: i as u16, y: 3, on: i % 3 == 0 }).collect();
    write_evt3(&path, planted.as_slice(), Size::new(64, 8)).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.windows(6).position(|part| part == b"% end\n").unwrap() + 6;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    is_read_up_to_every_cut("a.raw", &header, &bytes[end..], 2);
    let evt2: Vec<u8> = (0..20_u32)
        .flat_map(|i| [(8 << 28) | i, (1 << 28) | (i << 22) | (i << 11) | 5])
        .flat_map(u32::to_le_bytes)
        .collect();
    is_read_up_to_every_cut("a.raw", "% evt 2.0\n% end\n", &evt2, 4);
    let evt21: Vec<u8> = (0..20_u64)
        .flat_map(|i| [(8 << 60) | (i << 32), (1 << 60) | (i << 43) | (5 << 32) | 0b101])
        .flat_map(u64::to_le_bytes)
        .collect();
    is_read_up_to_every_cut("a.raw", "% evt 2.1\n% end\n", &evt21, 8);
    let dat: Vec<u8> =
        (0..20_u32).flat_map(|i| [9 * i, i | (5 << 14)]).flat_map(u32::to_le_bytes).collect();
    is_read_up_to_every_cut("a.dat", "% Data file containing CD events\n\u{c}\u{8}", &dat, 8);
}

#[test]
fn a_file_cut_in_its_header_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.dat");
    for (text, expected) in [
        ("% Data file containing CD events\n\u{c}", "cut in its header"),
        ("% da", "holds no events"),
    ] {
        std::fs::write(&path, text).unwrap();
        let found = CameraEvents::gather(&path, None, |sink| super::read(&path, sink));
        let error = found.unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}
