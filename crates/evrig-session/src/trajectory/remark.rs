//! Remarks of a plan, and limits of exposures.

use super::{PathError, TargetVisibility, ToolPath};
use crate::rig::{ArmPort, Rig};
use evrig_core::time::Span;

/// Refuses exposures for which a frame has no time.
pub(super) fn check_exposures(path: &ToolPath, rig: &Rig) -> Result<(), PathError> {
    for step in path.steps() {
        let Some(scale) = step.settings.exposure_scale else { continue };
        for (camera, stated) in [("davis", &rig.davis.camera), ("pi", &rig.pi.camera)] {
            let exposure = Span::from_secs_f64(stated.exposure.as_secs_f64() * scale);
            let period = Span::from_secs_f64(1.0 / stated.frame_rate.0);
            if exposure > period {
                let segment = step.label.clone();
                return Err(PathError::Exposure { segment, camera, exposure, period });
            }
        }
    }
    Ok(())
}

/// Remarks for the operator, a sentence each.
pub(super) fn remarks(path: &ToolPath, rig: &Rig, views: &[TargetVisibility]) -> Vec<String> {
    let mut remarks = Vec::new();
    let is_switched = rig.arm.port == ArmPort::Sim || rig.light.switched_by_output.is_some();
    let lit = path
        .steps()
        .iter()
        .filter(|step| step.settings.n_flashes > 0 || step.settings.light_level.is_some());
    let n_lit = lit.count();
    if n_lit > 0 && !is_switched {
        remarks.push(format!(
            "{n_lit} motions change the light, but the rig names no output that switches it \
             (light.switched_by_output): the operator has to"
        ));
    }
    for view in views.iter().filter(|view| view.target_visible < 1.0) {
        remarks.push(format!(
            "the {} does not see the whole target {:.0} % of the time",
            view.camera,
            100.0 * (1.0 - view.target_visible)
        ));
    }
    let n_prompts = path.steps().iter().filter(|step| step.settings.prompt.is_some()).count();
    if n_prompts > 0 {
        remarks.push(format!(
            "{n_prompts} motions wait for the operator; --without-optional leaves out the \
             optional ones"
        ));
    }
    remarks
}
