//! The folder in which a simulator runs: frames as images, their times, the log, the output.

use crate::pipeline::error::missing;
use crate::pipeline::luminance::LuminanceStream;
use crate::pipeline::{PipelineError, clear};
use evrig_core::frame::{Luminance, Samples};
use evrig_core::geometry::Size;
use evrig_session::{Session, SessionError};
use image::ExtendedColorType;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Times are written in microseconds, with six decimals of a second.
const MICROS_PER_S: i64 = 1_000_000;

/// A folder with the frames of a stream.
#[derive(Debug)]
pub(super) struct WorkFolder {
    root: PathBuf,
    /// Columns and rows of the frames.
    pub(super) size: Size,
    /// Times of the frames, µs of the session's clock.
    pub(super) times_us: Vec<i64>,
    /// Frames left out because they are not later than the one before.
    pub(super) n_not_later: u64,
}

impl WorkFolder {
    /// Writes the frames as PNG, of 16 bits where the stream is, and their times.
    ///
    /// # Errors
    /// When a frame cannot be read, there are less than two, or the disk refuses.
    pub(super) fn make(
        root: PathBuf,
        session: &Session,
        from: &str,
        frames: &mut LuminanceStream,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Self, PipelineError> {
        clear(&root)?;
        let mut work = Self { root, size: Size::new(0, 0), times_us: Vec::new(), n_not_later: 0 };
        let io = |path: &Path| {
            let path = path.to_owned();
            move |source| PipelineError::Io { path: path.clone(), source }
        };
        let (folder, times) = (work.frames(), work.times());
        std::fs::create_dir(&folder).map_err(io(&folder))?;
        let mut list =
            std::fs::File::create(&times).map(std::io::BufWriter::new).map_err(io(&times))?;
        let has_16_bits = has_16_bits(session, from)?;
        for frame in frames.by_ref() {
            let frame = frame?;
            let path = folder.join(format!("{:06}.png", work.times_us.len()));
            write_png(&path, &frame, has_16_bits)
                .map_err(|error| io(&path)(std::io::Error::other(error)))?;
            work.size = frame.size;
            work.times_us.push(frame.t_us);
            let t_us = frame.t_us - work.times_us[0];
            let (seconds, micros) = (t_us / MICROS_PER_S, t_us % MICROS_PER_S);
            writeln!(list, "{seconds}.{micros:06}").map_err(io(&times))?;
            progress(work.times_us.len() as u64);
        }
        list.flush().map_err(io(&times))?;
        work.n_not_later = frames.n_not_later();
        if work.times_us.len() < 2 {
            let n = work.times_us.len();
            let what = format!("stream `{from}` has {n} frames; a simulator needs at least two");
            return Err(missing(session, what));
        }
        Ok(work)
    }

    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Folder of the frames, `000000.png` and so on.
    pub(super) fn frames(&self) -> PathBuf {
        self.root.join("frames")
    }

    /// The frames' times, one per line, seconds since the first frame.
    pub(super) fn times(&self) -> PathBuf {
        self.root.join("times.txt")
    }

    /// What the command writes.
    pub(super) fn out(&self) -> PathBuf {
        self.root.join("out")
    }

    /// Both outputs of the command.
    pub(super) fn log(&self) -> PathBuf {
        self.root.join("log.txt")
    }

    /// Time of the last frame since the first, µs.
    pub(super) fn last_us(&self) -> i64 {
        self.times_us.last().zip(self.times_us.first()).map_or(0, |(last, first)| last - first)
    }

    /// Mean frame rate.
    pub(super) fn frames_per_s(&self) -> f64 {
        (self.times_us.len() - 1) as f64 * MICROS_PER_S as f64 / self.last_us() as f64
    }

    /// The event file: `out`, or the only `out.*`; in a folder the named or the only file.
    ///
    /// # Errors
    /// With what is there instead.
    pub(super) fn event_file(&self, named: Option<&str>) -> Result<PathBuf, String> {
        let of_root = entries(&self.root);
        let is_out = |path: &&PathBuf| path.file_stem().is_some_and(|stem| stem == "out");
        let written: Vec<&PathBuf> = of_root.iter().filter(is_out).collect();
        let out = match written[..] {
            [] => return Err("it wrote no {out}".into()),
            [only] => only.clone(),
            _ => return Err(format!("it wrote {}; expected one", names(&written))),
        };
        if let Some(named) = named {
            let path = out.join(named);
            let inside: Vec<PathBuf> = entries(&out);
            let found = || names(&inside.iter().collect::<Vec<_>>());
            return if path.exists() {
                Ok(path)
            } else {
                Err(format!("it wrote no {{out}}/{named}, but {}", found()))
            };
        }
        if !out.is_dir() {
            return Ok(out);
        }
        let inside = entries(&out);
        match &inside[..] {
            [only] => Ok(only.clone()),
            [] => Err("the folder {out} is empty".into()),
            _ => {
                let found = names(&inside.iter().collect::<Vec<_>>());
                Err(format!(
                    "the folder {{out}} holds {found}; name the event file with the key output"
                ))
            }
        }
    }

    /// Removes everything but the log.
    pub(super) fn keep_log(&self) {
        // What cannot be removed is overwritten by the next run.
        for path in entries(&self.root).iter().filter(|path| **path != self.log()) {
            let _ = if path.is_dir() {
                std::fs::remove_dir_all(path)
            } else {
                std::fs::remove_file(path)
            };
        }
    }
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let found = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = found.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

fn names(paths: &[&PathBuf]) -> String {
    let name = |path: &&PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let names: Vec<String> = paths.iter().filter_map(name).collect();
    if names.is_empty() { "nothing".into() } else { names.join(", ") }
}

/// Whether the samples of a stream are of 16 bits.
fn has_16_bits(session: &Session, from: &str) -> Result<bool, SessionError> {
    let samples = if session.is_from_pi(from)? {
        session.pi_frames(from)?.next().transpose()?.map(|image| image.frame.samples)
    } else {
        session.davis_frames(from)?.next().transpose()?.map(|image| image.frame.samples)
    };
    Ok(matches!(samples, Some(Samples::U16(_))))
}

fn write_png(path: &Path, frame: &Luminance, has_16_bits: bool) -> image::ImageResult<()> {
    // A cast saturates at the ends of the type.
    let values = frame.values.iter().map(|value| value.round());
    let (bytes, colour): (Vec<u8>, _) = if has_16_bits {
        (values.flat_map(|v| (v as u16).to_ne_bytes()).collect(), ExtendedColorType::L16)
    } else {
        (values.map(|v| v as u8).collect(), ExtendedColorType::L8)
    };
    let (width, height) = (u32::from(frame.size.width), u32::from(frame.size.height));
    image::save_buffer(path, &bytes, width, height, colour)
}
