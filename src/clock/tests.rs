//! Planted offsets, steps and rates come back within the claimed error.

use super::*;
use crate::time::{PiSensor, Span, Stamp, Unix};

mod simulation;
