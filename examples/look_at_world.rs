//! Renders a trajectory in the simulated world, prints the time it takes, and writes a few images.
//!
//! `cargo run --release --example look_at_world -- OUT_DIR [TRAJECTORY [WORLD.toml]]`

#![allow(clippy::print_stdout, clippy::too_many_lines)]

use evrig::frame::Samples;
use evrig::rig::Rig;
use evrig::sim::world::{DavisTwin, PiTwin, World, WorldDescription};
use evrig::time::Span;
use evrig::trajectory::{OptionalSegments, Trajectory};
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let out = PathBuf::from(arguments.next().unwrap_or_else(|| ".".to_owned()));
    let name = arguments.next().unwrap_or_else(|| "protocol-short".to_owned());
    let description = match arguments.next() {
        Some(path) => WorldDescription::parse(&path, &std::fs::read_to_string(&path)?)?,
        None => WorldDescription::default(),
    };
    let rig = Rig::simulated()?;
    let path = Trajectory::find(&name)?.path(&rig, OptionalSegments::LeftOut)?;
    let begun = Instant::now();
    let world = Arc::new(World::along(&rig, &path, &description, 1)?);
    println!("world {:.2} s; recording of {:.2}", begun.elapsed().as_secs_f64(), path.duration());

    let begun = Instant::now();
    let mut davis = DavisTwin::new(Arc::clone(&world), Span::ZERO);
    let packet = davis.advance_to(path.duration());
    let on = packet.events.as_slice().count_on();
    let (n, frames) = (packet.events.len(), packet.frames.len());
    println!("DAVIS {:.2} s: {n} events ({on} On), {frames} frames", begun.elapsed().as_secs_f64());

    let begun = Instant::now();
    let mut pi = PiTwin::new(Arc::clone(&world), Span::ZERO);
    let mut n_frames = 0;
    let mut shown = None;
    while pi.position() < path.duration() {
        let frame = pi.next_frame();
        n_frames += 1;
        if frame.metadata.sequence == 150 {
            shown = Some(frame);
        }
    }
    println!("Pi {:.2} s: {n_frames} frames", begun.elapsed().as_secs_f64());

    if let Some(frame) = packet.frames.get(50.min(frames.saturating_sub(1)))
        && let Samples::U8(samples) = &frame.samples
    {
        let [w, h] = [u32::from(frame.size.width), u32::from(frame.size.height)];
        image::save_buffer(out.join("aps.png"), samples, w, h, image::ColorType::L8)?;
    }
    if let Some(frame) = shown {
        let size = rig.pi.camera.size;
        let [w, h] = [u32::from(size.width), u32::from(size.height)];
        if let Some(Samples::U16(raw)) = frame.raw.map(|raw| raw.samples) {
            let bytes: Vec<u8> = raw.iter().map(|value| (value >> 2) as u8).collect();
            image::save_buffer(out.join("raw.png"), &bytes, w, h, image::ColorType::L8)?;
        }
        if let Some(Samples::U8(bgr)) = frame.rgb.map(|rgb| rgb.samples) {
            let rgb: Vec<u8> = bgr.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0]]).collect();
            image::save_buffer(out.join("rgb.png"), &rgb, w, h, image::ColorType::Rgb8)?;
        }
    }
    let size = rig.davis.camera.size;
    let mut image = vec![128_u8; size.n_pixels()];
    let start = world.clocks().davis(Span::from_secs_f64(1.2)).as_micros();
    for event in packet.events.as_slice().between(start, start + 20_000).iter() {
        image[size.index(event.x, event.y)] = if event.on { 255 } else { 0 };
    }
    let [w, h] = [u32::from(size.width), u32::from(size.height)];
    image::save_buffer(out.join("events.png"), &image, w, h, image::ColorType::L8)?;
    Ok(())
}
