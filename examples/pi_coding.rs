//! Compression ratio and speed of lossless coding of the Pi's frames.
//!
//! `cargo run --release --example pi_coding`. The frames are synthetic: a scene with structure at
//! all scales, and the noise of a small sensor (full well of 4,700 electrons at 1023 and gain 1,
//! binned 2 x 2, read noise 1.5 digital numbers at gain 1). RGB frames are made from the same raw
//! samples by bilinear demosaicing, white balance and gamma. Speed is in bytes of the frame per
//! second of processor time of all threads.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

use evrig::geometry::Size;
use evrig::pi::coding;
use evrig::raw10;
use rand::{Rng, SeedableRng, rngs::StdRng};
use rustix::time::{ClockId, clock_gettime};

const SIZE: Size = Size::new(692, 520);
const FRAMES_PER_S: f64 = 120.0;
const N_ROUNDS: u32 = 40;

fn main() {
    println!("{SIZE} at {FRAMES_PER_S} frames per second; Mbit/s is the resulting network load");
    println!(
        "gain  image    coder           share    Mbit/s  encode MB/s  decode MB/s of processor"
    );
    for gain in [1.0, 4.0, 10.0] {
        let raw = samples(gain);
        let packed = raw10::pack(&raw, SIZE).unwrap();
        let rgb = isp(&raw);
        measure(gain, "raw10", "lz4", &packed, lz4, unlz4);
        measure(gain, "raw10", "zstd-1", &packed, zstd1, unzstd);
        let encode = |bytes: &[u8]| coding::encode_raw10(bytes, SIZE).unwrap();
        let decode = |bytes: &[u8], _| coding::decode_raw10(bytes, SIZE).unwrap();
        measure(gain, "raw10", "lossless", &packed, encode, decode);
        measure(gain, "rgb", "lz4", &rgb, lz4, unlz4);
        measure(gain, "rgb", "zstd-1", &rgb, zstd1, unzstd);
        let encode = |bytes: &[u8]| coding::encode_rgb(bytes, SIZE).unwrap();
        let decode = |bytes: &[u8], _| coding::decode_rgb(bytes, SIZE).unwrap();
        measure(gain, "rgb", "lossless", &rgb, encode, decode);
    }
}

/// Processor time of all threads, seconds.
fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn lz4(bytes: &[u8]) -> Vec<u8> {
    lz4::block::compress(bytes, None, false).unwrap()
}

fn unlz4(bytes: &[u8], n: usize) -> Vec<u8> {
    lz4::block::decompress(bytes, Some(n as i32)).unwrap()
}

fn zstd1(bytes: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(bytes, 1).unwrap()
}

fn unzstd(bytes: &[u8], n: usize) -> Vec<u8> {
    zstd::bulk::decompress(bytes, n).unwrap()
}

fn measure(
    gain: f64,
    image: &str,
    coder: &str,
    bytes: &[u8],
    encode: impl Fn(&[u8]) -> Vec<u8>,
    decode: impl Fn(&[u8], usize) -> Vec<u8>,
) {
    let coded = encode(bytes);
    assert_eq!(decode(&coded, bytes.len()), bytes, "{coder} of {image}");
    let speed = |work: &dyn Fn()| {
        let began = processor_s();
        (0..N_ROUNDS).for_each(|_| work());
        f64::from(N_ROUNDS) * bytes.len() as f64 * 1e-6 / (processor_s() - began)
    };
    let encoded = speed(&|| drop(encode(bytes)));
    let decoded = speed(&|| drop(decode(&coded, bytes.len())));
    let share = coded.len() as f64 / bytes.len() as f64;
    let mbit = coded.len() as f64 * 8e-6 * FRAMES_PER_S;
    println!(
        "{gain:>4}  {image:<7}  {coder:<14}  {share:.3}  {mbit:>8.0}  {encoded:>11.0}  \
         {decoded:>11.0}"
    );
}

/// A scene with structure at all scales, as noisy samples of a Bayer mosaic.
fn samples(gain: f64) -> Vec<u16> {
    let mut random = StdRng::seed_from_u64(7);
    let mut scene = vec![0.0; SIZE.n_pixels()];
    let [width, height] = [SIZE.width, SIZE.height].map(usize::from);
    for octave in 0..7 {
        let cell = 128 >> octave;
        let columns = width / cell + 2;
        let knots: Vec<f64> =
            (0..columns * (height / cell + 2)).map(|_| random.random_range(-1.0..1.0)).collect();
        for (at, value) in scene.iter_mut().enumerate() {
            let [x, y] = [at % width, at / width].map(|k| k as f64 / cell as f64);
            let (left, top) = (x.floor() as usize, y.floor() as usize);
            let (u, v) = (x.fract(), y.fract());
            let knot = |i: usize, j: usize| knots[(top + j) * columns + left + i];
            let blend = |a: f64, b: f64, t: f64| a + (b - a) * t;
            let upper = blend(knot(0, 0), knot(1, 0), u);
            let lower = blend(knot(0, 1), knot(1, 1), u);
            *value += blend(upper, lower, v) * cell as f64 / 128.0;
        }
    }
    let electrons_per_dn = 4_700.0 / 1023.0 / gain;
    let noisy = scene.iter().enumerate().map(|(at, value)| {
        let is_green = (at % width + at / width) % 2 == 1;
        let signal = (350.0 + 220.0 * value).clamp(8.0, 950.0) * if is_green { 1.0 } else { 0.6 };
        // Binning averages four samples: a quarter of the variance.
        let variance = (signal / electrons_per_dn + (1.5 * gain).powi(2)) / 4.0;
        // The sum of twelve uniform numbers is approximately normal.
        let normal: f64 = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        (64.0 + signal + normal * variance.sqrt()).round().clamp(0.0, 1023.0) as u16
    });
    noisy.collect()
}

/// R, G, B bytes of an RGGB mosaic.
fn isp(raw: &[u16]) -> Vec<u8> {
    let [width, height] = [SIZE.width, SIZE.height].map(i64::from);
    let colour = |x: i64, y: i64| match (x % 2, y % 2) {
        (0, 0) => 0,
        (1, 1) => 2,
        _ => 1,
    };
    let mut rgb = Vec::with_capacity(3 * raw.len());
    for y in 0..height {
        for x in 0..width {
            for (wanted, balance) in [1.9, 1.0, 1.7].into_iter().enumerate() {
                let (mut sum, mut n) = (0.0, 0.0);
                for (i, j) in (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))) {
                    let (i, j) = (x + i, y + j);
                    let is_own = i == x && j == y;
                    if (0..width).contains(&i) && (0..height).contains(&j) && colour(i, j) == wanted
                    {
                        let weight = if is_own { 1e6 } else { 1.0 };
                        sum += weight * f64::from(raw[(j * width + i) as usize]);
                        n += weight;
                    }
                }
                let linear = ((sum / n - 64.0) * balance / 959.0).clamp(0.0, 1.0);
                rgb.push((255.0 * linear.powf(1.0 / 2.2)).round() as u8);
            }
        }
    }
    rgb
}
