//! A fitted model as a camera: each part is given to the generator once.

use super::*;
use serde_json::json;

fn named(id: EffectId, parameters: &[(&str, f64)]) -> FittedEffect {
    let interval = |&(key, value): &(&str, f64)| {
        (key.to_owned(), json!({ "value": value, "ci90": [null, null] }))
    };
    let parameters: serde_json::Map<_, _> = parameters.iter().map(interval).collect();
    serde_json::from_value(json!({
        "id": id,
        "name": id.as_str(),
        "equation": "",
        "description": "",
        "parameters": parameters,
        "heldout_gain_nats_per_event": 0.0,
        "heldout_gain_error": 0.0,
        "p_value": 1e-6,
        "region": null,
        "indistinguishable": [],
        "competing_hypotheses": [],
    }))
    .unwrap()
}

fn effects_of(camera: &FittedCamera) -> serde_json::Value {
    serde_json::to_value(&camera.camera.generator.effects).unwrap()
}

#[test]
fn fitted_and_sensor_wide_effects_are_in_the_camera() {
    let evidence = empty();
    let left = Rectangle { x_px: [0, 30], y_px: [0, 60] };
    let model = Hypothesis::baseline(&evidence).with_effect_in(
        library(EffectId::RefractoryPeriod),
        &[1_200_f64.ln(), 0.0],
        Some(left),
    );
    let names = [
        named(EffectId::RefractoryPeriod, &[("refractory_us", 1_200.0)]),
        named(EffectId::RowReadout, &[("row_us", 12.5)]),
        named(EffectId::Vibration, &[("frequency_hz", 40.0), ("amplitude_mm", 0.1)]),
    ];
    let camera = FittedCamera::of(&evidence, &model, &names).unwrap();
    let effects = effects_of(&camera);
    assert_eq!(effects.as_object().unwrap().len(), 2, "{effects}");
    let dead_time = &effects["refractory_period"];
    assert!((dead_time["refractory_us"].as_f64().unwrap() - 1_200.0).abs() < 1e-6, "{effects}");
    assert_eq!(dead_time["region"]["x_px"], json!([0.0, 30.0]));
    assert_eq!(effects["row_readout"]["row_us"], json!(12.5));
    assert_eq!(camera.named, names.map(|name| name.id));
    assert!(camera.left_out.is_empty(), "{:?}", camera.left_out);
}

#[test]
fn an_effect_of_the_law_is_not_applied_twice() {
    let evidence = empty();
    let asymmetry = library(EffectId::ThresholdAsymmetry);
    let model = Hypothesis::baseline(&evidence).with(asymmetry, &[1.5_f64.ln()]);
    let names = [named(EffectId::ThresholdAsymmetry, &[("on_off_ratio", 1.5)])];
    let camera = FittedCamera::of(&evidence, &model, &names).unwrap();
    assert_eq!(effects_of(&camera), json!({}));
    let ratio = camera.camera.on_over_nominal.powi(2);
    assert!((ratio - 1.5).abs() < 1e-9, "{ratio}");
    let law = model.law();
    let k = camera.camera.generator.k.k();
    assert!((1.0 / k[0] - (law.theta_on * law.theta_off).sqrt()).abs() < 1e-9);
}

#[test]
fn silent_pixels_bound_the_background() {
    // One event in every pixel but those of the first of sixty rows, over three seconds.
    let spikes = |y: u16| (0..60).map(move |x| evrig_core::event::Event { t: 1, x, y, on: true });
    let events: Events = (1..60).flat_map(spikes).collect();
    let by_pixel =
        |events: &Events| EventsByPixel::new(events.as_slice(), Size::new(60, 60), [0, END_US]);
    let most_hz = by_pixel(&events).max_background_hz();
    assert!((most_hz - 60_f64.ln() / 3.0).abs() < 1e-12, "{most_hz}");
    assert_eq!(filled().max_background_hz(), f64::INFINITY);
    assert_eq!(by_pixel(&Events::new()).max_background_hz(), 0.0);
    let evidence = empty();
    let noisy =
        Hypothesis::baseline(&evidence).with_nuisance(Nuisance::LogBackgroundOn, 2_f64.ln());
    let camera = FittedCamera::of(&evidence, &noisy, &[]).unwrap();
    let hz = camera.camera.background_hz;
    assert!(hz > 0.1, "{hz}");
    let background_hz =
        |most_hz| camera.clone().with_background_up_to(most_hz).camera.background_hz;
    assert_eq!([background_hz(f64::INFINITY), background_hz(0.5 * hz)], [hz, 0.5 * hz]);
}

#[test]
fn unrepresentable_effects_are_listed() {
    let evidence = empty();
    let names = [named(EffectId::RowReadout, &[("row_us", -3.0)])];
    let camera = FittedCamera::of(&evidence, &Hypothesis::baseline(&evidence), &names).unwrap();
    assert_eq!(effects_of(&camera), json!({}));
    assert!(camera.left_out[0].starts_with("row_readout"), "{:?}", camera.left_out);
}

#[test]
fn a_registered_drive_is_shifted_in_time() {
    let evidence = empty();
    let mut registration = FittedRegistration::of(&evidence, &Hypothesis::baseline(&evidence));
    (registration.event_to_light_us, registration.skew, registration.reference_us) =
        (-2_000.0, 1e-3, 1_000_000.0);
    let tuned = RegisteredDrive::new(&Texture, registration);
    // The signal's time is 2 ms before an event's in the middle, and 3 ms at the start.
    let [first, last] = tuned.span_us();
    assert!((first - 2_998).abs() <= 1 && (last - 3_000_000).abs() <= 1, "{first} {last}");
    let grid = TimeGrid { start_us: 1_000_000, step_us: 1_000, n: 3 };
    let (mut late, mut light) = (vec![0.0; 3], vec![0.0; 3]);
    assert!(tuned.sample([20.5, 20.5], grid, &mut late));
    Texture.sample([20.5, 20.5], TimeGrid { start_us: 998_000, ..grid }, &mut light);
    assert!((late[0] - light[0]).abs() < 1e-4, "{late:?} {light:?}");
}

#[test]
fn a_camera_with_the_keys_of_schema_1_is_read() {
    let evidence = empty();
    let camera = FittedCamera::of(&evidence, &Hypothesis::baseline(&evidence), &[]).unwrap();
    let mut text = serde_json::to_string(&camera).unwrap();
    for (new, old) in [
        ("registration", "seen"),
        ("pose", "placing"),
        ("scale_change", "growth"),
        ("center_px", "middle_px"),
        ("event_to_light_us", "late_us"),
        ("reference_us", "at_us"),
    ] {
        let (new, old) = (format!("\"{new}\":"), format!("\"{old}\":"));
        assert!(text.contains(&new), "{new}");
        text = text.replace(&new, &old);
    }
    assert_eq!(serde_json::from_str::<FittedCamera>(&text).unwrap(), camera);
}
