//! The helper process and the pipe from it.

use crate::source::SourceError;
use serde::Deserialize;
use serde_json::Value;
use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

const HELPER: &str = include_str!("helper.py");
/// Frames that wait here; behind them wait those in the helper, which counts what it loses.
const N_WAITING: usize = 8;
/// The longest head; real ones have about a kilobyte.
const MAX_HEAD_BYTES: usize = 1 << 16;
/// The longest images: a whole sensor's, raw and RGB.
const MAX_IMAGE_BYTES: usize = 128 << 20;
/// How long last words are waited for.
const LAST_LINES: Duration = Duration::from_secs(1);
/// Lines of the helper's standard error that are kept for its exit_error.
const N_LAST_LINES: usize = 4;

/// The head of a helper's packet.
#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub(super) enum HelperHead {
    Identified {
        model: String,
        picamera2: Option<String>,
    },
    Configured(Box<Configured>),
    Frame(Box<FrameHead>),
    Stopped {
        #[serde(rename = "n_lost")]
        _n_lost: u64,
    },
    Error {
        because: String,
    },
}

#[derive(Debug, Deserialize)]
pub(super) struct Configured {
    pub(super) raw_format: String,
    pub(super) rgb_format: String,
    pub(super) exposure_us: f64,
    pub(super) gain: f64,
    pub(super) frame_duration_us: f64,
    pub(super) description: Value,
}

#[derive(Debug, Deserialize)]
pub(super) struct FrameHead {
    pub(super) metadata: Metadata,
    pub(super) real_time_ns: i64,
    pub(super) n_raw: Option<usize>,
    pub(super) n_rgb: Option<usize>,
}

/// libcamera's metadata of a frame, by its names.
#[derive(Debug, Deserialize)]
pub(super) struct Metadata {
    #[serde(rename = "SensorTimestamp")]
    pub(super) sensor_timestamp: i64,
    #[serde(rename = "FrameWallClock")]
    pub(super) frame_wall_clock: Option<i64>,
    #[serde(rename = "ExposureTime")]
    pub(super) exposure_us: f64,
    #[serde(rename = "AnalogueGain")]
    pub(super) analogue_gain: f64,
    #[serde(rename = "DigitalGain", default = "one")]
    pub(super) digital_gain: f64,
    #[serde(rename = "LensPosition")]
    pub(super) lens_position: Option<f64>,
    #[serde(rename = "SensorBlackLevels", default)]
    pub(super) black_levels: [u32; 4],
}

fn one() -> f64 {
    1.0
}

/// A head and the images behind it.
#[derive(Debug)]
pub(super) struct HelperPacket {
    pub(super) head: HelperHead,
    pub(super) images: Vec<u8>,
}

/// The running helper; dropped, it is ended.
#[derive(Debug)]
pub(super) struct Helper {
    child: Child,
    stdin: Option<ChildStdin>,
    packets: Receiver<Result<HelperPacket, String>>,
    stderr_lines: Arc<Mutex<VecDeque<String>>>,
    /// Closed once its standard error is.
    silence: Receiver<()>,
}

