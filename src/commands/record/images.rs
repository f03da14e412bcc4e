//! `record --images`: one recording for each image that the stimulus shows.

use super::{RecordedTake, RecordingRun};
use crate::cli::RecordArgs;
use crate::commands::{Ending, Output, WrongUse};
use crate::drivers::OpenOptions;
use anyhow::Context;
use evrig_device::stimulus::{ImageList, Screen, Stimulus};
use evrig_record::{StopRequest, StopToken};
use evrig_session::{Manifest, SessionLayout, SessionStatus};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::time::Duration;

/// Between two polls of Ctrl-C while the page is closed or paused.
const POLL_INTERVAL: Duration = Duration::from_millis(200);

pub(super) fn record(
    work: &RecordingRun<'_>,
    list: &Path,
    args: &RecordArgs,
    opening: &OpenOptions<'_>,
) -> anyhow::Result<Ending> {
    let output = work.output;
    let images = ImageList::read(list).map_err(|error| WrongUse(error.to_string()))?;
    let n_images = images.as_slice().len();
    let target = &work.rig.target;
    let stimulus =
        Arc::new(Stimulus::serve(args.stimulus, target, images.clone(), args.px_per_mm)?);
    std::fs::create_dir_all(&args.out).with_context(|| args.out.display().to_string())?;
    let mut taken = Vec::new();
    let mut worst = Ending::Done;
    let mut n_left_out = 0;
    for (index, image) in images.as_slice().iter().enumerate() {
        let Some(out) = place(&args.out, index, &image.label)? else {
            n_left_out += 1;
            continue;
        };
        if !wait_for_page(&stimulus, &work.operator.stop, output) {
            worst = Ending::Aborted;
            break;
        }
        output.say(format_args!("image {} of {n_images}: {}", index + 1, image.label));
        let next = Arc::new(AtomicUsize::new(index));
        let screen = Screen::new(Arc::clone(&stimulus), next);
        let RecordedTake { ending, value, text, .. } =
            work.take(&out, opening, Some(Box::new(screen)))?;
        output.say(text);
        taken.push(json!({"label": image.label, "recording": value}));
        match ending {
            Ending::Done => {}
            Ending::WithLosses => worst = ending,
            _ => {
                worst = ending;
                break;
            }
        }
    }
    let n_taken = taken.len();
    let text =
        format!("{}: {n_taken} recordings made, {n_left_out} already complete", args.out.display());
    let value = json!({
        "schema": "evrig.record-images/1", "dataset": args.out, "recordings": taken,
        "n_left_out": n_left_out,
    });
    output.result(&value, text)?;
    Ok(worst)
}

/// Where the image's session goes; none when it is there and complete.
fn place(out: &Path, index: usize, label: &str) -> anyhow::Result<Option<PathBuf>> {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c } else { '-' };
    let label: String = label.chars().map(plain).take(40).collect();
    let name = format!("{:04}-{label}", index + 1);
    // A recording that failed stays, and the next one goes beside it.
    for again in 1.. {
        let folder = if again == 1 { name.clone() } else { format!("{name}-{again}") };
        let folder = out.join(folder);
        let is_free =
            std::fs::read_dir(&folder).map_or(true, |mut entries| entries.next().is_none());
        if is_free {
            return Ok(Some(folder));
        }
        let manifest = Manifest::read(&SessionLayout::new(&folder).manifest());
        if manifest.is_ok_and(|manifest| manifest.status == SessionStatus::Complete) {
            return Ok(None);
        }
    }
    anyhow::bail!("{}: too many recordings of {name}", out.display())
}

/// Waits for the page to be open, calibrated and not paused; false when the operator ends it.
fn wait_for_page(stimulus: &Stimulus, stop: &StopToken, output: &Output) -> bool {
    let mut is_told = false;
    loop {
        if stop.requested() != StopRequest::No {
            return false;
        }
        if stimulus.wait_until_ready(POLL_INTERVAL) {
            return true;
        }
        if !is_told {
            let url = stimulus.url();
            output.say(format_args!("waiting for the page: open {url} on the target's screen"));
            is_told = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_whose_recording_failed_gets_a_place_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let first = place(folder.path(), 0, "tabby cat/..").unwrap().unwrap();
        assert_eq!(first, folder.path().join("0001-tabby-cat---"));
        std::fs::create_dir(&first).unwrap();
        assert_eq!(place(folder.path(), 0, "tabby cat/..").unwrap().unwrap(), first);
        std::fs::write(first.join("journal.jsonl"), "").unwrap();
        let second = place(folder.path(), 0, "tabby cat/..").unwrap().unwrap();
        assert_eq!(second, folder.path().join("0001-tabby-cat----2"));
    }
}
