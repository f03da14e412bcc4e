//! A dataset on a real Slurm: the same bytes as here, past a task that is killed and jobs that are
//! cancelled.
//!
//! Starts munged, slurmctld and slurmd of its own in a folder of its own; says so and passes where they
//! are not installed (Debian: slurm-wlm, munge).

use crate::cluster::{Cluster, until};
use crate::sessions::{copy, dataset, dataset_of, evrig, json, tree};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::path::Path;

/// What every submission here asks for: the cluster is two processors and little memory.
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

/// The process that has a session, once one has.
fn process_of(session: &Path) -> Pid {
    let mut pid = None;
    until("a task has its session", || {
        let held = std::fs::read_to_string(session.join("derived/lock")).unwrap_or_default();
        // "process 4711 on host"; a text that is not whole yet names no process.
        let words: Vec<&str> = held.split_whitespace().collect();
        pid = matches!(words[..], ["process", _, "on", _]).then(|| words[1].parse().unwrap());
        pid.is_some()
    });
    Pid::from_raw(pid.unwrap()).unwrap()
}

#[test]
fn a_dataset_on_slurm_is_what_it_is_here_even_when_a_task_is_killed() {
    let Some(cluster) = Cluster::start() else {
        eprintln!("skipped: needs slurmctld, slurmd and munged (Debian: slurm-wlm, munge)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    // The second is long enough to be diagnosed, so that there is time to kill its task.
    let here = dataset_of(directory.path(), &[12, 24, 12]);
    copy(&here.join("s0"), &here.join("cut"));
    std::fs::write(here.join("cut/session.json"), "{").unwrap();
    let there = directory.path().join("there").join("dataset");
    copy(&here, &there);
    let (code, local, said) = json(evrig().arg("process").arg(&here).args(["--seed", "3"]));
    assert_eq!(code, 3, "{said}");

    let (code, submitted, said) = submit(&cluster, &there, &["--seed", "3"]);
    assert_eq!(code, 0, "{said}");
    assert_eq!(submitted["sessions"].as_array().unwrap().len(), 4);
    kill_process(process_of(&there.join("s1")), Signal::KILL).unwrap();
    cluster.wait_for(submitted["gather"].as_u64().unwrap());
    let again = job(&there);
    assert_eq!(
        (again["attempt"].as_u64(), &again["sessions"]),
        (Some(2), &Value::from(vec!["s1"]))
    );
    cluster.wait_for(again["gather"].as_u64().unwrap());

    let (code, status, said) = json(
        evrig()
            .env("SLURM_CONF", cluster.configuration())
            .args(["process", "--status"])
            .arg(&there),
    );
    assert_eq!(code, 0, "{said}");
    let verdicts: Vec<&str> = status["sessions"]
        .as_array()
        .unwrap()
        .iter()
        .map(|s| s["verdict"].as_str().unwrap_or("none"))
        .collect();
    assert_eq!(verdicts, ["failed", "ok", "ok", "ok"], "{status}");
    assert_eq!(local["n_ok"], 3);
    let (a, b) = (tree(&here), tree(&there));
    let names = |files: &[(String, Vec<u8>)]| {
        files.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>()
    };
    assert_eq!(names(&a), names(&b));
    for ((name, here), (_, there)) in a.iter().zip(&b) {
        assert!(here == there, "{name} differs");
    }
}

#[test]
fn variants_are_made_and_compared_on_slurm_as_they_are_here() {
    let Some(cluster) = Cluster::start() else {
        eprintln!("skipped: needs slurmctld, slurmd and munged (Debian: slurm-wlm, munge)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let here = dataset(directory.path(), 2);
    let there = directory.path().join("there").join("dataset");
    copy(&here, &there);
    // A list with a name that no shell may take for more, given from where it lies.
    let list = "it's a list.toml";
    let text = "[[variant]]\nname = \"plain\"\nfrom = \"frames\"\npreset = \"DVS346\"\n\
        [[variant]]\nname = \"other\"\nfrom = \"frames\"\nmodel = \"esim\"\n";
    std::fs::write(directory.path().join(list), text).unwrap();
    let asked = ["--variants", list, "--seed", "3"];
    let mut command = evrig();
    let command = command.current_dir(directory.path()).arg("process").arg(&here).args(asked);
    let (code, local, said) = json(command);
    assert_eq!(code, 0, "{said}");
    let names: Vec<&str> =
        local["variants"].as_array().unwrap().iter().map(|v| v["name"].as_str().unwrap()).collect();
    assert!(names.contains(&"plain") && names.contains(&"other"), "{names:?}");

    let mut command = evrig();
    command.current_dir(directory.path()).env("SLURM_CONF", cluster.configuration());
    let (code, submitted, said) = json(command.arg("compare").arg(&there).args(SMALL).args(asked));
    assert_eq!(code, 0, "{said}");
    cluster.wait_for(submitted["gather"].as_u64().unwrap());
    let (a, b) = (tree(&here), tree(&there));
    assert!(a.iter().any(|(name, _)| name == "s1/derived/compare-other/comparison.json"));
    let names = |files: &[(String, Vec<u8>)]| files.iter().map(|f| f.0.clone()).collect::<Vec<_>>();
    assert_eq!(names(&a), names(&b));
    for ((name, here), (_, there)) in a.iter().zip(&b) {
        assert!(here == there, "{name} differs");
    }
}

#[test]
fn jobs_that_wait_keep_others_out_and_jobs_that_are_cancelled_are_said_so() {
    let Some(cluster) = Cluster::start() else {
        eprintln!("skipped: needs slurmctld, slurmd and munged (Debian: slurm-wlm, munge)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 2);
    let (code, submitted, said) = submit(&cluster, &root, &["--sbatch=--begin=now+1hour"]);
    assert_eq!(code, 0, "{said}");
    let (code, _, said) = submit(&cluster, &root, &[]);
    assert_eq!(code, 1);
    let [array, gather] =
        [&submitted["arrays"][0][0], &submitted["gather"]].map(|id| id.as_u64().unwrap());
    assert!(said.contains(&format!("scancel {array} {gather}")), "{said}");
    let (code, _, said) =
        json(evrig().env("SLURM_CONF", cluster.configuration()).arg("process").arg(&root));
    assert_eq!(code, 1, "a run here is kept out as well: {said}");

    // The tasks are cancelled; the job behind them runs now and says so of each.
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
    // What failed is run by the next submission, and nothing else is.
    let (code, resumed, said) = submit(&cluster, &root, &["--only-failed"]);
    assert_eq!(code, 0, "{said}");
    cluster.wait_for(resumed["gather"].as_u64().unwrap());
    let index = std::fs::read_to_string(root.join("dataset.json")).unwrap();
    let index: Value = serde_json::from_str(&index).unwrap();
    assert!(index["sessions"].as_array().unwrap().iter().all(|s| s["verdict"] == "ok"), "{index}");
    let (code, nothing, _) = submit(&cluster, &root, &["--only-failed"]);
    assert_eq!((code, nothing["sessions"].as_array().map(Vec::len)), (0, Some(0)));
}

#[test]
fn without_slurm_the_reason_is_said() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 1);
    let mut command = evrig();
    let (code, _, said) =
        json(command.env("PATH", "/nowhere").arg("process").arg(&root).args(SMALL));
    assert_eq!(code, 1);
    assert!(said.contains("sbatch") && said.contains("Slurm jobs can be submitted"), "{said}");
}
