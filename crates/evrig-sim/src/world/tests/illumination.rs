//! The effects of light, optics and arm, as the event camera shows them.

use crate::world::test_world::{TestWorld, n_on};
use crate::world::{CameraName, DavisTwin};
use evrig_core::frame::Samples;
use evrig_core::time::Span;
use std::f64::consts::TAU;

#[test]
fn flicker_is_a_line_at_its_frequency_on_and_off_in_turn() {
    let lamp = "flicker = { frequency_hz = 100, depth = 0.3 }";
    let events = TestWorld::still("plain").with(lamp).events(0.5);
    assert!(events.len() > 10_000);
    let resultant = |on: bool| {
        let of_kind: Vec<_> = events.iter().filter(|event| event.on == on).collect();
        let (sin, cos) = of_kind.iter().fold((0.0, 0.0), |(sin, cos), event| {
            let turn = TAU * 100.0 * event.t as f64 * 1e-6;
            (sin + turn.sin(), cos + turn.cos())
        });
        (f64::hypot(sin, cos) / of_kind.len() as f64, f64::atan2(sin, cos) / TAU)
    };
    let ((sharp_on, on), (sharp_off, off)) = (resultant(true), resultant(false));
    assert!(sharp_on > 0.6 && sharp_off > 0.6, "{sharp_on} {sharp_off}");
    // The sine rises about phase 0 and falls about half a turn.
    assert!(on.abs() < 0.1 && (off.abs() - 0.5).abs() < 0.1, "{on} {off}");
}

#[test]
fn a_shadow_wanders_over_a_still_scene() {
    let shadow =
        "moving_shadow = { depth = 0.5, speed_mm_per_s = 40, width_mm = 2, period_mm = 40 }";
    let events = TestWorld::still("plain").with(shadow).events(1.0);
    assert!(events.len() > 5_000, "{}", events.len());
    let on = n_on(&events) / events.len() as f64;
    assert!((on - 0.5).abs() < 0.05, "as much light comes back as went: {on}");
    // It goes to the right: columns on the right see it later.
    let peak = |from: u16, to: u16| {
        let times: Vec<f64> = events
            .iter()
            .filter(|event| !event.on && (from..to).contains(&event.x) && event.t > 400_000)
            .map(|event| event.t as f64)
            .collect();
        times.iter().sum::<f64>() / times.len() as f64
    };
    // Twenty columns are 5.2 mm apart: 130 ms.
    let lag = peak(28, 32) - peak(8, 12);
    assert!((lag - 130_000.0).abs() < 15_000.0, "{lag}");
}

#[test]
fn vibration_swings_a_moving_tool_and_spares_a_resting_one() {
    let shake = "vibration = { frequency_hz = 50, amplitude_mm = 0.2 }";
    assert!(TestWorld::still("leaves-1").with(shake).events(0.3).is_empty());
    let world = TestWorld::moving("leaves-1", 20.0).with(shake).world();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for tick in 0..2_000 {
        let seconds = f64::from(tick) * 1e-4;
        let off = world.true_pose(Span::from_secs_f64(seconds)).x.0 - 270.0 - 20.0 * seconds;
        (low, high) = (low.min(off), high.max(off));
    }
    assert!((high - 0.2).abs() < 2e-3 && (low + 0.2).abs() < 2e-3, "{low} {high}");
    let count = |effects: &str| TestWorld::moving("leaves-1", 20.0).with(effects).events(0.2).len();
    assert!(count(shake) > count(""), "a swing passes edges again and again");
}

fn image(stage: &TestWorld) -> Vec<f64> {
    let mut twin = DavisTwin::new(stage.world(), Span::ZERO);
    let frames = twin.advance_to(Span::from_micros(30_000)).frames;
    let Samples::U8(samples) = &frames[0].samples else { panic!("eight bits") };
    samples.iter().map(|sample| f64::from(*sample)).collect()
}

#[test]
fn misregistration_moves_the_image_by_its_parameters() {
    let stated = TestWorld::still("leaves-1").world();
    let moved =
        "misregistration = { shift_x_px = 2, shift_y_px = -1, rotation_deg = 90, scale = 1.1 }";
    let moved = TestWorld::still("leaves-1").with(moved).world();
    let at = |world: &crate::world::World, place| {
        world.pixel_of_place(CameraName::Davis, place, Span::ZERO).unwrap()
    };
    let [x, y] = at(&stated, [0.5, 0.25]);
    let [dx, dy] = [x - 24.0, y - 16.0];
    let [got_x, got_y] = at(&moved, [0.5, 0.25]);
    // A quarter turn clockwise in an image whose rows grow downwards: (dx, dy) to (-dy, dx).
    assert!((got_x - (24.0 - 1.1 * dy + 2.0)).abs() < 1e-6);
    assert!((got_y - (16.0 + 1.1 * dx - 1.0)).abs() < 1e-6);
}

#[test]
fn defocus_flattens_edges_and_a_vignette_darkens_corners() {
    let sharpness = |stage: &TestWorld| {
        let image = image(stage);
        image.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>()
    };
    let sharp = sharpness(&TestWorld::still("leaves-1"));
    let soft = sharpness(&TestWorld::still("leaves-1").with("defocus = { sigma_px = 1.5 }"));
    assert!(soft < 0.5 * sharp, "{soft} of {sharp}");
    let other = "defocus = { sigma_px = 1.5, camera = \"pi\" }";
    let unchanged = sharpness(&TestWorld::still("leaves-1").with(other));
    assert!((unchanged / sharp - 1.0).abs() < 1e-9, "the DAVIS's lens is in focus");

    let bare = image(&TestWorld::still("plain"));
    let dark = image(&TestWorld::still("plain").with("vignetting = { corner_loss = 0.4 }"));
    let corner = |image: &[f64]| (image[0] + image[1] + image[48] + image[49]) / 4.0;
    assert!((corner(&dark) / corner(&bare) - 0.62).abs() < 0.04);
    let middle = 16 * 48 + 20;
    assert!((dark[middle] - bare[middle]).abs() < 8.0);
}