impl Helper {
    pub(super) fn start(python: &Path) -> Result<Self, SourceError> {
        let spawned = Command::new(python)
            .args(["-u", "-c", HELPER])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = spawned.map_err(|error| {
            SourceError::new(format!(
                "{} cannot be started: {error}; name a Python as --python",
                python.display()
            ))
        })?;
        let (stdin, stdout, stderr) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take());
        let (sender, packets) = sync_channel(N_WAITING);
        let stderr_lines: Arc<Mutex<VecDeque<String>>> = Arc::default();
        let (speaking, silence) = sync_channel::<()>(1);
        let words = Arc::clone(&stderr_lines);
        let mut helper = Self { child, stdin, packets, stderr_lines, silence };
        let (Some(stdout), Some(stderr)) = (stdout, stderr) else {
            return Err(SourceError::new("its helper has no pipes"));
        };
        let thread = |name: &str, work: Box<dyn FnOnce() + Send>| {
            std::thread::Builder::new().name(name.to_owned()).spawn(work)
        };
        let readers = [
            thread("pi pipe", Box::new(move || read_all(BufReader::new(stdout), &sender))),
            thread(
                "pi words",
                Box::new(move || {
                    listen(BufReader::new(stderr), &words);
                    drop(speaking);
                }),
            ),
        ];
        if let Some(error) = readers.into_iter().find_map(Result::err) {
            helper.end();
            return Err(SourceError::new(error.to_string()));
        }
        Ok(helper)
    }

    pub(super) fn is_alive(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    pub(super) fn send(&mut self, command: &Value) -> Result<(), SourceError> {
        let line = format!("{command}\n");
        let text = self.stdin.as_mut().map(|stdin| stdin.write_all(line.as_bytes()));
        match text {
            Some(Ok(())) => Ok(()),
            Some(Err(_)) | None => Err(self.exit_error()),
        }
    }

    /// The next packet within a time; none when none came.
    pub(super) fn poll(&mut self, patience: Duration) -> Result<Option<HelperPacket>, SourceError> {
        match self.packets.recv_timeout(patience) {
            Ok(Ok(packet)) => Ok(Some(packet)),
            Ok(Err(because)) => Err(SourceError::new(because)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(self.exit_error()),
        }
    }

    /// The next packet, before a deadline.
    pub(super) fn receive(&mut self, deadline: Instant) -> Result<HelperPacket, SourceError> {
        let left = deadline.saturating_duration_since(Instant::now());
        self.poll(left)?.ok_or_else(|| SourceError::new("its helper did not answer in time"))
    }

    /// How it ended, with the last lines of its standard error.
    fn exit_error(&mut self) -> SourceError {
        self.end();
        // Its last output may still arrive. A child process that it left may write for ever.
        let _ = self.silence.recv_timeout(LAST_LINES);
        let how = self.child.try_wait().ok().flatten();
        let how = how.map_or_else(|| "ended".to_owned(), |status| format!("ended with {status}"));
        let words = self.stderr_lines.lock().unwrap_or_else(PoisonError::into_inner);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        SourceError::new(format!("its helper {how}; its last output: {}", words.join(" / ")))
    }

    fn end(&mut self) {
        // Its input closes, which ends a healthy helper; a hung one is killed.
        self.stdin = None;
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        self.end();
    }
}

fn read_all(mut pipe: impl Read, packets: &SyncSender<Result<HelperPacket, String>>) {
    while let Some(packet) = read_packet(&mut pipe).transpose() {
        let is_over = packet.is_err();
        if packets.send(packet).is_err() || is_over {
            return;
        }
    }
}

/// The next packet; none at the end of the pipe, which a helper that dies may leave in its midst.
fn read_packet(pipe: &mut impl Read) -> Result<Option<HelperPacket>, String> {
    let mut lengths = [0; 8];
    if pipe.read_exact(&mut lengths).is_err() {
        return Ok(None);
    }
    let [a, b, c, d, e, f, g, h] = lengths;
    let n_head = u32::from_le_bytes([a, b, c, d]) as usize;
    let n_images = u32::from_le_bytes([e, f, g, h]) as usize;
    if n_head > MAX_HEAD_BYTES || n_images > MAX_IMAGE_BYTES {
        return Err(format!(
            "its helper announces a header of {n_head} and images of {n_images} bytes; at most \
             {MAX_HEAD_BYTES} and {MAX_IMAGE_BYTES} are expected"
        ));
    }
    let (mut head, mut images) = (vec![0; n_head], vec![0; n_images]);
    if pipe.read_exact(&mut head).and_then(|()| pipe.read_exact(&mut images)).is_err() {
        return Ok(None);
    }
    let head = serde_json::from_slice(&head)
        .map_err(|error| format!("the message of its helper is not understood: {error}"))?;
    Ok(Some(HelperPacket { head, images }))
}

/// Keeps the last lines of the helper's standard error.
fn listen(pipe: impl BufRead, stderr_lines: &Mutex<VecDeque<String>>) {
    /// A line longer than this is a flood, not words.
    const LONGEST: u64 = 400;
    let mut pipe = pipe;
    loop {
        let mut line = Vec::new();
        match pipe.by_ref().take(LONGEST).read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => return,
            Ok(_) => {
                let mut words = stderr_lines.lock().unwrap_or_else(PoisonError::into_inner);
                if words.len() == N_LAST_LINES {
                    words.pop_front();
                }
                words.push_back(String::from_utf8_lossy(&line).trim_end().to_owned());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(n_head: u32, n_images: u32, rest: &[u8]) -> Vec<u8> {
        [&n_head.to_le_bytes(), &n_images.to_le_bytes(), rest].concat()
    }

    #[test]
    fn what_is_no_packet_is_reported_without_taking_memory_for_it() {
        let head = br#"{"kind":"stopped","n_lost":3}"#;
        let whole = packet(head.len() as u32, 2, &[head.as_slice(), b"xy"].concat());
        let found = read_packet(&mut whole.as_slice()).unwrap().unwrap();
        assert!(matches!(found.head, HelperHead::Stopped { .. }) && found.images == b"xy");
        for n in 0..whole.len() {
            assert!(read_packet(&mut &whole[..n]).unwrap().is_none(), "cut at {n}");
        }
        for (wrong, expected) in [
            (packet(u32::MAX, 0, b""), "at most"),
            (packet(0, u32::MAX, b""), "at most"),
            (packet(2, 0, b"{}"), "not understood"),
        ] {
            let text = read_packet(&mut wrong.as_slice()).unwrap_err();
            assert!(text.contains(expected), "{text}");
        }
        assert!(read_packet(&mut [0_u8; 0].as_slice()).unwrap().is_none());
    }
}
