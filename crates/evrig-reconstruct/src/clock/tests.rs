//! Planted offsets, steps and rates come back within the claimed error.

use super::*;
use evrig_core::time::{Davis, PiSensor, Span, Stamp, Unix};
use evrig_core::units::Pixels;

mod bad_input;
mod cameras;
mod latencies;
mod published;
mod readings;
mod seen_motion;
mod simulation;
