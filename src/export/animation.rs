//! Event images as an animated GIF, and as a video that ffmpeg encodes.

use super::window::{WINDOW_US, windows};
use super::{Chosen, ExportError, ExportRequest, unfit};
use evrig_core::geometry::Size;
use evrig_session::Session;
use gif::{Encoder, Frame, Repeat};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::process::{Command, Stdio};

/// Time that a GIF counts in, µs.
const GIF_TICK_US: i64 = 10_000;

/// No event, OFF, ON.
const PALETTE: [u8; 9] = [128, 128, 128, 0, 0, 0, 255, 255, 255];

/// Grey of a pixel without an event in an event image.
const NO_EVENT: u8 = 128;

/// Images of 20 ms each in real time. In a pause longer than one image an empty one is shown.
pub(super) fn gif(out: &Path, chosen: &Chosen) -> Result<(), ExportError> {
    let io = |source| ExportError::Io { path: out.to_owned(), source };
    let refused = |error: gif::EncodingError| match error {
        gif::EncodingError::Io(source) => io(source),
        other => io(std::io::Error::other(other)),
    };
    let Size { width, height } = chosen.size;
    let file = BufWriter::with_capacity(1 << 20, File::create(out).map_err(io)?);
    let mut encoder = Encoder::new(file, width, height, &PALETTE).map_err(refused)?;
    encoder.set_repeat(Repeat::Infinite).map_err(refused)?;
    let mut last_end = None;
    for window in windows(chosen.events.as_slice(), chosen.size) {
        let begin = window.end_us - WINDOW_US;
        let pause = last_end.map_or(0, |end| begin - end);
        if pause > 0 {
            show(&mut encoder, &vec![NO_EVENT; chosen.size.n_pixels()], width, pause)
                .map_err(refused)?;
        }
        show(&mut encoder, &window.picture, width, WINDOW_US).map_err(refused)?;
        last_end = Some(window.end_us);
    }
    Ok(())
}

fn show(
    encoder: &mut Encoder<BufWriter<File>>,
    picture: &[u8],
    width: u16,
    duration_us: i64,
) -> Result<(), gif::EncodingError> {
    let index = |grey: &u8| match *grey {
        NO_EVENT => 0,
        0 => 1,
        _ => 2,
    };
    let pixels: Vec<u8> = picture.iter().map(index).collect();
    let height = (pixels.len() / usize::from(width.max(1))) as u16;
    let mut frame = Frame::from_indexed_pixels(width, height, pixels, None);
    // The longest delay is 655 s.
    frame.delay = u16::try_from(duration_us / GIF_TICK_US).unwrap_or(u16::MAX);
    encoder.write_frame(&frame)
}

/// The longest pause that a video shows; a longer one is cut to it.
const MAX_PAUSE_US: i64 = 2_000_000;

/// H.264 at 50 images per second, which ffmpeg encodes. Gives a remark where pauses were cut.
pub(super) fn mp4(
    session: &Session,
    request: &ExportRequest,
    chosen: &Chosen,
) -> Result<Vec<String>, ExportError> {
    let out = &request.out;
    let io = |source| ExportError::Io { path: out.clone(), source };
    let Size { width, height } = chosen.size;
    let rate = (1_000_000 / WINDOW_US).to_string();
    let size = format!("{width}x{height}");
    let input = ["-f", "rawvideo", "-pix_fmt", "gray", "-s", &size, "-r", &rate, "-i", "-"];
    // H.264 with colour at half the resolution needs even sides.
    let filter = "pad=ceil(iw/2)*2:ceil(ih/2)*2";
    let output = ["-an", "-vf", filter, "-pix_fmt", "yuv420p", "-f", "mp4"];
    let child = Command::new("ffmpeg")
        .args(["-y", "-loglevel", "error"])
        .args(input)
        .args(output)
        .arg(out)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let mut child = child.map_err(|error| {
        let gif = out.with_extension("gif");
        let what = format!(
            "ffmpeg, which encodes mp4, cannot be started ({error}); install it, or export {gif} and \
             run: ffmpeg -i {gif} -pix_fmt yuv420p {out}",
            gif = gif.display(),
            out = out.display()
        );
        unfit(session, request, what)
    })?;
    let mut n_cut = 0_u64;
    let mut last_end = None;
    let mut written = Ok(());
    if let Some(mut pipe) = child.stdin.take() {
        let empty = vec![NO_EVENT; chosen.size.n_pixels()];
        for window in windows(chosen.events.as_slice(), chosen.size) {
            let pause = last_end.map_or(0, |end| window.end_us - WINDOW_US - end);
            n_cut += u64::from(pause > MAX_PAUSE_US);
            for _ in 0..pause.min(MAX_PAUSE_US) / WINDOW_US {
                written = written.and_then(|()| pipe.write_all(&empty));
            }
            written = written.and_then(|()| pipe.write_all(&window.picture));
            if written.is_err() {
                break;
            }
            last_end = Some(window.end_us);
        }
    }
    let ended = child.wait_with_output().map_err(io)?;
    if !ended.status.success() {
        let text = String::from_utf8_lossy(&ended.stderr);
        let what = format!("ffmpeg failed: {}", text.trim().replace('\n', "; "));
        return Err(unfit(session, request, what));
    }
    written.map_err(io)?;
    let remark = || format!("{n_cut} pauses of more than 2 s were cut to 2 s in the video");
    Ok((n_cut > 0).then(remark).into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::event::{Event, Events};

    #[test]
    fn a_gif_shows_the_last_event_of_each_pixel_and_an_empty_image_in_a_pause() {
        let directory = tempfile::tempdir().unwrap();
        let out = directory.path().join("a.gif");
        let event = |t, x, on| Event { t, x, y: 1, on };
        let events: Events = [
            event(0, 0, true),
            event(5, 1, true),
            event(6, 1, false),
            event(3_600_000_000, 2, true),
        ]
        .into_iter()
        .collect();
        gif(&out, &Chosen { events, size: Size::new(3, 2) }).unwrap();
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(File::open(&out).unwrap()).unwrap();
        let mut found = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            found.push((frame.delay, frame.buffer.to_vec()));
        }
        let expected =
            [(2, vec![0, 0, 0, 2, 1, 0]), (u16::MAX, vec![0; 6]), (2, vec![0, 0, 0, 0, 0, 2])];
        assert_eq!(found, expected);
    }
}
