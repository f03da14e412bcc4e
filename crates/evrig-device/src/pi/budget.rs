//! Whether a link can carry the frames that are ordered, and what it could carry instead.

use evrig_core::units::BytesPerSecond;
use evrig_pi::order::{CaptureOrder, Coding, Delivery, RgbDelivery};
use evrig_record::Finding;

/// Shares of their bytes that raw and RGB images keep when they are coded; noise decides, and
/// with it the gain. A little above what docs/RECORDING.md measured.
const fn coded_shares(gain: f64) -> [f64; 2] {
    if gain <= 4.0 { [0.60, 0.42] } else { [0.70, 0.50] }
}

/// Share of a link that may be planned with: the rest is for bursts and other traffic.
const PLANNED_SHARE: f64 = 0.8;

/// What an order loads onto the link while frames are taken.
#[must_use]
pub(super) fn load(order: &CaptureOrder) -> BytesPerSecond {
    let settings = &order.settings;
    let n_pixels = settings.size.n_pixels() as f64;
    let [raw_share, rgb_share] = match order.delivery.coding {
        Coding::Lossless => coded_shares(settings.gain),
        Coding::Plain => [1.0, 1.0],
    };
    let raw = if settings.raw { 1.25 * n_pixels * raw_share } else { 0.0 };
    let rgb = if settings.rgb { 3.0 * n_pixels * rgb_share } else { 0.0 };
    let rgb = match order.delivery.rgb {
        RgbDelivery::Live => rgb,
        RgbDelivery::Every(n) => rgb / f64::from(n.max(1)),
        RgbDelivery::AfterTake => 0.0,
    };
    BytesPerSecond((raw + rgb) * settings.frame_rate.0)
}

/// Whether a link carries an order.
#[must_use]
pub(super) fn is_carried(order: &CaptureOrder, link: BytesPerSecond) -> bool {
    load(order).0 <= PLANNED_SHARE * link.0
}

/// The delivery nearest to the one ordered that a link carries; none when it carries no way at all.
#[must_use]
pub(super) fn proposal(order: &CaptureOrder, link: BytesPerSecond) -> Option<Delivery> {
    let coding = Coding::Lossless;
    let ways = [
        order.delivery,
        Delivery { coding, ..order.delivery },
        Delivery { coding, rgb: RgbDelivery::AfterTake },
    ];
    ways.into_iter().find(|&delivery| is_carried(&CaptureOrder { delivery, ..order.clone() }, link))
}

/// The finding of the preflight.
#[must_use]
pub(super) fn finding(order: &CaptureOrder, link: BytesPerSecond) -> Finding {
    let mbit = |rate: BytesPerSecond| rate.0 * 8e-6;
    let description = format!(
        "the link carries {:.0} Mbit/s, the frames need {:.0} (rgb_delivery \"{}\", coding \"{}\")",
        mbit(link),
        mbit(load(order)),
        order.delivery.rgb,
        order.delivery.coding
    );
    if is_carried(order, link) {
        return Finding::good("network", description);
    }
    match proposal(order, link) {
        Some(way) => Finding::doubt(
            "network",
            format!(
                "{description}; set pi.rgb_delivery = \"{}\" and pi.coding = \"{}\", or what does \
                 not fit waits in the Pi's spool",
                way.rgb, way.coding
            ),
        ),
        None => {
            let rate =
                order.settings.frame_rate.0 * PLANNED_SHARE * link.0 / load(order).0.max(1.0);
            Finding::doubt(
                "network",
                format!(
                    "{description}; no delivery fits: use a wire, lower pi.frame_rate_hz to \
                     {rate:.0} or less, or give the agent a --spool for the whole take"
                ),
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::geometry::Size;
    use evrig_core::time::Span;
    use evrig_core::units::Hertz;
    use evrig_pi::order::{CaptureSettings, Focus};
    use evrig_record::Verdict;

    fn order(coding: Coding, rgb: RgbDelivery) -> CaptureOrder {
        let settings = CaptureSettings {
            size: Size::new(692, 520),
            frame_rate: Hertz(120.0),
            exposure: Span::from_micros(4_000),
            gain: 1.0,
            raw: true,
            rgb: true,
        };
        CaptureOrder { settings, focus: Focus::Once, delivery: Delivery { coding, rgb } }
    }

    fn mbit(rate: f64) -> BytesPerSecond {
        BytesPerSecond(rate / 8e-6)
    }

    #[test]
    fn the_default_recording_uncoded_needs_one_and_a_half_gigabits() {
        let plain = load(&order(Coding::Plain, RgbDelivery::Live)).0 * 8e-6;
        // 692 * 520 * 120 * (1.25 + 3) bytes.
        assert!((plain - 1468.2).abs() < 0.1, "{plain}");
        let half = load(&order(Coding::Plain, RgbDelivery::Every(4))).0 * 8e-6;
        assert!((half - 690.9).abs() < 0.1, "{half}");
    }

    #[test]
    fn what_does_not_fit_is_answered_with_what_does() {
        let ordered = order(Coding::Plain, RgbDelivery::Live);
        let way = |link| proposal(&ordered, mbit(link));
        assert_eq!(way(2_500.0), Some(ordered.delivery));
        let coded = Delivery { coding: Coding::Lossless, rgb: RgbDelivery::Live };
        assert_eq!(way(940.0), Some(coded), "a gigabit link carries the default");
        let late = Delivery { coding: Coding::Lossless, rgb: RgbDelivery::AfterTake };
        assert_eq!(way(500.0), Some(late));
        assert_eq!(way(90.0), None);
        let finding = |link| finding(&ordered, mbit(link));
        assert_eq!(finding(2_500.0).verdict, Verdict::Good);
        assert!(
            finding(500.0).description.contains("after-take"),
            "{}",
            finding(500.0).description
        );
        assert!(
            finding(90.0).description.contains("frame_rate_hz"),
            "{}",
            finding(90.0).description
        );
    }
}
