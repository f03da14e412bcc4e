//! `stimulus`: shows the target until Ctrl-C.

use super::plan::refused;
use super::{Ending, Output, WrongUse};
use crate::cli::StimulusArgs;
use anyhow::Context;
use evrig_device::stimulus::{ImageList, Stimulus};
use evrig_session::rig::Rig;
use serde_json::json;
use signal_hook::consts::{SIGINT, SIGTERM};

pub(super) fn stimulus(args: &StimulusArgs, output: &Output) -> anyhow::Result<Ending> {
    let rig = Rig::find(&args.rig).map_err(refused)?;
    let images = ImageList::read(&args.images).map_err(|error| WrongUse(error.to_string()))?;
    let n = images.as_slice().len();
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])?;
    let stimulus = Stimulus::serve(args.listen, &rig.target, images, args.px_per_mm)?;
    let url = stimulus.url();
    let value = json!({"schema": "evrig.stimulus/1", "url": url, "n_images": n});
    output
        .result(&value, format_args!("{url} shows {n} images; open it on the target's screen"))?;
    signals.forever().next().context("no signal can come any more")?;
    Ok(Ending::Done)
}
