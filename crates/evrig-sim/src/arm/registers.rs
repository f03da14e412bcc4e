//! What the simulated arm remembers between commands: parameters, pins, its name.

use evrig_device::dobot::id;
use std::collections::BTreeMap;

/// Values by id, and by pin where the id has pins.
#[derive(Debug, Clone)]
pub(super) struct ArmRegisters {
    values: BTreeMap<u8, Vec<u8>>,
    pins: BTreeMap<(u8, u8), Vec<u8>>,
}

/// Registers of floats and their values after power-up, as the vendor's virtual arm has them.
const FLOATS: &[(u8, &[f32])] = &[
    (id::KINEMATICS, &[0.0; 2]),
    (id::POSE_RAIL, &[0.0]),
    (id::HOME_PARAMS, &[200.0, 0.0, 0.0, 0.0]),
    (id::AUTO_LEVELING, &[0.02]),
    (id::END_EFFECTOR, &[59.7, 0.0, 0.0]),
    (id::JOG_JOINT, &[15.0, 15.0, 15.0, 15.0, 60.0, 60.0, 60.0, 60.0]),
    (id::JOG_COORDINATE, &[15.0, 15.0, 15.0, 15.0, 60.0, 60.0, 60.0, 60.0]),
    (id::JOG_COMMON, &[50.0, 50.0]),
    (id::JOG_RAIL, &[15.0, 60.0]),
    (id::PTP_JOINT, &[300.0, 300.0, 300.0, 300.0, 400.0, 400.0, 400.0, 400.0]),
    (id::PTP_COORDINATE, &[300.0, 200.0, 400.0, 200.0]),
    (id::PTP_JUMP, &[20.0, 150.0]),
    (id::PTP_COMMON, &[50.0, 50.0]),
    (id::PTP_RAIL, &[50.0, 50.0]),
    (id::PTP_JUMP_2, &[20.0, 20.0, 150.0]),
    (id::ARC_PARAMS, &[100.0; 4]),
    (id::ARC_COMMON, &[100.0, 100.0]),
    (id::CP_COMMON, &[100.0, 100.0]),
    (id::LOST_STEP_PARAMS, &[5.0]),
];

/// Registers of bytes and their lengths.
const BYTES: &[(u8, usize)] = &[
    (id::DEVICE_WITH_RAIL, 1),
    (id::TEACH_TRIGGER_MODE, 1),
    (id::TEACH_TRIGGER_ENABLE, 1),
    (id::TEACH_TRIGGER, 1),
    (id::LASER, 2),
    (id::SUCTION_CUP, 2),
    (id::GRIPPER, 2),
    (id::CP_HOLD_R, 1),
    (id::IR_SWITCH, 2),
    (id::COLOR_SENSOR, 3),
    (id::WIFI_ENABLE, 1),
];

/// Registers with one value a pin, and the length of the value behind the pin's address.
const PINS: &[(u8, usize)] = &[
    (id::IO_MULTIPLEXING, 1),
    (id::IO_OUTPUT, 1),
    (id::IO_PWM, 8),
    (id::IO_INPUT, 1),
    (id::IO_ADC, 2),
    (id::MOTOR, 5),
    (id::MOTOR_STEPS, 9),
];

impl Default for ArmRegisters {
    fn default() -> Self {
        let mut values = BTreeMap::new();
        for (id, floats) in FLOATS {
            values.insert(*id, floats.iter().flat_map(|value| value.to_le_bytes()).collect());
        }
        for (id, len) in BYTES {
            values.insert(*id, vec![0; *len]);
        }
        // 100 mm/s^2, 100 mm/s, 100 mm/s^2, not in real time.
        let mut cp: Vec<u8> = [100.0_f32; 3].iter().flat_map(|value| value.to_le_bytes()).collect();
        cp.push(0);
        values.insert(id::CP_PARAMS, cp);
        values.insert(id::DEVICE_NAME, b"evrig simulated arm\0".to_vec());
        Self { values, pins: BTreeMap::new() }
    }
}

impl ArmRegisters {
    /// Whether `id` is remembered here.
    #[must_use]
    pub(super) fn knows(&self, id: u8) -> bool {
        self.values.contains_key(&id) || pin_length(id).is_some()
    }

    /// Takes a written value; one that is too short for its register changes nothing.
    pub(super) fn write(&mut self, id: u8, params: &[u8]) {
        if let Some(len) = pin_length(id) {
            if let Some((pin, value)) = params.split_first()
                && value.len() >= len
            {
                self.pins.insert((id, *pin), value.to_vec());
            }
        } else if let Some(value) = self.values.get_mut(&id)
            && (params.len() >= value.len() || id == id::DEVICE_NAME)
        {
            *value = params.to_vec();
        }
    }

    /// Lowers what is above the limits of the vendor's virtual arm: 300 mm/s or deg/s and 400
    /// mm/s^2 or deg/s^2, the speeds of a register standing before its accelerations.
    pub(super) fn clamp(&mut self, id: u8) {
        if ![id::PTP_JOINT, id::PTP_COORDINATE, id::ARC_PARAMS].contains(&id) {
            return;
        }
        if let Some(value) = self.values.get_mut(&id) {
            let n_speeds = value.len() / 8;
            for (n, bytes) in value.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let limit = if n < n_speeds { 300.0 } else { 400.0 };
                *bytes = f32::from_le_bytes(*bytes).min(limit).to_le_bytes();
            }
        }
    }

    /// The answer to a read: the value, or the pin's address and its value.
    #[must_use]
    pub(super) fn read(&self, id: u8, params: &[u8]) -> Option<Vec<u8>> {
        let Some(len) = pin_length(id) else { return self.values.get(&id).cloned() };
        let pin = *params.first()?;
        let value = self.pins.get(&(id, pin)).cloned().unwrap_or_else(|| vec![0; len]);
        Some([&[pin][..], &value].concat())
    }

    /// The first `N` floats of a register.
    #[must_use]
    pub(super) fn floats<const N: usize>(&self, id: u8) -> [f64; N] {
        let bytes = self.values.get(&id).map(Vec::as_slice).unwrap_or_default();
        let mut chunks = bytes.as_chunks::<4>().0.iter();
        std::array::from_fn(|_| chunks.next().map_or(0.0, |b| f64::from(f32::from_le_bytes(*b))))
    }
}

fn pin_length(id: u8) -> Option<usize> {
    PINS.iter().find(|(known, _)| *known == id).map(|(_, len)| *len)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_pin_by_pin() {
        let mut registers = ArmRegisters::default();
        registers.write(id::IO_OUTPUT, &[2, 1]);
        assert_eq!(registers.read(id::IO_OUTPUT, &[2]), Some(vec![2, 1]));
        assert_eq!(registers.read(id::IO_OUTPUT, &[3]), Some(vec![3, 0]));
        assert_eq!(registers.read(id::IO_OUTPUT, &[]), None);
    }

    #[test]
    fn a_short_value_changes_nothing() {
        let mut registers = ArmRegisters::default();
        let before = registers.read(id::ARC_PARAMS, &[]);
        registers.write(id::ARC_PARAMS, &[1, 2, 3]);
        assert_eq!(registers.read(id::ARC_PARAMS, &[]), before);
        assert_eq!(registers.floats::<4>(id::ARC_PARAMS), [100.0; 4]);
    }
}
