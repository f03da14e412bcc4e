//! `evrig scene`: the reconstructed target and the log-intensity signal that follows from it.

use super::{Ending, Output};
use crate::cli::SceneArgs;
use crate::pipeline::{self, Freshness, SceneMade};
use evrig_session::Session;
use serde_json::{Value, json};

pub(super) fn run(args: &SceneArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let bar = output.progress("scene", 0);
    let made = pipeline::scene(&session, args.force, &mut |done, all| {
        bar.set_length(all);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    output.result(&value(&made), text(&made))?;
    Ok(Ending::Done)
}

/// The result as consumers of `--json` get it.
pub(super) fn value(made: &SceneMade) -> Value {
    let fresh = made.freshness == Freshness::Fresh;
    json!({ "schema": "evrig.scene/2", "fresh": fresh, "scene": made.facts })
}

/// The result for people.
pub(super) fn text(made: &SceneMade) -> String {
    let facts = &made.facts;
    let found = &facts.registration;
    let [seen, lost] = facts.n_frames;
    format!(
        "{} x {} cells of {:.3} mm from {seen} frames ({lost} not on the path), rows {:.2} us \
         apart\n  event camera: {:.3} px and {:.2} DN residual over {} frames, clocks {:.1} us +- \
         {:.1} from those of the stage sync\n  it blurs the map by {:.3} px{}",
        facts.grid.width,
        facts.grid.height,
        facts.grid.cell_mm,
        facts.row_s[0] * 1e6,
        found.residual_px,
        found.residual_dn,
        found.n_frames,
        found.alignment.lag_s * 1e6,
        found.alignment_error[8] * 1e6,
        found.spread.sigma_px,
        if made.freshness == Freshness::Fresh { " (fresh)" } else { "" }
    )
}
