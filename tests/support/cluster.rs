//! A Slurm cluster of one node in one folder: munged, slurmctld and slurmd.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longest wait for a daemon or a job.
const PATIENCE: Duration = Duration::from_secs(120);

pub(crate) struct Cluster {
    folder: tempfile::TempDir,
    daemons: Vec<Child>,
}

/// Path of a program; Debian keeps daemons outside the search path of users.
fn find(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::env::split_paths(&path).chain(["/usr/sbin".into(), "/sbin".into()]);
    folders.map(|folder| folder.join(program)).find(|program| program.is_file())
}

impl Cluster {
    /// None where Slurm is not installed.
    pub(crate) fn start() -> Option<Self> {
        let programs = ["munged", "munge", "slurmctld", "slurmd", "sbatch", "squeue"].map(find);
        if programs.iter().any(Option::is_none) {
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let mut cluster = Self { folder, daemons: Vec::new() };
        let root = cluster.folder.path().to_owned();
        let at = |name: &str| root.join(name).display().to_string();
        let key: Vec<u8> = (0..128_u16).map(|i| (i * 37 % 251) as u8).collect();
        std::fs::write(root.join("key"), key).unwrap();
        let private = std::os::unix::fs::PermissionsExt::from_mode(0o600);
        std::fs::set_permissions(root.join("key"), private).unwrap();
        for name in ["state", "spool"] {
            std::fs::create_dir(root.join(name)).unwrap();
        }
        let host = stdout(&mut Command::new("hostname"));
        let host = host.trim().split('.').next().unwrap().to_owned();
        std::fs::write(root.join("slurm.conf"), configuration(&root, &host)).unwrap();
        cluster.daemon(
            "munged",
            &[
                "--force",
                "--foreground",
                &format!("--key-file={}", at("key")),
                &format!("--socket={}", at("munge.sock")),
                &format!("--pid-file={}", at("munged.pid")),
                &format!("--log-file={}", at("munged.log")),
                &format!("--seed-file={}", at("seed")),
            ],
        );
        let socket = format!("--socket={}", at("munge.sock"));
        until("munged answers", || succeeds(Command::new("munge").args(["-n", &socket])));
        cluster.daemon("slurmctld", &["-D", "-f", &at("slurm.conf")]);
        cluster.daemon("slurmd", &["-D", "-f", &at("slurm.conf"), "-N", &host]);
        until("the node is idle", || {
            let mut sinfo = cluster.tool("sinfo");
            stdout(sinfo.args(["--noheader", "--format=%T"])).trim() == "idle"
        });
        Some(cluster)
    }

    fn daemon(&mut self, program: &str, arguments: &[&str]) {
        let log = std::fs::File::create(self.folder.path().join(format!("{program}.out"))).unwrap();
        let mut command = Command::new(find(program).unwrap());
        command.args(arguments).env("SLURM_CONF", self.configuration());
        command.stdin(Stdio::null()).stdout(log.try_clone().unwrap()).stderr(log);
        self.daemons.push(command.spawn().unwrap());
    }

    pub(crate) fn configuration(&self) -> PathBuf {
        self.folder.path().join("slurm.conf")
    }

    /// A Slurm command configured for this cluster.
    pub(crate) fn tool(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.configuration());
        command
    }

    /// Waits until a job has ended, with any result.
    pub(crate) fn wait_for(&self, job: u64) {
        let dependency = format!("--dependency=afterany:{job}");
        // srun is notified when it may start; `sbatch --wait` polls at increasing intervals.
        let options = ["--ntasks=1", "--mem=1M", "--quiet", &dependency, "true"];
        assert!(succeeds(self.tool("srun").args(options)), "job {job} can be waited for");
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        for daemon in self.daemons.iter_mut().rev() {
            let pid = rustix::process::Pid::from_child(daemon);
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
            let _ = daemon.wait();
        }
    }
}

fn configuration(root: &Path, host: &str) -> String {
    let user = stdout(Command::new("id").arg("-un"));
    let (user, root) = (user.trim(), root.display());
    let ports: Vec<TcpListener> =
        (0..2).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
    let port = |i: usize| ports[i].local_addr().unwrap().port();
    let (control, node) = (port(0), port(1));
    format!(
        "ClusterName=evrig\nSlurmctldHost={host}(127.0.0.1)\nSlurmUser={user}\nSlurmdUser={user}\n\
         AuthType=auth/munge\nAuthInfo=socket={root}/munge.sock\n\
         SlurmctldPort={control}\nSlurmdPort={node}\n\
         StateSaveLocation={root}/state\nSlurmdSpoolDir={root}/spool\n\
         SlurmctldPidFile={root}/slurmctld.pid\nSlurmdPidFile={root}/slurmd.pid\n\
         ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSwitchType=switch/none\n\
         MpiDefault=none\nSchedulerType=sched/backfill\n\
         SelectType=select/cons_tres\nSelectTypeParameters=CR_CPU\nReturnToService=2\n\
         AccountingStorageType=accounting_storage/none\nJobAcctGatherType=jobacct_gather/none\n\
         NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=1000 State=UNKNOWN\n\
         PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP\n"
    )
}

fn succeeds(command: &mut Command) -> bool {
    let command = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

fn stdout(command: &mut Command) -> String {
    let output = command.stdin(Stdio::null()).stderr(Stdio::null()).output();
    output.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default()
}

/// Polls until the condition holds; the daemons offer no notification.
pub(crate) fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        std::thread::sleep(Duration::from_millis(2));
    }
}
