//! A program in a process group of its own, with a deadline.
//!
//! The group is killed when the deadline is over, when the program has ended (what it left behind
//! is not waited for), when evrig is interrupted, and when the work unwinds.

use crate::program::is_hosted;
use rustix::process::{Pid, Signal, WaitId, WaitIdOptions, kill_process_group, waitid};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;
use std::fs::File;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Variables of the environment that a simulator gets; no other can change its events.
const ENVIRONMENT: [&str; 3] = ["PATH", "HOME", "LANG"];

/// Time between two reports of progress, as a display is refreshed once a second.
const REPORT_INTERVAL: Duration = Duration::from_secs(1);

/// How a program ended.
#[derive(Debug)]
pub(super) enum GroupEnd {
    /// By itself.
    Exited(ExitStatus),
    /// It was killed at the deadline.
    OutOfTime,
}

/// Runs `words` in `folder` with both outputs in the file `log`, and calls `waiting` every second.
///
/// # Errors
/// When the program cannot be started.
pub(super) fn run(
    words: &[String],
    folder: &Path,
    log: &Path,
    deadline: Duration,
    waiting: &mut dyn FnMut(),
) -> io::Result<GroupEnd> {
    let output = File::create(log)?;
    let (program, arguments) =
        words.split_first().ok_or_else(|| io::Error::other("the command is empty"))?;
    let kept = ENVIRONMENT.iter().filter_map(|name| Some((name, std::env::var_os(name)?)));
    let mut command = Command::new(program);
    command
        .args(arguments)
        .current_dir(folder)
        .env_clear()
        .envs(kept)
        .stdin(Stdio::null())
        .stdout(output.try_clone()?)
        .stderr(output)
        .process_group(0);
    let mut group = ProcessGroup::spawn(&mut command)?;
    let began = Instant::now();
    let ended = group.leader_end();
    loop {
        let left = deadline.saturating_sub(began.elapsed());
        match ended.recv_timeout(left.min(REPORT_INTERVAL)) {
            Ok(()) | Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) if left.is_zero() => {
                group.kill();
                group.child.wait()?;
                return Ok(GroupEnd::OutOfTime);
            }
            Err(RecvTimeoutError::Timeout) => waiting(),
        }
    }
    group.kill();
    Ok(GroupEnd::Exited(group.child.wait()?))
}

/// The groups that run now.
static RUNNING: Mutex<Vec<Pid>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<Pid>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

struct ProcessGroup {
    child: Child,
    id: Pid,
}

impl ProcessGroup {
    fn spawn(command: &mut Command) -> io::Result<Self> {
        kill_on_signals()?;
        // Held over the start: an interrupt finds the group or comes before it.
        let mut running = running();
        let child = command.spawn()?;
        let id = Pid::from_child(&child);
        running.push(id);
        Ok(Self { child, id })
    }

    /// Sends once the first process of the group has ended. It is not reaped, so that no other
    /// group can have its number.
    fn leader_end(&self) -> std::sync::mpsc::Receiver<()> {
        let (sender, receiver) = channel();
        let id = self.id;
        std::thread::spawn(move || {
            let _ = waitid(WaitId::Pid(id), WaitIdOptions::EXITED | WaitIdOptions::NOWAIT);
            let _ = sender.send(());
        });
        receiver
    }

    /// Kills every process of the group, once.
    fn kill(&self) {
        let mut running = running();
        if let Some(at) = running.iter().position(|id| *id == self.id) {
            running.swap_remove(at);
            // A group whose processes have all ended is no failure.
            let _ = kill_process_group(self.id, Signal::KILL);
        }
    }
}

impl Drop for ProcessGroup {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

/// Kills the groups that run when evrig is interrupted, which then ends as it would without. A
/// program that hosts the library handles signals itself, and the work unwinds.
fn kill_on_signals() -> io::Result<()> {
    static IS_WATCHED: Mutex<bool> = Mutex::new(false);
    let mut is_watched = IS_WATCHED.lock().unwrap_or_else(PoisonError::into_inner);
    if *is_watched || is_hosted() {
        return Ok(());
    }
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    std::thread::spawn(move || {
        for signal in signals.forever() {
            let running = running();
            for id in running.iter() {
                let _ = kill_process_group(*id, Signal::KILL);
            }
            let _ = emulate_default_handler(signal);
        }
    });
    *is_watched = true;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str, deadline: Duration) -> (tempfile::TempDir, io::Result<GroupEnd>) {
        let folder = tempfile::tempdir().unwrap();
        let words = ["sh", "-c", script].map(str::to_owned);
        let log = folder.path().join("log.txt");
        let end = run(&words, folder.path(), &log, deadline, &mut || {});
        (folder, end)
    }

    /// Waits until the process named in the file `child` has ended; one that waits to be reaped has.
    fn wait_for_child(folder: &Path) {
        let child = std::fs::read_to_string(folder.join("child")).unwrap();
        let stat = format!("/proc/{}/stat", child.trim());
        let is_alive = || {
            let stat = std::fs::read_to_string(&stat).unwrap_or_default();
            stat.rsplit(") ").next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with('Z'))
        };
        while is_alive() {
            std::thread::yield_now();
        }
    }

    #[test]
    fn a_program_runs_in_its_folder_with_a_bare_environment_and_its_output_is_kept() {
        let script = "pwd; env | cut -d= -f1 | sort | tr '\\n' ' '; echo wrong >&2; exit 3";
        let (folder, end) = shell(script, Duration::from_secs(60));
        let Ok(GroupEnd::Exited(status)) = end else { panic!("{end:?}") };
        assert_eq!(status.code(), Some(3));
        let log = std::fs::read_to_string(folder.path().join("log.txt")).unwrap();
        let lines: Vec<&str> = log.lines().collect();
        assert_eq!(lines[0], folder.path().canonicalize().unwrap().to_str().unwrap());
        assert!(log.contains("wrong"), "{log}");
        for name in lines[1].split_whitespace().filter(|name| *name != "wrong") {
            // A shell adds some of its own.
            let of_shell = ["PWD", "OLDPWD", "SHLVL", "_"];
            assert!(ENVIRONMENT.contains(&name) || of_shell.contains(&name), "{name}");
        }
    }

    #[test]
    fn the_whole_group_is_killed_at_the_deadline() {
        let script = "sleep 600 & echo $! > child; wait";
        let (folder, end) = shell(script, Duration::from_millis(500));
        assert!(matches!(end, Ok(GroupEnd::OutOfTime)), "{end:?}");
        wait_for_child(folder.path());
    }

    #[test]
    fn what_a_program_leaves_behind_is_ended_with_it() {
        let script = "sleep 600 & echo $! > child";
        let (folder, end) = shell(script, Duration::from_secs(60));
        assert!(matches!(end, Ok(GroupEnd::Exited(status)) if status.success()));
        wait_for_child(folder.path());
    }
}
