//! Sentences on rates, stamps, pixels, background activity, readout and balance.

use crate::number::{count, quantity, significant};
use evrig_analysis::camera_report::{
    CameraReport, OUTLIER_RATIO, ReadoutOrder, SectionResult, StampStep, StampTies,
};
use evrig_core::stats::Estimate;

/// Hot and silent pixels and gaps that are named one by one.
const MAX_NAMED: usize = 5;

/// The sentences of a section, or the reason for which it has none.
pub(super) fn section<T>(
    section: &SectionResult<T>,
    sentences: impl FnOnce(&T) -> Vec<String>,
) -> Vec<String> {
    match section {
        SectionResult::Known(found) => sentences(found),
        SectionResult::NotMeasured { not_measured } => vec![sentence(not_measured)],
    }
}

/// A capital at the start and a full stop at the end.
pub(super) fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

/// A share with its error in percent.
pub(super) fn percent(share: &Estimate) -> String {
    let scaled = Estimate::normal(100.0 * share.value, 100.0 * share.standard_error, share.n);
    format!("{} %", quantity(&scaled))
}

/// Value, interval and unit.
pub(super) fn with_interval(estimate: &Estimate, unit: &str) -> String {
    let [low, high] = estimate.ci90.map(|end| significant(end, 3));
    format!("{} {unit} (90 % interval {low} to {high})", significant(estimate.value, 3))
}

pub(super) fn rates(report: &CameraReport) -> Vec<String> {
    let rates = &report.rates;
    let mut all = vec![
        format!(
            "{} events in {:.3} s on {} pixels.",
            count(report.n_events),
            rates.duration_s,
            report.size
        ),
        format!(
            "Rate of ON events: {} per second (n = {}); of OFF events: {} per second (n = {}). The \
             errors are from the scatter over twentieths of the time.",
            quantity(&rates.on_hz),
            count(rates.on_hz.n),
            quantity(&rates.off_hz),
            count(rates.off_hz.n)
        ),
    ];
    if rates.gaps.is_empty() {
        all.push(format!(
            "No gap of the whole sensor is longer than chance explains; the longest is {} us.",
            rates.longest_gap_us
        ));
    } else {
        let named = rates.gaps.iter().take(MAX_NAMED).map(|gap| {
            format!(
                "{} us at {:.6} s",
                gap.length_us,
                (gap.begin_us - rates.first_us) as f64 * 1e-6
            )
        });
        all.push(format!(
            "The whole sensor is silent for longer than chance explains {} times or more; the \
             longest: {}.",
            rates.gaps.len(),
            named.collect::<Vec<_>>().join(", ")
        ));
    }
    all
}

pub(super) fn stamps(report: &CameraReport) -> Vec<String> {
    let mut all = section(&report.stamp_step, |step| vec![step_sentence(step)]);
    all.extend(section(&report.stamp_ties, tie_sentences));
    all
}

fn step_sentence(step: &StampStep) -> String {
    match (step.is_coarse(), step.is_exact) {
        (false, _) => "The stamps have a resolution of 1 us and no coarser step.".into(),
        (true, true) => format!(
            "All stamps are multiples of {} us apart: a simulator with this time step, or a clock of \
             this resolution.",
            step.step_us
        ),
        (true, false) => format!(
            "The stamps lie near a grid with a step of {} us (coherence {:.3}).",
            significant(step.step_us, 6),
            step.coherence
        ),
    }
}

fn tie_sentences(ties: &StampTies) -> Vec<String> {
    let order = |order: ReadoutOrder| match order {
        ReadoutOrder::Ascending => "ascending",
        ReadoutOrder::Descending => "descending",
        ReadoutOrder::Mixed => "more often in one direction than the other",
        ReadoutOrder::Random => "as chance has it",
        ReadoutOrder::Unknown => "not known (too few pairs)",
    };
    let mut all = vec![format!(
        "{} of the events have the stamp of the event before them; independent events would have \
         {} %.",
        percent(&ties.share),
        significant(100.0 * ties.share_by_chance, 2)
    )];
    if ties.same_row_share.is_known() {
        all.push(format!(
            "Of these pairs {} lie in one row. Order of different rows: {}; of columns in one row: \
             {}.",
            percent(&ties.same_row_share),
            order(ties.row_order),
            order(ties.column_order)
        ));
    }
    all
}

