//! Steps of the target clock.

use std::ops::Range;

/// Length of the blocks whose minima are compared, seconds.
const BLOCK_S: f64 = 0.5;
/// Blocks on each side of a boundary; a stall is shorter than they are together.
const BLOCKS_PER_SIDE: usize = 4;
/// Blocks between a step and either end of the recording: a stall at the end resembles a step.
const END_BLOCKS: usize = 3;

struct TimeBlock {
    frames: Range<usize>,
    smallest: f64,
}

/// Ranges of frames between steps larger than `threshold_us`.
///
/// A delayed frame raises its own difference and leaves the minimum of its neighbours;
/// a step moves the minimum of all that follow.
pub(super) fn between_steps(x_s: &[f64], y_us: &[f64], threshold_us: f64) -> Vec<Range<usize>> {
    let blocks = blocks(x_s, y_us);
    let mut bounds = vec![0];
    let mut at = END_BLOCKS;
    while at + END_BLOCKS <= blocks.len() {
        let Some(change) = step_at(&blocks, at, threshold_us) else {
            at += 1;
            continue;
        };
        at = place_of(&blocks, at, change, threshold_us);
        let is_down = change < 0.0;
        bounds.push(if is_down {
            first_low(&blocks, y_us, at)
        } else {
            after_last_low(&blocks, y_us, at)
        });
        at += BLOCKS_PER_SIDE;
    }
    bounds.push(x_s.len());
    bounds.dedup();
    bounds.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

fn blocks(x_s: &[f64], y_us: &[f64]) -> Vec<TimeBlock> {
    let mut blocks: Vec<TimeBlock> = Vec::new();
    let mut number = i64::MIN;
    for (index, (x, y)) in x_s.iter().zip(y_us).enumerate() {
        let own = (x / BLOCK_S) as i64;
        match blocks.last_mut() {
            Some(block) if own == number => {
                block.frames.end = index + 1;
                block.smallest = block.smallest.min(*y);
            }
            _ => blocks.push(TimeBlock { frames: index..index + 1, smallest: *y }),
        }
        number = own;
    }
    blocks
}

fn smallest(blocks: &[TimeBlock]) -> f64 {
    blocks.iter().map(|block| block.smallest).fold(f64::INFINITY, f64::min)
}

/// Minima before and after the boundary in front of block `at`.
fn sides(blocks: &[TimeBlock], at: usize) -> [f64; 2] {
    let end = (at + BLOCKS_PER_SIDE).min(blocks.len());
    [smallest(&blocks[at.saturating_sub(BLOCKS_PER_SIDE)..at]), smallest(&blocks[at..end])]
}

fn step_at(blocks: &[TimeBlock], at: usize, threshold_us: f64) -> Option<f64> {
    let [before, after] = sides(blocks, at);
    let change = after - before;
    (change.abs() > threshold_us).then_some(change)
}

/// The boundary of a step first detected at `at`.
///
/// The look-ahead detects a downward step early, so the last boundary with the full change is
/// taken. A few frames before an upward step in its block show part of it early, so the first
/// boundary with the full change is taken.
fn place_of(blocks: &[TimeBlock], mut at: usize, change: f64, threshold_us: f64) -> usize {
    let mut best = change;
    while at + 1 + END_BLOCKS <= blocks.len() {
        let [before, after] = sides(blocks, at + 1);
        let next = after - before;
        let shows_all = if change < 0.0 {
            next <= best + threshold_us && next < -threshold_us
        } else {
            next > best + threshold_us
        };
        if !shows_all {
            break;
        }
        best = if change < 0.0 { best.min(next) } else { next };
        at += 1;
    }
    at
}

/// The first frame that a downward step in block `at` can affect.
fn first_low(blocks: &[TimeBlock], y_us: &[f64], at: usize) -> usize {
    let [before, after] = sides(blocks, at);
    let middle = before.midpoint(after);
    let start = blocks[at].frames.start;
    blocks[at].frames.clone().find(|&frame| y_us[frame] < middle).unwrap_or(start)
}

/// The frame after the last one that an upward step at block `at` cannot affect.
///
/// The step may lie within block `at - 1`, whose early frames kept its minimum low.
fn after_last_low(blocks: &[TimeBlock], y_us: &[f64], at: usize) -> usize {
    let [before, after] = sides(blocks, at);
    let middle = before.midpoint(after);
    let frames = blocks[at - 1].frames.start..blocks[at].frames.end;
    let last = frames.rev().find(|&frame| y_us[frame] < middle);
    last.map_or(blocks[at].frames.start, |frame| frame + 1)
}
