//! Trajectories: motion descriptions, and the timed poses they become.
//!
//! A description ([`Trajectory`]) is read from a file and states the figures to draw in
//! which plane. On a rig it becomes a [`ToolPath`]: motions from rest to rest, as
//! the arm's own planner runs them (it stops at every corner between commands).

mod build;
mod curve;
mod description;
mod disk;
mod margin;
mod path;
mod path_error;
mod plan;
mod profile;
mod remark;
mod segment;
mod view;

pub use build::OptionalSegments;
pub use curve::{CurveError, MotionCommand, ToolCurve};
pub use description::Trajectory;
pub use disk::StreamSize;
pub use margin::{Margin, violations};
pub use path::{PathPoint, PathStep, Rates, StepSettings, ToolPath};
pub use path_error::PathError;
pub use plan::{Infeasible, Plan, ProfilePoint, SegmentPlan};
pub use profile::Trapezoid;
pub use segment::{Direction, DrawingPlane, RatesOverride, Segment, SegmentKind, Turns};
pub use view::TargetVisibility;
