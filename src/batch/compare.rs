//! The comparison of a dataset: each session's simulated streams against its real one.

use super::{
    Aggregate, BatchError, BatchProgress, FoundSession, Index, IndexedSession, OnProgress,
    aggregate, index, lock_dataset, lock_session, read_splits, slurm, walk, write_comparison,
};
use crate::pipeline::{
    self, CompareRequest, PipelineError, PipelineProgress, VariantList, simulated_streams,
};
use evrig_session::{Session, StreamName};
use std::path::Path;

/// What to compare in each session.
#[derive(Debug, Clone, PartialEq)]
pub struct DatasetCompareRequest {
    /// The simulated stream; every one where none is given.
    pub stream: Option<StreamName>,
    /// The stream to compare with.
    pub real: String,
    /// Variants to generate first.
    pub variants: Option<VariantList>,
    /// Only the sessions of the rig whose id begins so.
    pub rig: Option<String>,
    /// Seed of the resampling.
    pub seed: u64,
    /// Run even when results are fresh.
    pub force: bool,
}

/// Compares the sessions of a dataset and writes the result into it. A session that cannot be
/// compared is stated in [`Aggregate::left_out`]. With it comes the index.
///
/// # Errors
/// When the request is wrong, the dataset is locked or being processed on Slurm, or the disk
/// refuses.
pub fn compare_dataset(
    root: &Path,
    request: &DatasetCompareRequest,
    progress: OnProgress<'_>,
) -> Result<(Index, Aggregate), BatchError> {
    let _held = lock_dataset(root)?;
    slurm::refuse_if_under_way(root)?;
    let found = walk(root)?;
    let index = index(root, &found, &read_splits(root)?);
    let chosen = of_rig(&found, &index, request.rig.as_deref())?;
    let mut lost = Vec::new();
    progress(BatchProgress::Sessions(chosen.len() as u64));
    for one in &chosen {
        if let Ok(session) = &one.session {
            match compare_session(session, request, progress) {
                Err(error @ BatchError::Pipeline(PipelineError::Request(_))) => return Err(error),
                Err(error) => {
                    lost.push(format!("{}: {}", one.key, one.relative(&error.to_string())))
                }
                Ok(()) => {}
            }
        }
        progress(BatchProgress::Compared(&one.key));
    }
    let mut aggregate = aggregate(&index.name, &chosen, request.rig.as_deref(), request.seed);
    aggregate.left_out.extend(lost);
    write_comparison(root, &aggregate)?;
    Ok((index, aggregate))
}

fn of_rig<'a>(
    found: &'a [FoundSession],
    index: &Index,
    wanted: Option<&str>,
) -> Result<Vec<&'a FoundSession>, BatchError> {
    let Some(wanted) = wanted else { return Ok(found.iter().collect()) };
    let is_of_rig =
        |session: &IndexedSession| session.rig.as_ref().is_some_and(|rig| rig.starts_with(wanted));
    let all = found.iter().zip(&index.sessions);
    let chosen: Vec<&FoundSession> =
        all.filter(|(_, session)| is_of_rig(session)).map(|(one, _)| one).collect();
    if chosen.is_empty() {
        let known: Vec<&str> = index.rigs.iter().map(|rig| rig.id.as_str()).collect();
        let what = format!("no session is of a rig `{wanted}`; known rigs: {}", known.join("; "));
        return Err(PipelineError::Request(what).into());
    }
    Ok(chosen)
}

fn compare_session(
    session: &Session,
    request: &DatasetCompareRequest,
    progress: OnProgress<'_>,
) -> Result<(), BatchError> {
    let DatasetCompareRequest { seed, force, .. } = *request;
    let _held = lock_session(session)?;
    if let Some(list) = &request.variants {
        let stage = |stage: PipelineProgress<'_>| progress(BatchProgress::Stage(stage));
        pipeline::variants(session, list, seed, force, &stage)?.require_any(session)?;
    }
    let streams = match &request.stream {
        Some(name) => vec![name.clone()],
        None => simulated_streams(session, &request.real),
    };
    for simulated in streams {
        let request = CompareRequest { real: request.real.clone(), simulated, seed, force };
        match pipeline::compare(session, &request) {
            // Streams on different grids are compared once they are filtered to a common one.
            Ok(_) | Err(PipelineError::Missing { .. }) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
