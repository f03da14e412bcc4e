//! Runs the diagnosis as a user would: by its commands, in separate processes that get the path of
//! the session only, within a deadline.

use super::record::DiagnosisOutcome;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Stages before the diagnosis. A failure of one of them, such as a missing tag, is a property of
/// the session that the diagnosis reports.
const BEFORE: &[&str] = &["track", "sync", "scene"];

/// The program that diagnoses, its arguments and its deadline.
#[derive(Debug, Clone)]
pub struct DiagnosisProcess {
    /// The program `evrig`.
    pub program: PathBuf,
    /// Arguments of `evrig diagnose` beside the session.
    pub arguments: Vec<String>,
    /// Time limit of all stages of a session together.
    pub deadline: Duration,
}

/// How a process ended.
enum ProcessEnd {
    Exited { is_success: bool, printed: Vec<u8>, message: String },
    Stopped,
    NotStarted(std::io::Error),
}

impl DiagnosisProcess {
    /// Diagnoses a session. Every stage is recomputed: stored results may be of another build.
    #[must_use]
    pub fn diagnose(&self, session: &Path) -> DiagnosisOutcome {
        let begun = Instant::now();
        let out_of_time = || DiagnosisOutcome::OutOfTime { after_s: self.deadline.as_secs_f64() };
        for stage in BEFORE {
            let end = self.run(&[*stage, "--force", "--quiet"], session, begun);
            if matches!(end, ProcessEnd::Stopped) {
                return out_of_time();
            }
        }
        let given = self.arguments.iter().map(String::as_str);
        let arguments: Vec<&str> =
            ["diagnose", "--force", "--json"].into_iter().chain(given).collect();
        match self.run(&arguments, session, begun) {
            ProcessEnd::Stopped => out_of_time(),
            ProcessEnd::NotStarted(error) => {
                DiagnosisOutcome::Failed { because: format!("{}: {error}", self.program.display()) }
            }
            ProcessEnd::Exited { is_success: false, message, .. } => {
                DiagnosisOutcome::Failed { because: message }
            }
            ProcessEnd::Exited { printed, .. } => match serde_json::from_slice(&printed) {
                Ok(diagnosis) => DiagnosisOutcome::Answered { diagnosis },
                Err(error) => DiagnosisOutcome::Failed { because: format!("no JSON: {error}") },
            },
        }
    }

    fn run(&self, arguments: &[&str], session: &Path, begun: Instant) -> ProcessEnd {
        let child = Command::new(&self.program)
            .args(arguments)
            .arg(session)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = match child {
            Ok(child) => child,
            Err(error) => return ProcessEnd::NotStarted(error),
        };
        // Both ends are read at once: a full pipe would hold the process up.
        let (sender, receiver) = channel();
        let mut readers = Vec::new();
        let pipes: [Option<Box<dyn Read + Send>>; 2] = [
            child.stdout.take().map(|pipe| Box::new(pipe) as _),
            child.stderr.take().map(|pipe| Box::new(pipe) as _),
        ];
        for (which, pipe) in pipes.into_iter().enumerate() {
            let sender = sender.clone();
            readers.push(std::thread::spawn(move || {
                let mut bytes = Vec::new();
                let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut bytes));
                let _ = sender.send((which, bytes));
            }));
        }
        let mut texts = [Vec::new(), Vec::new()];
        for _ in 0..2 {
            let left = self.deadline.saturating_sub(begun.elapsed());
            match receiver.recv_timeout(left) {
                Ok((which, bytes)) => texts[which] = bytes,
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    return stop(&mut child);
                }
            }
        }
        // Both pipes are closed: the process is at its end.
        let is_success = child.wait().is_ok_and(|status| status.success());
        let [printed, message] = texts;
        let message = String::from_utf8_lossy(&message).trim().to_owned();
        ProcessEnd::Exited { is_success, printed, message }
    }
}

fn stop(child: &mut Child) -> ProcessEnd {
    // It may have exited already.
    let _ = child.kill();
    let _ = child.wait();
    ProcessEnd::Stopped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn script(text: &str) -> (tempfile::TempDir, DiagnosisProcess) {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("program");
        std::fs::write(&program, format!("#!/bin/sh\n{text}\n")).unwrap();
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).unwrap();
        let arguments = vec!["--pixels".into(), "120".into()];
        let ask = DiagnosisProcess { program, arguments, deadline: Duration::from_secs(60) };
        (folder, ask)
    }

    #[test]
    fn the_stages_come_in_order_and_the_last_ones_answer_counts() {
        let (folder, ask) = script(
            "for last; do :; done\necho \"$1 $2\" >> \"$last/asked\"\n\
             [ \"$1\" = track ] && exit 1\n\
             [ \"$1\" = diagnose ] && echo \"{\\\"verdict\\\": \\\"$4 $5\\\"}\"\nexit 0",
        );
        let outcome = ask.diagnose(folder.path());
        let answer = outcome.answer().unwrap();
        assert_eq!(answer.verdict, "--pixels 120", "{outcome:?}");
        let asked = std::fs::read_to_string(folder.path().join("asked")).unwrap();
        assert_eq!(asked, "track --force\nsync --force\nscene --force\ndiagnose --force\n");
    }

    #[test]
    fn what_a_diagnosis_complains_of_is_kept() {
        let (folder, ask) = script("[ \"$1\" = diagnose ] && echo 'too few events' >&2 && exit 1");
        let outcome = ask.diagnose(folder.path());
        assert_eq!(outcome, DiagnosisOutcome::Failed { because: "too few events".into() });
    }

    #[test]
    fn a_diagnosis_that_does_not_end_is_stopped() {
        // `exec`: the process itself hangs, not a child that would keep the pipes open.
        let (folder, mut ask) = script("exec sleep 600");
        ask.deadline = Duration::from_millis(50);
        assert_eq!(ask.diagnose(folder.path()), DiagnosisOutcome::OutOfTime { after_s: 0.05 });
    }

    #[test]
    fn a_program_that_is_not_there_is_named() {
        let (folder, mut ask) = script("");
        ask.program = folder.path().join("missing");
        let DiagnosisOutcome::Failed { because } = ask.diagnose(folder.path()) else {
            panic!("it answered")
        };
        assert!(because.contains("missing"), "{because}");
    }
}
