//! Rate of encrypted frames of the default size from an agent to a host on the same machine.
//!
//! `cargo run --release --example pi_link`. The camera delivers a synthetic pattern as fast as it
//! is taken, so the rate includes its generation. The pattern is smoother than real frames and
//! compresses better.

#![allow(clippy::print_stdout, clippy::unwrap_used)]

use evrig::delivery::{Coding, Focus, RgbDelivery};
use evrig::device::pi::{AgentAddress, NetworkPi, PiTimeouts, pairing};
use evrig::geometry::Size;
use evrig::pi::agent::{Agent, Service};
use evrig::pi::keys::Keys;
use evrig::pi::order::{CaptureOrder, CaptureSettings, Delivery};
use evrig::pi::source::Synthetic;
use evrig::record::recorder::{Received, Recorder, RecorderSample, channel};
use evrig::time::Span;
use evrig::units::Hertz;
use std::time::{Duration, Instant};

const N_FRAMES: u32 = 600;

fn main() {
    let folder = tempfile::tempdir().unwrap();
    let pair = pairing::pair(folder.path()).unwrap();
    println!("coding    frames/s   MB/s of frames     dropped");
    for coding in [Coding::Plain, Coding::Lossless] {
        let mut service = Service::local("127.0.0.1:0".parse().unwrap());
        service.keys = Some(Keys::read(&pair.agent).unwrap());
        let agent = Agent::open(service, Box::new(Synthetic::unpaced(u64::MAX))).unwrap();
        let reach =
            AgentAddress::Tls { address: agent.address().to_string(), keys: pair.host.clone() };
        let settings = CaptureSettings {
            size: Size::new(692, 520),
            frame_rate: Hertz(120.0),
            exposure: Span::from_micros(4_000),
            gain: 1.0,
            raw: true,
            rgb: true,
        };
        let delivery = Delivery { coding, rgb: RgbDelivery::Live };
        let order = CaptureOrder { settings, focus: Focus::Once, delivery };
        let mut pi = NetworkPi::new(reach, order, PiTimeouts::default());
        pi.prepare().unwrap();
        let (outlet, inlet) = channel(256 << 20);
        pi.start(outlet).unwrap();
        let (mut n, mut n_bytes, mut n_dropped) = (0, 0, 0);
        let began = Instant::now();
        while n < N_FRAMES {
            match inlet.take(Duration::from_secs(10)) {
                Received::Sample(RecorderSample::Frame { frame, .. }) => {
                    n += 1;
                    n_bytes += frame.n_bytes();
                    n_dropped = frame.metadata.n_dropped;
                }
                Received::Sample(_) => {}
                Received::Nothing | Received::Closed => panic!("frames ceased"),
            }
        }
        let seconds = began.elapsed().as_secs_f64();
        let (rate, mb) = (f64::from(n) / seconds, n_bytes as f64 * 1e-6 / seconds);
        let name = coding.to_string();
        println!("{name:<9} {rate:>8.0}   {mb:>16.0}   {n_dropped:>7}");
        pi.abort();
    }
}
