//! What a running pipeline reports to its caller.

/// One report of progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PipelineProgress<'a> {
    /// Units of a stage that are done, and in all; 0 in all where that is not known.
    Stage {
        /// The stage.
        stage: &'static str,
        /// The stream it works on; empty where it works on the session.
        stream: &'a str,
        /// Units done.
        done: u64,
        /// Units in all.
        total: u64,
    },
    /// What the diagnosis computes now.
    Diagnosis(&'a str),
    /// An intermediate result in a line.
    Message(&'a str),
}
