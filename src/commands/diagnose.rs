//! `evrig diagnose`: where simulated and recorded events differ, and which effects explain it.

use super::progress::ProgressDisplay;
use super::{Ending, Output};
use crate::cli::{BaselineChoice, DiagnoseArgs};
use crate::pipeline::{self, Baseline, BaselineKind, DiagnoseRequest, PipelineProgress};
use evrig_analysis::diagnose::{Diagnosis, DiagnosisOptions, DiagnosisVerdict};
use evrig_session::Session;
use std::num::NonZeroUsize;

pub(super) fn run(args: &DiagnoseArgs, output: &Output) -> anyhow::Result<Ending> {
    let session = Session::open(&args.session)?;
    let baseline = baseline(args, &session)?;
    let defaults = DiagnosisOptions::default();
    let request = DiagnoseRequest {
        real: args.real.clone(),
        baseline,
        options: DiagnosisOptions {
            n_pixels: args.pixels.map_or(defaults.n_pixels, NonZeroUsize::get),
            seed: args.seed,
            ..defaults
        },
        force: args.force,
    };
    let display = ProgressDisplay::new(output);
    let (diagnosis, _) = pipeline::diagnose(&session, &request, &mut |what| {
        display.show(PipelineProgress::Diagnosis(what));
    })?;
    drop(display);
    output.result(&serde_json::to_value(&diagnosis)?, text(&diagnosis))?;
    Ok(Ending::Done)
}

/// The baseline of the command line, or the default of the session.
fn baseline(args: &DiagnoseArgs, session: &Session) -> anyhow::Result<Baseline> {
    let kind = args.baseline.map(|choice| match choice {
        BaselineChoice::Scene => BaselineKind::Scene,
        BaselineChoice::Motion => BaselineKind::Motion,
        BaselineChoice::Frames => BaselineKind::Frames,
    });
    let found = Baseline::chosen(session, kind, args.from.as_deref());
    found.ok_or_else(|| {
        anyhow::anyhow!(
            "{} has neither a scene nor frames on the events' pixel grid; \
             run `evrig scene`, or record with the camera's own frames on",
            args.session.display()
        )
    })
}

/// The diagnosis for people.
pub(super) fn text(diagnosis: &Diagnosis) -> String {
    let scores = &diagnosis.fit.heldout_nats_per_event;
    let mut text = match diagnosis.verdict {
        DiagnosisVerdict::NoMismatch => "no mismatch: the model fits".to_owned(),
        DiagnosisVerdict::MinorMismatch => {
            "minor mismatch: significant, and too small to name an effect".to_owned()
        }
        DiagnosisVerdict::Explained => "explained".to_owned(),
        DiagnosisVerdict::PartlyExplained => "partly explained".to_owned(),
        DiagnosisVerdict::Unexplained => {
            "unexplained: nothing in the library accounts for it".to_owned()
        }
    };
    text += &format!(
        "\nheld-out log-likelihood, nats per event: baseline {:.3}, final {:.3}, upper bound {:.3}",
        scores.baseline, scores.r#final, scores.upper_bound
    );
    if let Some(share) = diagnosis.share_removed() {
        text += &format!("; {:.0} % of the excess removed", share * 100.0);
    }
    for effect in &diagnosis.effects {
        let gain = effect.heldout_gain_nats_per_event;
        text += &format!("\n{}: {}", effect.name, effect.description);
        text += &if effect.is_beside_the_score() {
            " (measured in the frames or sensor-wide)".to_owned()
        } else {
            format!(" (+{gain:.3} nats per event)")
        };
        for (key, p) in &effect.parameters {
            let [low, high] = p.ci90;
            text += &format!("\n  {key} = {:.4}", p.value);
            if let (Some(low), Some(high)) = (low, high) {
                text += &format!(" (90 % interval {low:.4} to {high:.4})");
            }
        }
        if !effect.indistinguishable.is_empty() {
            let ids: Vec<&str> = effect.indistinguishable.iter().map(|id| id.as_str()).collect();
            text += &format!("\n  indistinguishable: {}", ids.join(", "));
        }
    }
    for suspect in &diagnosis.rejected_effects {
        text += &format!(
            "\nrejected: {} would gain {:.3} nats per event, but {}",
            suspect.id, suspect.heldout_gain_nats_per_event, suspect.because
        );
    }
    for place in diagnosis.mismatch.strata.iter().take(3) {
        text += &format!(
            "\nwhere: {} ({:.3} nats per event)",
            place.description, place.excess_nats_per_event
        );
    }
    for note in [diagnosis.range_ends(), diagnosis.coarse_stamps()].into_iter().flatten() {
        text += &format!("\n{note}");
    }
    if let Some(next) = &diagnosis.next_recording {
        text += &format!("\nto distinguish them, record {next}");
    }
    text
}
