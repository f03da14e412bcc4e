//! The answer of a diagnosis in sentences: the same on the page and on the terminal.

use super::number::{count, significant};
use super::words::{enumeration, estimate_words, name_in_sentence, quantity_words};
use evrig_analysis::diagnose::{Diagnosis, DiagnosisVerdict, FittedEffect};

/// The verdict with the named effects and their parameters in one sentence.
#[must_use]
pub fn headline(diagnosis: &Diagnosis) -> String {
    let effects: Vec<String> = diagnosis.effects.iter().map(effect_sentence).collect();
    let effects = enumeration(&effects);
    match diagnosis.verdict {
        DiagnosisVerdict::NoMismatch => {
            "No mismatch: the camera model predicts the recorded events.".to_owned()
        }
        DiagnosisVerdict::MinorMismatch => {
            "A small mismatch, too small to name an effect.".to_owned()
        }
        DiagnosisVerdict::Explained => format!("Explained by {effects}."),
        DiagnosisVerdict::PartlyExplained => format!("Partly explained by {effects}."),
        DiagnosisVerdict::Unexplained => {
            "A mismatch that no known effect explains; none is named.".to_owned()
        }
    }
}

/// "refractory period: refractory 4.5 ms (90 % interval 4.4 ms to 4.6 ms)".
fn effect_sentence(effect: &FittedEffect) -> String {
    let name = name_in_sentence(effect.id);
    // Settings of the fitted law are in the table of effects.
    let own = effect.id.parameters();
    let own = effect.parameters.iter().filter(|(key, _)| own.contains(&key.as_str()));
    let parameters = own.map(|(key, value)| {
        let words = quantity_words(key).0;
        let value = estimate_words(key, value);
        // A clock offset's parameter `offset` needs no second name.
        if name.contains(&words) { value } else { format!("{words} {value}") }
    });
    let parameters: Vec<String> = parameters.collect();
    if parameters.is_empty() { name } else { format!("{name} of {}", parameters.join(", ")) }
}

/// How much of the mismatch the named effects remove; empty where nothing is named or scored.
#[must_use]
pub fn removed(diagnosis: &Diagnosis) -> String {
    let share = diagnosis.share_removed().filter(|_| !diagnosis.effects.is_empty());
    let it = if diagnosis.effects.len() == 1 { "It removes" } else { "They remove" };
    share.map_or_else(String::new, |share| {
        format!("{it} {}\u{a0}% of the mismatch.", significant(100.0 * share, 2))
    })
}

/// From how many events and pixels.
#[must_use]
pub fn basis(diagnosis: &Diagnosis) -> String {
    format!(
        "From {} events of {} pixels.",
        count(diagnosis.n_events as u64),
        count(diagnosis.n_pixels as u64)
    )
}
