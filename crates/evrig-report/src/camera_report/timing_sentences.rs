//! Sentences on coupling to frames, refractory periods and flicker.

use super::sentences::{percent, section, sentence};
use crate::number::{count, quantity, significant};
use evrig_analysis::camera_report::{
    CameraReport, CouplingBurst, FrameCoupling, FrameReference, OnsetShape, PolarityName, RateLine,
    RateLines, RateSeries, RefractoryOnset, SectionResult,
};

pub(super) fn headline(report: &CameraReport) -> String {
    let bursts = report.frame_coupling.known().map_or(&[][..], |found| &found.bursts[..]);
    let n_hot = report.pixels.known().map_or(0, |pixels| pixels.hot.len());
    let coupling = match bursts {
        [] => "No events follow the camera's frames".to_owned(),
        _ => {
            let on = bursts.iter().filter(|burst| burst.polarity == PolarityName::On);
            let share: f64 = on.map(|burst| burst.share.value).sum();
            let plural = if bursts.len() == 1 { "burst" } else { "bursts" };
            format!(
                "{} {plural} of events follow each of the camera's frames, with {} % of the ON events",
                bursts.len(),
                significant(100.0 * share, 2)
            )
        }
    };
    format!("{coupling}; {n_hot} hot pixels.")
}

pub(super) fn coupling(report: &CameraReport) -> Vec<String> {
    section(&report.frame_coupling, |found| {
        let mut all = vec![frames_sentence(found)];
        for burst in &found.bursts {
            all.push(burst_sentence(burst));
            all.push(check_sentence(burst));
            if let Some(wake) = &burst.wake {
                all.push(format!(
                    "After it the {} rate is lower by {}, and recovers with a time constant of {} us.",
                    burst.polarity,
                    percent(&wake.depth),
                    quantity(&wake.recovery_us)
                ));
            }
        }
        for polarity in [PolarityName::On, PolarityName::Off] {
            let n = found.n_events[usize::from(polarity == PolarityName::Off)];
            if !found.bursts.iter().any(|burst| burst.polarity == polarity) {
                all.push(format!(
                    "{polarity} events ({}) show no burst in {} delays, times per row and widths.",
                    count(n),
                    significant(found.n_trials, 2)
                ));
            }
        }
        for rejected in &found.rejected {
            all.push(format!(
                "Not counted: {} events {:.0} us after the frame's start, {:.2} us per row; {}.",
                rejected.polarity, rejected.delay_us, rejected.row_us, rejected.reason
            ));
        }
        all
    })
}

fn frames_sentence(found: &FrameCoupling) -> String {
    let period = significant(1e-3 * found.frame_period_us, 5);
    match found.reference {
        FrameReference::ExposureStart => format!(
            "{} frames, {period} ms apart; delays count from the start of the exposure.",
            found.n_frames
        ),
        FrameReference::FrameStamp => format!(
            "{} frames, {period} ms apart; delays count from the frames' time stamps.",
            found.n_frames
        ),
        FrameReference::FoundPeriod => format!(
            "The file holds no frame times. The events show frames {period} ms apart ({} of them); \
             delays count from an arbitrary instant.",
            found.n_frames
        ),
    }
}

fn burst_sentence(burst: &CouplingBurst) -> String {
    format!(
        "{} of the {} events come {} us after each frame's start plus {} us per row, within {} us; \
         they exceed the background by {:.0} of its standard errors ({:.0} from frame to frame).",
        percent(&burst.share),
        burst.polarity,
        quantity(&burst.delay_us),
        quantity(&burst.row_us),
        quantity(&burst.width_us),
        burst.z,
        burst.frames_z
    )
}

fn check_sentence(burst: &CouplingBurst) -> String {
    let [early, late, even, odd] = burst.halves.each_ref().map(percent);
    let other = if burst.polarity == PolarityName::On { "OFF" } else { "ON" };
    let chance = match burst.false_alarm_probability {
        p if p < 1e-12 => "below 10⁻¹²".to_owned(),
        p => significant(p, 1),
    };
    format!(
        "Chance in the whole search: {chance}. First and second half of the time: {early} and \
         {late}; two halves of the pixels: {even} and {odd}. {other} events there: {}.",
        percent(&burst.other_polarity_share)
    )
}

pub(super) fn refractory(report: &CameraReport) -> Vec<String> {
    let mut all: Vec<String> = report
        .refractory
        .iter()
        .map(|onset| match onset {
            SectionResult::Known(onset) => onset_sentence(onset),
            SectionResult::NotMeasured { not_measured } => sentence(not_measured),
        })
        .collect();
    let shapes = report.refractory.iter().filter_map(SectionResult::known);
    if shapes.clone().any(|onset| onset.shape == OnsetShape::Soft) {
        all.push(
            "A soft onset is no proof of a refractory period: brightness that changes slowly needs \
             time to reach the threshold again."
                .into(),
        );
    }
    all
}

fn onset_sentence(onset: &RefractoryOnset) -> String {
    let pair = format!("{} to {}", onset.after.words(), onset.to);
    let n = count(onset.n_intervals);
    let shortest = onset.shortest_us.first().map_or("-".into(), |us| significant(*us, 4));
    if onset.shape == OnsetShape::Absent {
        let bound = onset.upper_bound_us.map_or("unknown".into(), |us| significant(us, 3));
        return format!(
            "From {pair} (n = {n}): no refractory period; a period above {bound} us is excluded by \
             shorter intervals (shortest {shortest} us)."
        );
    }
    let stable = if onset.is_stable {
        "alike in the halves of the time and of the pixels"
    } else {
        "different in the halves of the time or of the pixels, as an onset that the scene sets"
    };
    let period = quantity(&onset.period_us);
    match onset.shape {
        OnsetShape::Hard => format!(
            "From {pair} (n = {n}): hard refractory period of {period} us, onset within {} us, \
             shortest interval {shortest} us; {stable}.",
            quantity(&onset.width_us)
        ),
        _ => format!(
            "From {pair} (n = {n}): soft onset, half at {period} us, from 10 to 90 % between {} and \
             {} us, shortest interval {shortest} us; {stable}.",
            significant(onset.rise_us[0], 3),
            significant(onset.rise_us[1], 3)
        ),
    }
}

pub(super) fn flicker(report: &CameraReport) -> Vec<String> {
    section(&report.rate_lines, |found| {
        if found.lines.is_empty() {
            return vec![no_line(found)];
        }
        found.lines.iter().map(line_sentence).collect()
    })
}

fn no_line(found: &RateLines) -> String {
    format!(
        "No line between 4 and {:.0} Hz other than the frame rate's; a line of the whole sensor \
         would need an amplitude of about {} % of the rate.",
        found.max_hz,
        significant(100.0 * found.detectable_amplitude, 2)
    )
}

fn line_sentence(line: &RateLine) -> String {
    let place = match line.tile {
        None => "on the whole sensor".to_owned(),
        Some([x, y]) => format!("in tile {} of 4 across, {} of 4 down", x + 1, y + 1),
    };
    let series = match line.series {
        RateSeries::On => "the ON rate",
        RateSeries::Off => "the OFF rate",
        RateSeries::Sum => "the rate",
        RateSeries::Difference => "ON minus OFF",
    };
    let chance = match line.false_alarm_probability {
        p if p < 1e-12 => "below 10⁻¹²".to_owned(),
        p => significant(p, 1),
    };
    format!(
        "{} Hz in {series} {place}: amplitude {} of the rate there (chance in the whole search: \
         {chance}).",
        quantity(&line.frequency_hz),
        percent(&line.amplitude)
    )
}
