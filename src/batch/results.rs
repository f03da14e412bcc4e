//! The files of a dataset after a run: index, card, comparison and report.

use super::{
    Aggregate, BatchError, Index, Splits, aggregate, card, comparison_page, dataset_page, index,
    read_index, walk,
};
use crate::pipeline::PipelineError;
use evrig_report::page::Page;
use std::path::Path;

/// Writes index, card, comparison and report from what the sessions hold now.
///
/// # Errors
/// When the dataset cannot be read or the disk refuses.
pub fn write_results(
    root: &Path,
    splits: &Splits,
    seed: u64,
) -> Result<(Index, Aggregate), BatchError> {
    let (index, aggregate) = collect(root, splits, seed)?;
    index.write(root)?;
    write(&root.join("CARD.md"), card(&index))?;
    write_comparison(root, &aggregate)?;
    write(&root.join("report.html"), html(&dataset_page(root, &index, &aggregate))?)?;
    Ok((index, aggregate))
}

/// Writes the comparison of a dataset as JSON, tables and a page.
///
/// # Errors
/// When the disk refuses.
pub fn write_comparison(root: &Path, aggregate: &Aggregate) -> Result<(), BatchError> {
    aggregate.write(root)?;
    write(&root.join("comparison.html"), html(&comparison_page(aggregate))?)
}

/// The report of a dataset as HTML, with the splits with which it was processed.
///
/// # Errors
/// When the dataset cannot be read.
pub fn dataset_report(root: &Path) -> Result<(Index, String), BatchError> {
    let (index, aggregate) = collect(root, &read_splits(root)?, 0)?;
    let html = html(&dataset_page(root, &index, &aggregate))?;
    Ok((index, html))
}

/// The splits with which a dataset was last processed; the default ones before.
///
/// # Errors
/// When its index is damaged.
pub fn read_splits(root: &Path) -> Result<Splits, BatchError> {
    let Some(index) = read_index(root)? else { return Ok(Splits::default()) };
    let shares = Splits::of_shares(index.shares).text();
    Ok(Splits::parse(&shares)?.drawn(index.split_by, index.split_seed))
}

fn collect(root: &Path, splits: &Splits, seed: u64) -> Result<(Index, Aggregate), BatchError> {
    let found = walk(root)?;
    let index = index(root, &found, splits);
    let all: Vec<_> = found.iter().collect();
    let aggregate = aggregate(&index.name, &all, None, seed);
    Ok((index, aggregate))
}

fn html(page: &Page) -> Result<String, BatchError> {
    Ok(page.to_html().map_err(PipelineError::from)?)
}

fn write(path: &Path, text: String) -> Result<(), BatchError> {
    std::fs::write(path, text).map_err(BatchError::io(path))
}
