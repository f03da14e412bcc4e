//! `evrig export-camera`: the diagnosed camera as arguments of other simulators.

use super::{Ending, Output};
use crate::cli::{ExportCameraArgs, SimulatorChoice};
use crate::pipeline::{OtherSimulator, read_camera, simulator_arguments};
use evrig_session::Session;

pub(super) fn run(args: &ExportCameraArgs, output: &Output) -> anyhow::Result<Ending> {
    let camera = read_camera(&Session::open(&args.session)?)?;
    let simulator = match args.simulator {
        SimulatorChoice::V2e => OtherSimulator::V2e,
        SimulatorChoice::Esim => OtherSimulator::Esim,
        SimulatorChoice::Iebcs => OtherSimulator::Iebcs,
        SimulatorChoice::DvsVoltmeter => OtherSimulator::DvsVoltmeter,
    };
    let made = simulator_arguments(&camera.fitted.camera, simulator);
    for caution in camera.cautions() {
        output.say(format_args!("note: {caution}"));
    }
    let mut text = made.arguments.clone();
    for what in &made.not_represented {
        text += &format!("\n# not represented: {what}");
    }
    output.result(&serde_json::to_value(&made)?, text)?;
    Ok(Ending::Done)
}
