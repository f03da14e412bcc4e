//! Whole comparisons, with planted truths.

use super::*;
