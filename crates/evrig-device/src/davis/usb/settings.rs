//! The rig's description as the driver's configuration.

use evrig_session::rig::DavisDescription;
use neuromorphic_drivers::inivation_davis346::{Configuration, DEFAULT_CONFIGURATION};
use serde_json::{Value, json};

/// The driver's defaults with the rig's biases, exposure and frame rate, and every filter that
/// would keep events back switched off.
pub(super) fn configuration(description: &DavisDescription) -> Result<Configuration, String> {
    // Parts of the configuration have no other way in than their serial form.
    let mut value = serde_json::to_value(&DEFAULT_CONFIGURATION).map_err(|e| e.to_string())?;
    set(&mut value, "/activity_filter/mask_isolated_enable", json!(false))?;
    set(&mut value, "/activity_filter/refractory_period_enable", json!(false))?;
    set(&mut value, "/skip_events_every", json!(0))?;
    let camera = &description.camera;
    let exposure_us = u32::try_from(camera.exposure.as_micros()).unwrap_or(u32::MAX);
    set(&mut value, "/exposure_us", json!(exposure_us))?;
    // The interval runs from one frame's end to the next one's start.
    let period_us = (1e6 / camera.frame_rate.0) as u32;
    set(&mut value, "/frame_interval_us", json!(period_us.saturating_sub(exposure_us).max(1)))?;
    for (name, bias) in &description.biases {
        set(&mut value, &format!("/biases/{name}"), json!(bias))?;
    }
    serde_json::from_value(value).map_err(|error| format!("the driver refuses: {error}"))
}

fn set(value: &mut Value, place: &str, new: Value) -> Result<(), String> {
    let old = value.pointer_mut(place);
    *old.ok_or_else(|| format!("this driver has no setting {place}"))? = new;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_core::time::Span;
    use evrig_core::units::Hertz;
    use evrig_session::rig::{DAVIS_BIASES, Rig};

    #[test]
    fn every_bias_of_the_rig_file_reaches_the_driver() {
        let mut davis = Rig::simulated().unwrap().davis;
        davis.biases = DAVIS_BIASES.iter().zip(100..).map(|(name, value)| (*name, value)).collect();
        let value = serde_json::to_value(configuration(&davis).unwrap()).unwrap();
        for (name, bias) in davis.biases {
            assert_eq!(value["biases"][name], bias, "{name}");
        }
    }

    #[test]
    fn exposure_and_rate_are_the_rigs_and_no_filter_keeps_events_back() {
        let mut davis = Rig::simulated().unwrap().davis;
        davis.camera.exposure = Span::from_micros(2_500);
        davis.camera.frame_rate = Hertz(50.0);
        let value = serde_json::to_value(configuration(&davis).unwrap()).unwrap();
        assert_eq!(
            (&value["exposure_us"], &value["frame_interval_us"]),
            (&json!(2_500), &json!(17_500))
        );
        assert_eq!(value["activity_filter"]["mask_isolated_enable"], false);
        assert_eq!(value["activity_filter"]["refractory_period_enable"], false);
        assert_eq!(value["polarity_filter"], "Disabled");
        assert_eq!(value["skip_events_every"], 0);
    }
}