pub(super) fn pixels(report: &CameraReport) -> Vec<String> {
    section(&report.pixels, |pixels| {
        let mut all = Vec::new();
        if pixels.hot.is_empty() {
            all.push(format!(
                "No hot pixels: none has more than {OUTLIER_RATIO} times its neighbours' events in \
                 either half of the time (level 1 % over {} pixels).",
                count(pixels.n_pixels)
            ));
        } else {
            let named =
                pixels.hot.iter().take(MAX_NAMED).map(|hot| {
                    format!("({}, {}) with {} Hz", hot.x, hot.y, quantity(&hot.rate_hz))
                });
            all.push(format!(
                "{} hot pixels with {} of all events; the busiest, by column and row: {}.",
                count(pixels.hot.len() as u64),
                percent(&pixels.hot_share),
                named.collect::<Vec<_>>().join(", ")
            ));
        }
        let silent = pixels.silent.iter().take(MAX_NAMED).map(|[x, y]| format!("({x}, {y})"));
        all.push(match (pixels.n_testable, pixels.silent.len()) {
            (0, _) => format!(
                "Too few events for dead pixels: {} pixels have no event, and no pixel has so many \
                 around it that this would be unlikely.",
                count(pixels.n_without_events)
            ),
            (n, 0) => format!(
                "No dead pixels among the {} whose neighbours have enough events to tell.",
                count(n)
            ),
            (n, n_silent) => format!(
                "{} of {} pixels that can be tested are silent: {}.",
                count(n_silent as u64),
                count(n),
                silent.collect::<Vec<_>>().join(", ")
            ),
        });
        all
    })
}

pub(super) fn background(report: &CameraReport) -> Vec<String> {
    section(&report.background, |found| {
        vec![format!(
            "Isolated events: ON {}, OFF {}, per pixel. Isolated means no other event at the pixel \
             and its neighbours within {} ms; weak texture that moves is counted too.",
            with_interval(&found.on_hz, "Hz"),
            with_interval(&found.off_hz, "Hz"),
            significant(1e-3 * found.window_us, 3)
        )]
    })
}

pub(super) fn readout(report: &CameraReport) -> Vec<String> {
    section(&report.readout, |limits| {
        let mut all = vec![format!(
            "At most {} events in a millisecond; {} on average.",
            count(limits.max_per_ms),
            significant(limits.mean_per_ms, 3)
        )];
        all.push(match (&limits.ceiling_hz, limits.scatter_at_peak.is_known()) {
            (Some(ceiling), _) => format!(
                "The rate has a ceiling at {} events per second: there, neighbouring milliseconds \
                 scatter by only {} of Poisson's variance.",
                quantity(ceiling),
                quantity(&limits.scatter_at_peak)
            ),
            (None, true) => format!(
                "No ceiling of the rate: at the highest rates, neighbouring milliseconds scatter by \
                 {} of Poisson's variance.",
                quantity(&limits.scatter_at_peak)
            ),
            (None, false) => {
                "Too few events for a ceiling of the rate: the busiest milliseconds hold fewer than \
                 30 events."
                    .into()
            }
        });
        if let Some(service) = &limits.service_us {
            all.push(format!(
                "The bus is saturated: events come {} us apart, hardly any closer.",
                quantity(service)
            ));
        }
        all
    })
}

pub(super) fn balance(report: &CameraReport) -> Vec<String> {
    section(&report.threshold_ratio, |ratio| {
        vec![
            format!("{} % of the events are ON.", significant(100.0 * ratio.on_share, 3)),
            format!(
                "ON threshold over OFF threshold: {} (n = {} pixels), if the brightness of these \
                 pixels returns and nothing leaks.",
                quantity(&ratio.on_over_off),
                count(ratio.n_pixels)
            ),
        ]
    })
}
