//! A diagnosed camera as arguments of other simulators.

use evrig_core::effect_id::EffectId;
use evrig_generate::forward::CameraConstants;
use std::f64::consts::TAU;

/// A simulator of event cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OtherSimulator {
    /// v2e (Hu, Liu and Delbruck, CVPRW 2021): options of its command.
    V2e,
    /// `esim_py` (Gehrig et al., CVPR 2020): arguments of its constructor.
    Esim,
    /// IEBCS (Joubert et al., Front. Neurosci. 15, 2021): calls of its Python interface.
    Iebcs,
    /// DVS-Voltmeter (Lin et al., ECCV 2022): a line of its configuration, for 8-bit frames.
    DvsVoltmeter,
}

/// Arguments of a simulator, and what of the camera it cannot represent.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct SimulatorArguments {
    /// The text to type or to paste.
    pub arguments: String,
    /// Properties that the simulator does not have, with their sizes.
    pub not_represented: Vec<String>,
}

/// White of 8-bit frames, digital units.
const WHITE_DN: f64 = 255.0;

/// Noise below this many thresholds is not worth a word: 5 % changes no interval beyond its
/// scatter.
const MIN_NOISE_THRESHOLDS: f64 = 0.05;

/// The camera's constants for a simulator.
#[must_use]
pub fn simulator_arguments(
    camera: &CameraConstants,
    simulator: OtherSimulator,
) -> SimulatorArguments {
    let values = CameraValues::of(camera);
    let (arguments, represented): (String, &[EffectId]) = match simulator {
        OtherSimulator::V2e => (values.v2e(), &V2E),
        OtherSimulator::Esim => (values.esim(), &[EffectId::RefractoryPeriod]),
        OtherSimulator::Iebcs => (values.iebcs(), &IEBCS),
        OtherSimulator::DvsVoltmeter => (values.dvs_voltmeter(), &DVS_VOLTMETER),
    };
    SimulatorArguments { arguments, not_represented: values.beyond(simulator, represented) }
}

const V2E: [EffectId; 5] = [
    EffectId::RefractoryPeriod,
    EffectId::ThresholdMismatch,
    EffectId::PhotoreceptorBandwidth,
    EffectId::JunctionLeak,
    EffectId::BackgroundActivity,
];

const IEBCS: [EffectId; 6] = [
    EffectId::RefractoryPeriod,
    EffectId::ThresholdMismatch,
    EffectId::PhotoreceptorBandwidth,
    EffectId::FixedPole,
    EffectId::StampJitter,
    EffectId::BackgroundActivity,
];

const DVS_VOLTMETER: [EffectId; 3] =
    [EffectId::DarkCurrent, EffectId::JunctionLeak, EffectId::PhotocurrentLeak];

/// Constants in common units: log intensity, Hz, microseconds.
struct CameraValues<'a> {
    camera: &'a CameraConstants,
    /// ON and OFF threshold, natural logarithm of intensity.
    theta: [f64; 2],
    /// ON events per second of a pixel at rest.
    leak_hz: f64,
}

impl<'a> CameraValues<'a> {
    fn of(camera: &'a CameraConstants) -> Self {
        let [k1, _, _, k4, ..] = camera.generator.k.k();
        let nominal = 1.0 / k1;
        let theta = [nominal * camera.on_over_nominal, nominal / camera.on_over_nominal];
        Self { camera, theta, leak_hz: 1e6 * k4 }
    }

    /// A parameter of an effect of the whole sensor; 0 without the effect.
    fn of_effect(&self, id: EffectId, key: &str) -> f64 {
        let own = self.camera.generator.effects.iter().filter(|a| a.region.is_none());
        let found = own.filter(|applied| applied.effect.id() == id).find_map(|applied| {
            let parameters = applied.effect.model().parameters();
            parameters.into_iter().find(|p| p.key == key).map(|p| p.value)
        });
        found.unwrap_or(0.0)
    }

    fn refractory_us(&self) -> f64 {
        self.of_effect(EffectId::RefractoryPeriod, "refractory_us")
    }

    /// Standard deviation of the thresholds over the pixels, log intensity.
    fn spread(&self) -> f64 {
        let mean = (self.theta[0] * self.theta[1]).sqrt();
        mean * self.of_effect(EffectId::ThresholdMismatch, "sigma_relative")
    }

    fn cutoff_hz(&self) -> f64 {
        self.of_effect(EffectId::PhotoreceptorBandwidth, "cutoff_hz_at_white")
    }

    fn background_hz(&self) -> f64 {
        self.camera.background_hz + self.of_effect(EffectId::BackgroundActivity, "rate_hz")
    }

    fn v2e(&self) -> String {
        let [on, off] = self.theta;
        format!(
            "--pos_thres {on:.4} --neg_thres {off:.4} --sigma_thres {:.4} --cutoff_hz {:.4} \
             --leak_rate_hz {:.4} --shot_noise_rate_hz {:.4} --refractory_period {:.6}",
            self.spread(),
            self.cutoff_hz(),
            self.leak_hz.max(0.0),
            self.background_hz(),
            1e-6 * self.refractory_us(),
        )
    }

    fn esim(&self) -> String {
        let [on, off] = self.theta;
        let seconds = 1e-6 * self.refractory_us();
        format!("esim_py.EventSimulator({on:.4}, {off:.4}, {seconds:.6}, 1e-3, True)")
    }

