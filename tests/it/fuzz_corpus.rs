//! What the fuzzers kept, and thousands of altered copies of it, for every parser that takes bytes
//! from outside.
//!
//! `EVRIG_MUTATIONS` says how many copies of each input (20).

use crate::inputs;

use std::path::Path;

/// Inputs longer than this are altered in their first bytes only; the rest would be copied in vain.
const MOST_BYTES: usize = 1 << 16;

/// The kept inputs of one parser, in the order of their names.
fn corpus(name: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new("fuzz/corpus").join(name);
    let files = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let mut paths: Vec<_> = files.map(|file| file.unwrap().path()).collect();
    paths.sort();
    paths
        .into_iter()
        .map(|path| (path.display().to_string(), std::fs::read(path).unwrap()))
        .collect()
}

/// A generator of alterations: splitmix64.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// One alteration: a bit, a byte, a length that is absurd, a cut, a part twice, a part of another.
fn altered(bytes: &[u8], other: &[u8], draws: &mut Draws) -> Vec<u8> {
    let mut bytes = bytes[..bytes.len().min(MOST_BYTES)].to_vec();
    for _ in 0..1 + draws.below(4) {
        let at = draws.below(bytes.len());
        let n = draws.below(64).min(bytes.len() - at);
        match draws.below(7) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << draws.below(8),
            1 if !bytes.is_empty() => bytes[at] = draws.next() as u8,
            2 if bytes.len() >= at + 4 => {
                let absurd = [u32::MAX, 1 << 31, 0x7fff_ffff, 0, 1 << 20][draws.below(5)];
                bytes[at..at + 4].copy_from_slice(&absurd.to_le_bytes());
            }
            3 => bytes.truncate(at),
            4 => {
                let part = bytes[at..at + n].to_vec();
                bytes.splice(at..at, part);
            }
            5 => drop(bytes.drain(at..at + n)),
            _ => {
                let from = draws.below(other.len());
                let part = &other[from..(from + 256).min(other.len())];
                bytes.splice(at..at + n, part.iter().copied());
            }
        }
    }
    bytes
}

#[test]
fn every_kept_input_is_taken_or_refused() {
    for (name, take) in inputs::ALL {
        let kept = corpus(name);
        assert!(!kept.is_empty(), "{name} has no corpus");
        for (file, bytes) in kept {
            let taken = std::panic::catch_unwind(|| take(&bytes));
            assert!(taken.is_ok(), "{file}");
        }
    }
}

#[test]
fn altered_inputs_are_taken_or_refused() {
    let n: usize = std::env::var("EVRIG_MUTATIONS").map_or(20, |n| n.parse().expect("a number"));
    for (name, take) in inputs::ALL {
        let kept = corpus(name);
        let mut draws = Draws(20_261_121);
        for (file, bytes) in &kept {
            for copy in 0..n {
                let other = &kept[draws.below(kept.len())].1;
                let altered = altered(bytes, other, &mut draws);
                let taken = std::panic::catch_unwind(|| take(&altered));
                assert!(taken.is_ok(), "{file}, copy {copy}");
            }
        }
    }
}
