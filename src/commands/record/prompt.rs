//! Prompts at the terminal that never block, so that Ctrl-C works meanwhile.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::time::Duration;

/// Interval between checks for Enter.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// A terminal with somebody before it.
#[derive(Debug, Default)]
pub(super) struct Terminal {
    /// What was asked and not answered.
    asked: RefCell<Option<String>>,
}

impl Terminal {
    /// This program's, unless it asks nothing or is not interactive.
    pub(super) fn here(asks_nothing: bool) -> Option<Self> {
        let has_somebody = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        (has_somebody && !asks_nothing).then(Self::default)
    }

    /// Asks, the first time it is called with a text; whether Enter was pressed since.
    pub(super) fn is_answered(&self, text: &str) -> bool {
        let mut asked = self.asked.borrow_mut();
        if asked.as_deref() != Some(text) {
            // A terminal that cannot be written to still has an Enter key.
            let _ = write!(std::io::stderr(), "{text} [Enter] ");
            let _ = std::io::stderr().flush();
            *asked = Some(text.to_owned());
        }
        if !has_line() {
            return false;
        }
        let mut line = String::new();
        // An end of input answers as well: nobody is there to press anything.
        let _ = std::io::stdin().read_line(&mut line);
        *asked = None;
        true
    }
}

/// Whether a line is available; terminals deliver whole ones.
fn has_line() -> bool {
    let stdin = std::io::stdin();
    let mut fds = [PollFd::new(&stdin, PollFlags::IN)];
    poll(&mut fds, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok_and(|n| n > 0)
}
