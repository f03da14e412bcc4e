//! Which values a world can have.

use super::description::WorldDescription;
use super::error::WorldError;
use std::ops::RangeInclusive;

const SHARE: RangeInclusive<f64> = 0.0..=1.0;
const POSITIVE: RangeInclusive<f64> = 1e-9..=1e12;
const NOT_NEGATIVE: RangeInclusive<f64> = 0.0..=1e12;
const ANY: RangeInclusive<f64> = -1e12..=1e12;

impl WorldDescription {
    /// Checks that every value is in its range.
    ///
    /// # Errors
    /// Names the first key whose value is out of its range.
    pub fn check(&self) -> Result<(), WorldError> {
        sensors(self)?;
        // Effects share their units: what a key may be follows from its ending.
        let effects = serde_json::to_value(&self.effects).unwrap_or_default();
        for (effect, parameters) in effects.as_object().into_iter().flatten() {
            for (key, value) in parameters.as_object().into_iter().flatten() {
                let values = match value {
                    serde_json::Value::Array(list) => list.iter().collect(),
                    single => vec![single],
                };
                for value in values.iter().filter(|value| value.is_number() || value.is_null()) {
                    let number = value.as_f64().unwrap_or(f64::NAN);
                    within(&format!("effects.{effect}.{key}"), number, range_of(effect, key))?;
                }
            }
        }
        Ok(())
    }
}

fn sensors(world: &WorldDescription) -> Result<(), WorldError> {
    let (target, davis, pi) = (&world.target, &world.davis, &world.pi);
    within("target.white", target.white, 0.01..=10.0)?;
    within("target.black", target.black, 1e-4..=1.0)?;
    within("davis.threshold", davis.threshold, 1e-3..=10.0)?;
    within("davis.psf_sigma_px", davis.psf_sigma_px, 0.0..=50.0)?;
    within("davis.aps_white_dn", davis.aps_white_dn, POSITIVE)?;
    within("davis.aps_read_noise_dn", davis.aps_read_noise_dn, NOT_NEGATIVE)?;
    within("davis.aps_electrons_per_dn", davis.aps_electrons_per_dn, POSITIVE)?;
    let imu = &world.imu;
    let rotation_noise = imu.rotation_noise_deg_per_s_per_rthz;
    within("imu.rotation_noise_deg_per_s_per_rthz", rotation_noise, NOT_NEGATIVE)?;
    within("imu.rotation_zero_deg_per_s", imu.rotation_zero_deg_per_s, NOT_NEGATIVE)?;
    let acceleration_noise = imu.acceleration_noise_ug_per_rthz;
    within("imu.acceleration_noise_ug_per_rthz", acceleration_noise, NOT_NEGATIVE)?;
    within("imu.acceleration_zero_mg", imu.acceleration_zero_mg, NOT_NEGATIVE)?;
    within("imu.temperature_c", imu.temperature_c, -40.0..=85.0)?;
    within("pi.psf_sigma_px", pi.psf_sigma_px, 0.0..=50.0)?;
    within("pi.white_dn", pi.white_dn, POSITIVE)?;
    within("pi.read_noise_dn", pi.read_noise_dn, NOT_NEGATIVE)?;
    within("pi.electrons_per_dn", pi.electrons_per_dn, POSITIVE)?;
    for response in pi.colour_response {
        within("pi.colour_response", response, 1e-3..=10.0)?;
    }
    within("pi.rgb_gamma", pi.rgb_gamma, 0.05..=20.0)?;
    within("pi.latency_us", pi.latency_us, 0.0..=1e9)?;
    within("pi.latency_spread_us", pi.latency_spread_us, 0.0..=1e9)?;
    within("pi.drop_fraction", pi.drop_fraction, SHARE)?;
    within("clocks.pi_skew_ppm", world.clocks.pi_skew_ppm, -1e5..=1e5)?;
    within("clocks.pi_wall_offset_us", world.clocks.pi_wall_offset_us, ANY)?;
    for step in world.clocks.pi_wall_steps.iter().flatten() {
        within("clocks.pi_wall_steps", *step, ANY)?;
    }
    Ok(())
}

fn range_of(effect: &str, key: &str) -> RangeInclusive<f64> {
    match key {
        "fraction" | "events_fraction" | "depth" | "corner_loss" | "rise" => SHARE,
        "correlation" => -1.0..=1.0,
        "order" => 1.0..=2.0,
        "on_off_ratio" | "gamma" | "scale" => 0.05..=20.0,
        "frequency_hz" | "cutoff_hz" | "cutoff_hz_at_white" | "bandwidth_hz" => 0.01..=20_000.0,
        "exposure_us" => 1.0..=1e6,
        "row_us" if effect == "rolling_shutter" => -1e3..=1e3,
        "max_events_per_s" => 1.0..=1e12,
        "time_constant_s" | "recovery_s" | "width_mm" | "period_mm" | "per_s" | "window_us" => {
            POSITIVE
        }
        "offset_us"
        | "skew_ppm"
        | "offset_dn"
        | "shift_x_px"
        | "shift_y_px"
        | "rotation_deg"
        | "direction_deg"
        | "rate_hz_per_s"
        | "speed_mm_per_s"
        | "delay_us"
        | "brightness_exponent" => -1e9..=1e9,
        "amplitude_mm" => 0.0..=10.0,
        "refractory_us" | "latency_us" | "sigma_us" | "burst_us" => 0.0..=1e7,
        "rate_hz" | "rate_hz_at_white" => 0.0..=1e5,
        "rms_thresholds" => 0.0..=10.0,
        _ => NOT_NEGATIVE,
    }
}

fn within(key: &str, got: f64, range: RangeInclusive<f64>) -> Result<(), WorldError> {
    if range.contains(&got) {
        return Ok(());
    }
    let expected = format!("{} to {}", range.start(), range.end());
    Err(WorldError::Range { key: key.to_owned(), got, expected })
}