    fn iebcs(&self) -> String {
        let [on, off] = self.theta;
        let pole = self.of_effect(EffectId::FixedPole, "cutoff_hz");
        let cutoff = if pole > 0.0 { pole } else { self.cutoff_hz() };
        let tau_us = if cutoff > 0.0 { 1e6 / (TAU * cutoff) } else { 0.0 };
        format!(
            "dsi.initLatency(0, {:.1}, {:.1}, {tau_us:.1})\n\
             dsi.initContrast({on:.4}, {off:.4}, {:.4})",
            self.of_effect(EffectId::StampJitter, "sigma_us"),
            self.refractory_us(),
            self.spread(),
        )
    }

    fn dvs_voltmeter(&self) -> String {
        let [k1, k2, k3, k4, k5, k6] = self.camera.generator.k.k();
        let dark = self.of_effect(EffectId::DarkCurrent, "fraction_of_white");
        let at_white = self.of_effect(EffectId::PhotocurrentLeak, "rate_hz_at_white");
        let k5 = k5 / WHITE_DN + 1e-6 * at_white / WHITE_DN;
        let k2 = WHITE_DN * (k2 + dark);
        format!("__C.SENSOR.K = [{k1:.4}, {k2:.4e}, {k3:.4e}, {k4:.4e}, {k5:.4e}, {k6:.4e}]")
    }

    /// What a simulator leaves out of the camera.
    fn beyond(&self, simulator: OtherSimulator, represented: &[EffectId]) -> Vec<String> {
        let effects = self.camera.generator.effects.iter();
        let left = effects.filter(|applied| {
            applied.region.is_some() || !represented.contains(&applied.effect.id())
        });
        let in_words = |applied: &evrig_generate::effect::AppliedEffect| {
            let parameters = applied.effect.model().parameters();
            let sizes: Vec<String> =
                parameters.iter().map(|p| format!("{} = {:.4}", p.key, p.value)).collect();
            format!("{} ({})", applied.effect.id().name(), sizes.join(", "))
        };
        let mut all: Vec<String> = left.map(in_words).collect();
        let ratio = self.theta[0] / self.theta[1];
        if simulator == OtherSimulator::DvsVoltmeter && (ratio - 1.0).abs() > 1e-3 {
            all.push(format!("ON over OFF threshold of {ratio:.4}: both are 1 / k1"));
        }
        if simulator == OtherSimulator::Esim {
            all.push(format!("leak of {:.3} Hz per pixel", self.leak_hz));
        }
        let has_background = matches!(simulator, OtherSimulator::V2e);
        if !has_background && self.background_hz() > 0.0 {
            all.push(format!("background of {:.3} Hz per pixel", self.background_hz()));
        }
        let scatter = self.camera.scatter.scale;
        if scatter > MIN_NOISE_THRESHOLDS {
            all.push(format!("thresholds that scatter by {scatter:.3} from event to event"));
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use evrig_generate::effect::EffectSet;
    use evrig_generate::forward::{BandNoise, ForwardParameters, ThresholdScatter};
    use evrig_generate::voltmeter::Coefficients;

    fn camera(words: &[&str]) -> CameraConstants {
        CameraConstants {
            generator: ForwardParameters {
                k: Coefficients::new([4.0, 1e-9, 0.0, 2e-7, 0.0, 0.0]).unwrap(),
                effects: EffectSet::from_words(words).unwrap(),
                step_us: 1_000,
            },
            on_over_nominal: 1.2,
            noise: BandNoise { rms: 0.0, bandwidth_hz: 20.0, light_exponent: 0.0 },
            scatter: ThresholdScatter { scale: 0.01, light_exponent: 0.0, redrawn_hz: 1.0 },
            background_hz: 0.05,
        }
    }

    #[test]
    fn constants_have_the_units_of_each_simulator() {
        let camera = camera(&["refractory_period:refractory_us=3000", "fixed_pole:cutoff_hz=50"]);
        let of = |simulator| simulator_arguments(&camera, simulator);
        let v2e = of(OtherSimulator::V2e);
        assert_eq!(
            v2e.arguments,
            "--pos_thres 0.3000 --neg_thres 0.2083 --sigma_thres 0.0000 --cutoff_hz 0.0000 \
             --leak_rate_hz 0.2000 --shot_noise_rate_hz 0.0500 --refractory_period 0.003000"
        );
        assert_eq!(v2e.not_represented, ["Fixed pole (cutoff_hz = 50.0000)"]);
        let esim = of(OtherSimulator::Esim);
        assert!(esim.arguments.contains("(0.3000, 0.2083, 0.003000"), "{}", esim.arguments);
        assert!(esim.not_represented.iter().any(|what| what.contains("leak of 0.200 Hz")));
        let iebcs = of(OtherSimulator::Iebcs);
        // 1 / (2 pi 50 Hz) is 3183 us.
        assert!(iebcs.arguments.contains("(0, 0.0, 3000.0, 3183.1)"), "{}", iebcs.arguments);
        let voltmeter = of(OtherSimulator::DvsVoltmeter);
        assert!(voltmeter.arguments.contains("[4.0000,"), "{}", voltmeter.arguments);
        assert!(voltmeter.not_represented.iter().any(|what| what.contains("ON over OFF")));
    }
}
