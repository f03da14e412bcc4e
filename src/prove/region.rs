//! The part of the sensor in which, according to an answer, the model is wrong.

use super::answer::{DiagnosisAnswer, MismatchStratum};
use evrig_core::geometry::Rectangle;

/// The pixels an answer points at: the region of its first effect; without one, the rows and the
/// columns in which it locates the mismatch; without those, the whole sensor.
#[must_use]
pub(super) fn pointed_at(answer: &DiagnosisAnswer, sensor_px: [u16; 2]) -> Rectangle {
    let stated = answer.effects.first().and_then(|named| named.region.as_ref());
    let stated = stated.and_then(|region| serde_json::from_value(region.clone()).ok());
    stated.unwrap_or_else(|| Rectangle {
        x_px: along("column", &answer.mismatch.places, sensor_px[0]),
        y_px: along("row", &answer.mismatch.places, sensor_px[1]),
    })
}

/// The range over the strata that are wrong by at least half as much as the worst one.
fn along(covariate: &str, places: &[MismatchStratum], n: u16) -> [u16; 2] {
    let of_it = || places.iter().filter(|place| place.covariate == covariate);
    let worst = of_it().map(|place| place.excess_nats_per_event).fold(0.0, f64::max);
    let bad = of_it().filter(|place| place.excess_nats_per_event >= 0.5 * worst);
    let hull = bad.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], place| {
        [low.min(place.range[0]), high.max(place.range[1])]
    });
    if hull[0] > hull[1] {
        return [0, n];
    }
    // A stratum's range goes from its first to its last pixel, both in it.
    [hull[0], hull[1] + 1.0].map(|end| end.clamp(0.0, f64::from(n)) as u16)
}

/// Overlap of two sets of pixels: the harmonic mean of precision and recall.
#[must_use]
pub(super) fn f1(hidden: &Rectangle, found: &Rectangle) -> f64 {
    2.0 * hidden.shared(found) as f64 / (hidden.area() + found.area()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const SENSOR: [u16; 2] = [346, 260];

    fn answer(value: serde_json::Value) -> DiagnosisAnswer {
        serde_json::from_value(value).unwrap()
    }

    fn place(covariate: &str, range: [f64; 2], excess: f64) -> serde_json::Value {
        json!({ "covariate": covariate, "range": range, "excess_nats_per_event": excess })
    }

    #[test]
    fn the_worst_strata_of_rows_and_columns_make_a_rectangle() {
        let places = [
            place("interval_us", [0.0, 900.0], 0.9),
            place("row", [0.0, 60.0], 0.3),
            place("row", [61.0, 110.0], 0.2),
            place("row", [111.0, 259.0], 0.02),
            place("column", [0.0, 345.0], 0.1),
        ];
        let found =
            pointed_at(&answer(json!({"verdict": "x", "mismatch": {"where": places}})), SENSOR);
        assert_eq!(found, Rectangle { x_px: [0, 346], y_px: [0, 111] });
    }

    #[test]
    fn a_stated_region_comes_first_and_saying_nothing_means_everywhere() {
        let region = json!({"x_px": [10, 20], "y_px": [30, 40]});
        let effects = json!([{"id": "fixed_pole", "region": region}]);
        let places = [place("row", [0.0, 60.0], 0.3)];
        let stated =
            answer(json!({"verdict": "x", "effects": effects, "mismatch": {"where": places}}));
        let expected = Rectangle { x_px: [10, 20], y_px: [30, 40] };
        assert_eq!(pointed_at(&stated, SENSOR), expected);
        let everywhere = pointed_at(&answer(json!({"verdict": "x"})), SENSOR);
        assert_eq!(everywhere, Rectangle { x_px: [0, 346], y_px: [0, 260] });
    }

    #[test]
    fn pointing_everywhere_is_half_right_about_a_third() {
        let hidden = Rectangle { x_px: [0, 100], y_px: [0, 10] };
        let whole = Rectangle { x_px: [0, 300], y_px: [0, 10] };
        assert!((f1(&hidden, &whole) - 0.5).abs() < 1e-12);
        assert!((f1(&hidden, &hidden) - 1.0).abs() < 1e-12);
    }
}
