//! What keeps the Pi's clock right: chrony's own account of itself.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// chrony answers from memory; a second is long.
const PATIENCE: Duration = Duration::from_secs(1);

/// What steers a machine's wall clock.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "by", rename_all = "snake_case")]
pub enum DisciplineReport {
    /// chrony, and its tracking report.
    Chrony(Tracking),
    /// Nothing that could be asked.
    Unknown {
        /// Why not.
        because: String,
    },
}

/// The columns of `chronyc -c tracking`, as chronyc prints them (its manual, section "tracking").
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Tracking {
    /// Name or address of the source that is followed.
    pub reference: String,
    /// Steps away from a reference clock; 0 when there is none.
    pub stratum: u32,
    /// Offset of the system clock from NTP time that is still being slewed away, s.
    pub system_offset_s: f64,
    /// Offset found at the last update, s.
    pub last_offset_s: f64,
    /// Long-term mean of such offsets, s.
    pub rms_offset_s: f64,
    /// How much faster the clock would run without chrony, parts per million.
    pub frequency_ppm: f64,
    /// Error bound of that frequency, parts per million.
    pub skew_ppm: f64,
    /// Total delay to the reference clock, s.
    pub root_delay_s: f64,
    /// Total dispersion towards the reference clock, s.
    pub root_dispersion_s: f64,
    /// Normal, Insert second, Delete second or Not synchronised.
    pub leap_status: String,
}

impl DisciplineReport {
    /// Reads the line that `chronyc -c tracking` prints.
    #[must_use]
    pub fn parse(line: &str) -> Self {
        let columns: Vec<&str> = line.trim().split(',').collect();
        match tracking(&columns) {
            Some(tracking) => Self::Chrony(tracking),
            None => Self::Unknown {
                because: format!(
                    "`chronyc -c tracking` prints 14 columns, found {} in \"{}\"",
                    columns.len(),
                    line.trim().chars().take(80).collect::<String>()
                ),
            },
        }
    }

    /// Asks chrony on this machine, in at most a second.
    pub async fn ask() -> Self {
        Self::ask_program("chronyc").await
    }

    async fn ask_program(program: &str) -> Self {
        let unknown = |because: String| Self::Unknown { because };
        let asked = tokio::process::Command::new(program)
            .args(["-c", "tracking"])
            .stdin(std::process::Stdio::null())
            .kill_on_drop(true)
            .output();
        match tokio::time::timeout(PATIENCE, asked).await {
            Err(_) => unknown(format!("chronyc did not answer within {PATIENCE:?}")),
            Ok(Err(error)) => unknown(format!("chronyc: {error}; install chrony")),
            Ok(Ok(output)) if !output.status.success() => {
                let message = String::from_utf8_lossy(&output.stdout);
                unknown(format!(
                    "chronyc: {}",
                    message.trim().chars().take(200).collect::<String>()
                ))
            }
            Ok(Ok(output)) => Self::parse(&String::from_utf8_lossy(&output.stdout)),
        }
    }
}

fn tracking(columns: &[&str]) -> Option<Tracking> {
    let &[
        _,
        reference,
        stratum,
        _,
        system,
        last,
        rms,
        frequency,
        _,
        skew,
        delay,
        dispersion,
        _,
        leap,
    ] = columns
    else {
        return None;
    };
    let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
    Some(Tracking {
        reference: reference.to_owned(),
        stratum: stratum.parse().ok()?,
        system_offset_s: number(system)?,
        last_offset_s: number(last)?,
        rms_offset_s: number(rms)?,
        frequency_ppm: number(frequency)?,
        skew_ppm: number(skew)?,
        root_delay_s: number(delay)?,
        root_dispersion_s: number(dispersion)?,
        leap_status: leap.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chronys_columns_are_read() {
        let line = "C0A80101,host.lan,3,1750000000.123,0.000012,-0.000034,0.000050,-7.250,0.001,\
                    0.020,0.000400,0.000300,64.2,Normal\n";
        let DisciplineReport::Chrony(found) = DisciplineReport::parse(line) else {
            panic!("{line}")
        };
        assert_eq!((found.reference.as_str(), found.stratum), ("host.lan", 3));
        assert_eq!((found.frequency_ppm, found.skew_ppm), (-7.25, 0.02));
        assert_eq!(found.leap_status, "Normal");
        for wrong in ["", "506 Cannot talk to daemon", &line.replace("-7.250", "fast")] {
            assert!(
                matches!(DisciplineReport::parse(wrong), DisciplineReport::Unknown { .. }),
                "{wrong}"
            );
        }
    }

    #[tokio::test]
    async fn a_machine_without_chrony_states_it() {
        let DisciplineReport::Unknown { because } =
            DisciplineReport::ask_program("evrig-no-such").await
        else {
            panic!("there is such a program")
        };
        assert!(because.contains("install chrony"), "{because}");
    }
}
