//! The score as a page of Markdown: what a reader of docs/reference/proof.md sees.

use super::judge::Judgement;
use super::score::{CountedShare, ProofScore};
use std::fmt::Write as _;

/// The score and every trial as Markdown tables, under a heading.
#[must_use]
pub fn markdown(heading: &str, score: &ProofScore, judgements: &[Judgement]) -> String {
    let mut page = format!("## {heading}\n\n");
    summary(&mut page, score);
    effects(&mut page, score);
    confusion(&mut page, score);
    trials(&mut page, judgements);
    page
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.filter(|v| v.is_finite()).map_or("none".into(), |v| format!("{v:.digits$}"))
}

/// Lines are written into a `String`, which never fails.
macro_rules! line {
    ($page:expr, $($text:tt)*) => { let _ = writeln!($page, $($text)*); };
}

fn summary(page: &mut String, score: &ProofScore) {
    line!(page, "| over {} trials | |\n| --- | --- |", score.n);
    line!(page, "| one effect: named first | {} |", score.top1);
    line!(page, "| the same, stated equivalents counted | {} |", score.top1_or_equivalent);
    line!(
        page,
        "| the same at twice the least strength and above | {} |",
        score.top1_from_strength_2
    );
    line!(
        page,
        "| the same where the answer does not state that it cannot judge | {} |",
        score.top1_of_judged
    );
    let ranges = ["1..1.4", "1.4..2", "2..2.8", "2.8..4"];
    for (range, share) in ranges.iter().zip(&score.by_strength) {
        line!(page, "| the same at strength {range} | {share} |");
    }
    line!(page, "| two effects: F1 of the sets | {} |", number(score.set_f1, 2));
    line!(page, "| clean: something named | {} |", score.false_discovery);
    line!(page, "| outside the library: mismatch reported, nothing named | {} |", score.abstained);
    line!(page, "| of the library, yet called unexplained | {} |", score.false_abstention);
    line!(
        page,
        "| median relative error of a parameter | {} |",
        number(score.median_parameter_error, 3)
    );
    line!(page, "| 90 % intervals that hold the truth | {} |", score.coverage90);
    for (level, share) in score.calibration.iter().filter(|(level, _)| *level != 0.9) {
        line!(page, "| the same at {:.0} %, for normal errors | {share} |", 100.0 * level);
    }
    line!(
        page,
        "| median share of the excess removed | {} |",
        number(score.median_share_removed, 2)
    );
    line!(page, "| mean F1 of regions | {} |", number(score.mean_region_f1, 2));
    line!(page, "| without an answer | {} |", score.unanswered);
    line!(page, "| median seconds of a diagnosis | {} |\n", number(score.median_diagnosed_s, 0));
}

fn effects(page: &mut String, score: &ProofScore) {
    if score.effects.is_empty() {
        return;
    }
    line!(
        page,
        "| effect alone | named first | strength 1..2 | strength 2..4 | first name instead |"
    );
    line!(page, "| --- | --- | --- | --- | --- |");
    for (id, one) in &score.effects {
        let instead: Vec<String> =
            one.instead.iter().map(|(name, n)| format!("{name} {n}")).collect();
        let [weak, strong] = &one.by_strength;
        let share = |s: &CountedShare| format!("{}/{}", s.hits, s.of);
        let (top1, weak, strong) = (share(&one.top1), share(weak), share(strong));
        line!(page, "| {id} | {top1} | {weak} | {strong} | {} |", instead.join(", "));
    }
    page.push('\n');
}

/// Rows: what was hidden alone; then what was named first, and how often.
fn confusion(page: &mut String, score: &ProofScore) {
    line!(page, "| concealed alone | named first, or the verdict without a name |\n| --- | --- |");
    for (hidden, named) in &score.confusion {
        let named: Vec<String> = named.iter().map(|(name, n)| format!("{name} {n}")).collect();
        line!(page, "| {hidden} | {} |", named.join(", "));
    }
    page.push('\n');
}

fn trials(page: &mut String, judgements: &[Judgement]) {
    line!(
        page,
        "| trial | concealed (strength) | verdict | named | gain, nats per event | parameters: \
         truth, found |"
    );
    line!(page, "| --- | --- | --- | --- | --- | --- |");
    for j in judgements {
        let hidden: Vec<String> =
            j.hidden.iter().zip(&j.strengths).map(|(id, s)| format!("{id} ({s:.1})")).collect();
        let mut hidden = if hidden.is_empty() { "nothing".into() } else { hidden.join(", ") };
        if let Some(f1) = j.region_f1 {
            hidden += &format!(" in a region; F1 of the region {f1:.2}");
        }
        let parameters: Vec<String> = j
            .parameters
            .iter()
            .map(|p| format!("{} {:.4}, {:.4}", p.key, p.truth, p.value))
            .collect();
        let (named, parameters) = (j.named.join(", "), parameters.join("; "));
        let gain = number(j.first_gain, 3);
        line!(page, "| {} | {hidden} | {} | {named} | {gain} | {parameters} |", j.trial, j.verdict);
    }
    page.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_has_the_columns_of_its_head() {
        let judgement = Judgement {
            trial: "world-000".into(),
            hidden: vec!["defocus".into()],
            strengths: vec![2.5],
            named: vec!["flicker".into()],
            verdict: "explained".into(),
            is_top1: false,
            is_top1_or_equivalent: false,
            right: 0,
            wrong: 1,
            missed: 1,
            parameters: Vec::new(),
            region_f1: None,
            share_removed: None,
            first_gain: Some(0.25),
            is_outside_library: false,
            is_declared_undecidable: false,
            diagnosed_s: 12.0,
        };
        let judgements = [judgement];
        let page = markdown("World", &ProofScore::of(&judgements), &judgements);
        let mut columns = 0;
        for line in page.lines().filter(|line| line.starts_with('|')) {
            let n = line.matches('|').count();
            if !page.contains(&format!("\n\n{line}")) {
                assert_eq!(n, columns, "{line}");
            }
            columns = n;
        }
        assert!(
            page.contains("| world-000 | defocus (2.5) | explained | flicker | 0.250 |"),
            "{page}"
        );
    }
}
