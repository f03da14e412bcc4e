//! What a recorder delivered and lost, and why it cannot record.

/// What became of a recorder so far.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecorderTally {
    /// Samples put into the outlet.
    pub n_samples: u64,
    /// Samples lost because the outlet, or the device's own buffer, was full.
    pub n_dropped: u64,
    /// Interruptions and losses, in words, each with what is known of its length.
    pub gaps: Vec<String>,
    /// Whether a source that has an end, a recording, has reached it.
    pub is_over: bool,
}

/// Why a recorder cannot record.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {because}; {remedy}")]
pub struct RecorderError {
    /// Which, with its address.
    pub device: String,
    /// What happened: expected and got.
    pub because: String,
    /// What to do.
    pub remedy: &'static str,
}
