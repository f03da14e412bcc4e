//! A dataset processed on a real Slurm gives the same bytes as a local run, despite a killed task
//! and cancelled jobs.
//!
//! Starts munged, slurmctld and slurmd in a temporary folder; skipped where they are not installed
//! (Debian: slurm-wlm, munge).

use crate::cluster::{Cluster, until};
use crate::sessions::{copy, dataset, dataset_of, evrig, json, tree};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::path::Path;

/// Resources of every submission: the cluster has two processors and little memory.
const SMALL: [&str; 6] = ["--engine", "slurm", "--cpus", "1", "--memory", "300M"];

fn submit(cluster: &Cluster, root: &Path, more: &[&str]) -> (i32, Value, String) {
    let mut command = evrig();
    command.env("SLURM_CONF", cluster.configuration());
    json(command.arg("process").arg(root).args(SMALL).args(more))
}

fn job(root: &Path) -> Value {
    let text = std::fs::read_to_string(root.join("batch/slurm/job.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// The process that holds the lock of a session, once there is one.
fn process_of(session: &Path) -> Pid {
    let mut pid = None;
    until("a task has locked its session", || {
        let held = std::fs::read_to_string(session.join("derived/lock")).unwrap_or_default();
        // "process 4711 on host"; an incomplete text is ignored.
        let words: Vec<&str> = held.split_whitespace().collect();
        pid = matches!(words[..], ["process", _, "on", _]).then(|| words[1].parse().unwrap());
        pid.is_some()
    });
    Pid::from_raw(pid.unwrap()).unwrap()
}

fn assert_same_files(here: &Path, there: &Path) {
    let (here, there) = (tree(here), tree(there));
    let names = |files: &[(String, Vec<u8>)]| files.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&here), names(&there));
    for ((name, here), (_, there)) in here.iter().zip(&there) {
        assert!(here == there, "{name} differs");
    }
}

#[test]
fn a_dataset_on_slurm_equals_a_local_run_even_when_a_task_is_killed() {
    let Some(cluster) = Cluster::start() else {
        eprintln!("skipped: needs slurmctld, slurmd and munged (Debian: slurm-wlm, munge)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    // The second is long enough for a diagnosis, which leaves time to kill its task.
    let here = dataset_of(directory.path(), &[12, 24, 12]);
    copy(&here.join("s0"), &here.join("cut"));
    std::fs::write(here.join("cut/session.json"), "{").unwrap();
    let there = directory.path().join("there").join("dataset");
    copy(&here, &there);
    let (code, local, stderr) = json(evrig().arg("process").arg(&here).args(["--seed", "3"]));
    assert_eq!(code, 3, "{stderr}");

    let (code, submitted, stderr) = submit(&cluster, &there, &["--seed", "3"]);
    assert_eq!(code, 0, "{stderr}");
    assert_eq!(submitted["sessions"].as_array().unwrap().len(), 4);
    kill_process(process_of(&there.join("s1")), Signal::KILL).unwrap();
    cluster.wait_for(submitted["gather"].as_u64().unwrap());
    let again = job(&there);
    assert_eq!(
        (again["attempt"].as_u64(), &again["sessions"]),
        (Some(2), &Value::from(vec!["s1"]))
    );
    cluster.wait_for(again["gather"].as_u64().unwrap());

    let (code, status, stderr) = json(
        evrig()
            .env("SLURM_CONF", cluster.configuration())
            .args(["process", "--status"])
            .arg(&there),
    );
    assert_eq!(code, 0, "{stderr}");
    let verdicts: Vec<&str> = status["sessions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s["verdict"].as_str().unwrap_or("none"))
        .collect();
    assert_eq!(verdicts, ["failed", "ok", "ok", "ok"], "{status}");
    assert_eq!(local["n_ok"], 3);
    assert_same_files(&here, &there);
}

#[test]
fn variants_on_slurm_equal_a_local_run() {
    let Some(cluster) = Cluster::start() else {
        eprintln!("skipped: needs slurmctld, slurmd and munged (Debian: slurm-wlm, munge)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let here = dataset(directory.path(), 2);
    let there = directory.path().join("there").join("dataset");
    copy(&here, &there);
    // A list whose name needs quoting, given relative to its folder.
    let list = "it's a list.toml";
    let text = "[[variant]]\nname = \"plain\"\nfrom = \"frames\"\npreset = \"DVS346\"\n\
        [[variant]]\nname = \"other\"\nfrom = \"frames\"\nmodel = \"esim\"\n";
    std::fs::write(directory.path().join(list), text).unwrap();
    let asked = ["--variants", list, "--seed", "3"];
    let mut command = evrig();
    let command = command.current_dir(directory.path()).arg("process").arg(&here).args(asked);
    let (code, local, stderr) = json(command);
    assert_eq!(code, 0, "{stderr}");
    let names: Vec<&str> =
        local["variants"].as_array().unwrap().iter().map(|v| v["name"].as_str().unwrap()).collect();
    assert!(names.contains(&"plain") && names.contains(&"other"), "{names:?}");

    let mut command = evrig();
    command.current_dir(directory.path()).env("SLURM_CONF", cluster.configuration());
    let (code, submitted, stderr) =
        json(command.arg("compare").arg(&there).args(SMALL).args(asked));
    assert_eq!(code, 0, "{stderr}");
    cluster.wait_for(submitted["gather"].as_u64().unwrap());
    assert!(here.join("s1/derived/compare-other/comparison.json").is_file());
    assert_same_files(&here, &there);
}

#[test]
fn pending_jobs_block_other_runs_and_cancelled_jobs_are_reported() {
    let Some(cluster) = Cluster::start() else {
        eprintln!("skipped: needs slurmctld, slurmd and munged (Debian: slurm-wlm, munge)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 2);
    let (code, submitted, stderr) = submit(&cluster, &root, &["--sbatch=--begin=now+1hour"]);
    assert_eq!(code, 0, "{stderr}");
    let (code, _, stderr) = submit(&cluster, &root, &[]);
    assert_eq!(code, 1);
    let [array, gather] =
        [&submitted["arrays"][0][0], &submitted["gather"]].map(|id| id.as_u64().unwrap());
    assert!(stderr.contains(&format!("scancel {array} {gather}")), "{stderr}");
    let (code, _, stderr) =
        json(evrig().env("SLURM_CONF", cluster.configuration()).arg("process").arg(&root));
    assert_eq!(code, 1, "a local run is refused as well: {stderr}");

    // The tasks are cancelled; the gathering job runs now and reports each of them.
    let ids = [array.to_string(), gather.to_string()];
    assert!(cluster.tool("scancel").arg(&ids[0]).status().unwrap().success());
    let update = ["update", &format!("JobId={gather}"), "StartTime=now"].map(str::to_owned);
    assert!(cluster.tool("scontrol").args(update).status().unwrap().success());
    cluster.wait_for(gather);
    let status = ["process", "--status"];
    let (_, status, _) =
        json(evrig().env("SLURM_CONF", cluster.configuration()).args(status).arg(&root));
    for session in status["sessions"].as_array().unwrap() {
        assert_eq!(session["verdict"], "failed", "{status}");
        assert_eq!(session["because"][0], "its task was cancelled", "{status}");
    }
    // The next submission runs only failed sessions.
    let (code, resumed, stderr) = submit(&cluster, &root, &["--only-failed"]);
    assert_eq!(code, 0, "{stderr}");
    cluster.wait_for(resumed["gather"].as_u64().unwrap());
    let index = std::fs::read_to_string(root.join("dataset.json")).unwrap();
    let index: Value = serde_json::from_str(&index).unwrap();
    assert!(index["sessions"].as_array().unwrap().iter().all(|s| s["verdict"] == "ok"), "{index}");
    let (code, nothing, _) = submit(&cluster, &root, &["--only-failed"]);
    assert_eq!((code, nothing["sessions"].as_array().map(Vec::len)), (0, Some(0)));
}

#[test]
fn without_slurm_the_reason_is_reported() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 1);
    let mut command = evrig();
    let (code, _, stderr) =
        json(command.env("PATH", "/nowhere").arg("process").arg(&root).args(SMALL));
    assert_eq!(code, 1);
    assert!(
        stderr.contains("sbatch") && stderr.contains("Slurm jobs can be submitted"),
        "{stderr}"
    );
    assert!(!root.join("batch/slurm/job.json").exists(), "nothing was submitted");
}
