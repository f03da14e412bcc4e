//! The fuzzing corpus and thousands of mutated copies of it, for every parser of external data.
//!
//! `EVRIG_MUTATIONS` sets the number of mutations of each input (default 20).

use crate::inputs;

use std::path::Path;

/// Longer inputs are truncated before mutation, to save time.
const MAX_BYTES: usize = 1 << 16;

/// The corpus of one parser, in the order of file names.
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

/// splitmix64.
struct SplitMix(u64);

impl SplitMix {
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

/// Mutates bits, bytes and lengths, truncates, repeats, deletes, or splices in a part of another
/// input.
fn mutated(bytes: &[u8], other: &[u8], random: &mut SplitMix) -> Vec<u8> {
    let mut bytes = bytes[..bytes.len().min(MAX_BYTES)].to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(bytes.len());
        let n = random.below(64).min(bytes.len() - at);
        match random.below(7) {
            0 if !bytes.is_empty() => bytes[at] ^= 1 << random.below(8),
            1 if !bytes.is_empty() => bytes[at] = random.next() as u8,
            2 if bytes.len() >= at + 4 => {
                let length = [u32::MAX, 1 << 31, 0x7fff_ffff, 0, 1 << 20][random.below(5)];
                bytes[at..at + 4].copy_from_slice(&length.to_le_bytes());
            }
            3 => bytes.truncate(at),
            4 => {
                let part = bytes[at..at + n].to_vec();
                bytes.splice(at..at, part);
            }
            5 => drop(bytes.drain(at..at + n)),
            _ => {
                let from = random.below(other.len());
                let part = &other[from..(from + 256).min(other.len())];
                bytes.splice(at..at + n, part.iter().copied());
            }
        }
    }
    bytes
}

#[test]
fn every_corpus_input_is_accepted_or_rejected() {
    for (name, parse) in inputs::ALL {
        let inputs = corpus(name);
        assert!(!inputs.is_empty(), "{name} has no corpus");
        for (file, bytes) in inputs {
            let parsed = std::panic::catch_unwind(|| parse(&bytes));
            assert!(parsed.is_ok(), "{file}");
        }
    }
}

#[test]
fn mutated_inputs_are_accepted_or_rejected() {
    let n: usize = std::env::var("EVRIG_MUTATIONS").map_or(20, |n| n.parse().expect("a number"));
    for (name, parse) in inputs::ALL {
        let inputs = corpus(name);
        let mut random = SplitMix(20_261_121);
        for (file, bytes) in &inputs {
            for copy in 0..n {
                let other = &inputs[random.below(inputs.len())].1;
                let mutated = mutated(bytes, other, &mut random);
                let parsed = std::panic::catch_unwind(|| parse(&mutated));
                assert!(parsed.is_ok(), "{file}, copy {copy}");
            }
        }
    }
}
