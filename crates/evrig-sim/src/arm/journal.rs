//! What the simulated arm received, request by request.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::io::Write;

/// One request as the arm received it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RequestRecord {
    /// Host's monotonic clock, ns.
    pub host_ns: i64,
    /// The arm's own clock: ns since power-up.
    pub arm_ns: i64,
    /// Id of the command.
    pub id: u8,
    /// Its name.
    pub name: String,
    /// 0 read, 1 write, 3 queued.
    pub ctrl: u8,
    /// Parameter bytes in hex.
    pub params: String,
    /// Whether the arm moved or waited when the request came.
    pub was_busy: bool,
    /// Whether it does so after it.
    pub is_busy: bool,
    /// Commands waiting in the queue after it.
    pub n_waiting: usize,
}

/// The last requests in memory, all of them in a file if there is one.
pub struct RequestJournal {
    lines: VecDeque<RequestRecord>,
    file: Option<Box<dyn Write + Send>>,
}

impl RequestJournal {
    /// Lines kept in memory.
    const KEPT: usize = 100_000;

    /// A journal that also writes JSON lines to `file`.
    #[must_use]
    pub fn new(file: Option<Box<dyn Write + Send>>) -> Self {
        Self { lines: VecDeque::new(), file }
    }

    /// Adds a request. After a write error the file is abandoned; the record stays in memory.
    pub fn note(&mut self, line: RequestRecord) {
        if let (Some(file), Ok(json)) = (&mut self.file, serde_json::to_string(&line))
            && writeln!(file, "{json}").and_then(|()| file.flush()).is_err()
        {
            self.file = None;
        }
        if self.lines.len() == Self::KEPT {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }

    /// The last requests, oldest first.
    #[must_use]
    pub fn lines(&self) -> Vec<RequestRecord> {
        self.lines.iter().cloned().collect()
    }
}

impl std::fmt::Debug for RequestJournal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Journal of {} lines", self.lines.len())
    }
}
