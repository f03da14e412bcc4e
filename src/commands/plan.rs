//! `plan`: a trajectory on a rig, and whether the arm can run it.

use super::{Ending, Output, WrongUse};
use crate::cli::PlanArgs;
use anyhow::Context;
use evrig_session::rig::{DescriptionError, Rig};
use evrig_session::trajectory::{OptionalSegments, Plan, Trajectory};

mod plot;
mod table;

pub(super) fn plan(args: &PlanArgs, output: &Output) -> anyhow::Result<Ending> {
    let rig = Rig::find(&args.rig).map_err(refused)?;
    let trajectory = Trajectory::find(&args.trajectory).map_err(refused)?;
    let optional =
        if args.without_optional { OptionalSegments::LeftOut } else { OptionalSegments::Included };
    let plan = Plan::new(&trajectory, &rig, optional)
        .map_err(|error| WrongUse(format!("{} on rig {}: {error}", args.trajectory, args.rig)))?;
    if let Some(file) = &args.plot {
        std::fs::write(file, plot::svg(&plan, &rig))
            .with_context(|| format!("cannot write the plot {}", file.display()))?;
        output.say(format_args!("the plot is in {}", file.display()));
    }
    output.result(&plan, table::PlanTable { plan: &plan, trajectory: &trajectory })?;
    Ok(if plan.is_feasible { Ending::Done } else { Ending::Negative })
}

/// A file that cannot be read is a failure; one that is wrong, or a name that is none, is wrong
/// use.
pub(super) fn refused(error: DescriptionError) -> anyhow::Error {
    match error {
        DescriptionError::Unreadable { .. } => error.into(),
        _ => WrongUse(error.to_string()).into(),
    }
}
