//! `evrig verify`: checksums and counts against the manifest.

use super::{Ending, Output};
use crate::cli::VerifyArgs;
use evrig_session::{Repair, Session, repair, verify};
use serde_json::json;
use std::fmt::Write;

pub(super) fn run(args: &VerifyArgs, output: &Output) -> anyhow::Result<Ending> {
    let repaired = if args.repair { Some(repair(&args.session)?) } else { None };
    match &repaired {
        Some(Repair::Resealed(_)) => {
            output.say("the recording was interrupted; sealed as recovered")
        }
        Some(Repair::NotNeeded) => output.say("nothing to repair: the session is sealed"),
        None => {}
    }
    let session = Session::open(&args.session)?;
    let verification = verify(&session)?;
    let losses = &session.manifest().losses;
    let mut text = String::new();
    for finding in &verification.findings {
        let mark = if finding.holds() { "ok  " } else { "FAIL" };
        let _ = writeln!(text, "{mark}  {}: {}", finding.subject, finding.description);
    }
    for loss in losses {
        let _ = writeln!(text, "lost  {}: {} ({})", loss.stream, loss.what, loss.count);
    }
    let verdict = match (verification.holds(), losses.is_empty()) {
        (false, _) => "does not hold",
        (true, true) => "everything holds",
        (true, false) => "everything holds; losses were recorded",
    };
    let _ = write!(text, "{}: {verdict}", args.session.display());
    let value = json!({
        "schema": "evrig.verification/2",
        "session": session.manifest().name,
        "status": session.manifest().status,
        "repaired": matches!(repaired, Some(Repair::Resealed(_))),
        "holds": verification.holds(),
        "findings": verification.findings,
        "losses": losses,
    });
    output.result(&value, text)?;
    Ok(match (verification.holds(), losses.is_empty()) {
        (false, _) => Ending::Negative,
        (true, true) => Ending::Done,
        (true, false) => Ending::WithLosses,
    })
}
