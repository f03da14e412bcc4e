//! Simulators of other software as variants: real processes on the frames of a small session.

use crate::sessions::{evrig, json, python, text};
use evrig::format::npy::ArrayWriter;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Stdio;

const FIRST_US: i64 = 5_000_000;
const N_FRAMES: i64 = 12;

/// A session of 12 frames of 24 x 10 pixels, 10 ms apart from 5 s on, with some real events.
fn session(folder: &Path) -> PathBuf {
    let (frames, times) = (folder.join("frames.npy"), folder.join("times.npy"));
    let mut writer = ArrayWriter::<u16>::create(&frames, &[N_FRAMES as u64, 10, 24]).unwrap();
    for k in 0..N_FRAMES as u16 {
        let bright = |i: u16| (i % 24 + 24 - k) % 24 < 5;
        let frame: Vec<u16> =
            (0..240).map(|i| if bright(i) { 900 + 7 * (i % 7) } else { 200 }).collect();
        writer.extend(&frame).unwrap();
    }
    writer.finish().unwrap();
    let mut writer = ArrayWriter::<i64>::create(&times, &[N_FRAMES as u64]).unwrap();
    writer.extend(&(0..N_FRAMES).map(|k| FIRST_US + 10_000 * k).collect::<Vec<_>>()).unwrap();
    writer.finish().unwrap();
    let real = folder.join("real.csv");
    std::fs::write(&real, events(FIRST_US, 3)).unwrap();
    let session = folder.join("session");
    let import = ["import", "frames", text(&frames), "--timestamps", text(&times), "--events"];
    let (code, _, stderr) = json(evrig().args(import).arg(&real).arg("--out").arg(&session));
    assert_eq!(code, 0, "{stderr}");
    session
}

/// A table of events every 500 us for 110 ms.
fn events(first_us: i64, step: i64) -> String {
    let row = |i: i64| format!("{},{},{},{}\n", first_us + 500 * i, step * i % 24, i % 10, i % 2);
    "t_us,x,y,p\n".to_owned() + &(0..220).map(row).collect::<String>()
}

fn generate(session: &Path, list: &Path) -> (i32, Value, String) {
    json(evrig().args(["generate", text(session), "--variants", text(list)]))
}

#[test]
fn a_command_gets_frames_and_times_and_its_events_are_compared_on_the_sessions_clock() {
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    let (list, script) = (folder.path().join("list.toml"), folder.path().join("my sim.sh"));
    std::fs::write(folder.path().join("events.csv"), events(0, 5)).unwrap();
    // It keeps what it was given, and fails if it sees more of the environment than it should.
    let copy = "set -e; cp \"$1/000011.png\" \"$5\"; cp \"$2\" \"$5\"; echo $6 > \"$5/fps.txt\"
        [ -z \"$EVRIG_TEST\" ]; mkdir \"$3\"; cp \"$4\" \"$3\"; touch \"$3/notes.txt\"\n";
    std::fs::write(&script, copy).unwrap();
    let kept = folder.path().join("kept");
    std::fs::create_dir(&kept).unwrap();
    let command =
        format!("sh 'my sim.sh' {{frames}} {{times}} {{out}} events.csv {} {{fps}}", text(&kept));
    let variants = format!(
        "[[variant]]\nname = \"own\"\nfrom = \"frames\"\noutput = \"events.csv\"\n\
        command = \"{command}\"\n[[variant]]\nname = \"esim\"\nfrom = \"frames\"\nmodel = \"esim\"\n"
    );
    std::fs::write(&list, variants).unwrap();
    let run = || {
        let arguments = ["generate", text(&session), "--variants", "list.toml"];
        let mut evrig = evrig();
        json(evrig.env("EVRIG_TEST", "hidden").current_dir(folder.path()).args(arguments))
    };
    let (code, value, stderr) = run();
    assert_eq!(code, 0, "{stderr}");
    let own = &value["variants"][0];
    assert_eq!(own["because"], Value::Null, "{own}");
    assert_eq!(own["generation"]["events"], 220);
    assert_eq!(own["generation"]["first_us"], FIRST_US);
    assert_eq!(own["generation"]["parameters"]["command"], command);
    assert_eq!(own["comparison"]["window_us"][0], FIRST_US);
    let measures = own["comparison"]["measures"].as_array().unwrap();
    assert_eq!((measures.len(), &measures[0]["estimate"]["value"]), (11, &Value::from(1.0)));
    // Sixteen bits stay sixteen.
    let image = image::open(kept.join("000011.png")).unwrap().into_luma16();
    assert_eq!((image.dimensions(), image.get_pixel(11, 0).0), ((24, 10), [900 + 7 * 4]));
    let times = std::fs::read_to_string(kept.join("times.txt")).unwrap();
    assert!(times.starts_with("0.000000\n0.010000\n") && times.ends_with("0.110000\n"), "{times}");
    assert_eq!(std::fs::read_to_string(kept.join("fps.txt")).unwrap(), "100\n");
    assert!(!session.join("derived/external-own").exists(), "its folder is removed");

    // Fresh until the script changes.
    let is_fresh = || {
        let (code, value, stderr) = run();
        assert_eq!(code, 0, "{stderr}");
        value["variants"][0]["generation"]["fresh"].as_bool().unwrap()
    };
    assert!(is_fresh());
    std::fs::write(folder.path().join("events.csv"), events(0, 7)).unwrap();
    assert!(!is_fresh());
    assert!(is_fresh());
    let (code, compared, stderr) = json(evrig().arg("compare").arg(&session));
    assert_eq!(code, 0, "{stderr}");
    let names: Vec<&str> = compared["comparisons"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one["simulated"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["esim", "own"]);
}

#[test]
fn a_command_that_fails_is_left_out_with_one_clear_reason_and_the_others_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    write("late.csv", events(70_000, 5));
    write("wide.csv", events(0, 5).replace(",19,", ",24,"));
    write("text.csv", "not, a, table\n".into());
    let cases = [
        ("missing", "no-such-simulator {out}", "command not found: `no-such-simulator`"),
        ("failing", "sh -c 'echo first; echo the reason >&2; exit 7' {out}", "exit status: 7"),
        ("hanging", "sh -c 'echo waits; sleep 600' {out}", "killed at its deadline of 1 s"),
        ("silent", "true {out}", "it wrote no {out}"),
        ("unreadable", "cp text.csv {out}.csv", "its output cannot be used"),
        ("late", "cp late.csv {out}.csv", "outside the time of the frames"),
        ("wide", "cp wide.csv {out}.csv", "off the 24 x 10 grid"),
        ("several", "sh -c 'mkdir $0; touch $0/a $0/b' {out}", "holds a, b; name the event file"),
    ];
    let variant = |(name, command, _): &(&str, &str, &str)| {
        format!(
            "[[variant]]\nname = \"{name}\"\nfrom = \"frames\"\ncommand = \"{command}\"\n\
            deadline_s = {}\n",
            if *name == "hanging" { 1 } else { 600 }
        )
    };
    let good = "[[variant]]\nname = \"esim\"\nfrom = \"frames\"\nmodel = \"esim\"\n";
    write("list.toml", cases.iter().map(variant).collect::<String>() + good);
    let (code, value, stderr) = generate(&session, &folder.path().join("list.toml"));
    assert_eq!(code, 0, "{stderr}");
    for ((name, _, reason), made) in cases.iter().zip(value["variants"].as_array().unwrap()) {
        let because = made["because"].as_str().unwrap();
        assert!(because.contains(reason), "{name}: {because}");
        let log = session.join(format!("derived/external-{name}/log.txt"));
        assert!(because.contains(text(&log)), "{name}: {because}");
        let kept: Vec<_> = std::fs::read_dir(log.parent().unwrap()).unwrap().collect();
        assert_eq!(kept.len(), 1, "{name}: only the log is kept");
        assert_eq!(made["generation"], Value::Null, "{name}");
    }
    let because = |i: usize| value["variants"][i]["because"].as_str().unwrap();
    assert!(because(1).ends_with("\n    first\n    the reason"), "{}", because(1));
    assert!(because(2).ends_with("\n    waits"), "{}", because(2));
    assert_eq!(value["variants"][8]["because"], Value::Null, "{stderr}");
}

#[test]
fn a_wrong_description_is_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    let list = folder.path().join("list.toml");
    for (keys, reason) in [
        ("command = \"sim {out}\"\npreset = \"ESIM\"", "unknown field `preset`"),
        ("command = \"sim {frames}\"", "no {out}"),
        ("command = \"sim {out}\"\ninputs = [\"weights.pt\"]", "weights.pt is no file"),
        ("command = \"sim {out}\"\ntime_unit = \"min\"", "key time_unit"),
        ("model = \"esim\"\ndeadline_s = 5", "unknown field `deadline_s`"),
    ] {
        std::fs::write(&list, format!("[[variant]]\nname = \"n\"\nfrom = \"frames\"\n{keys}\n"))
            .unwrap();
        let (code, _, stderr) = generate(&session, &list);
        assert!(code == 2 && stderr.contains(reason), "{keys}: {code} {stderr}");
    }
}

#[test]
fn an_interrupt_ends_the_simulator_and_its_children() {
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    let list = folder.path().join("list.toml");
    let child = folder.path().join("child");
    let script = format!("sleep 600 & echo $! > {0}.new; mv {0}.new {0}; wait", text(&child));
    std::fs::write(
        &list,
        format!(
            "[[variant]]\nname = \"n\"\nfrom = \"frames\"\ncommand = \"sh -c '{script}' {{out}}\"\n"
        ),
    )
    .unwrap();
    let mut program = std::process::Command::new(assert_cmd::cargo::cargo_bin("evrig"))
        .args(["generate", text(&session), "--variants", text(&list)])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while !child.exists() {
        assert!(program.try_wait().unwrap().is_none(), "it ended early");
        std::thread::yield_now();
    }
    let id = rustix::process::Pid::from_child(&program);
    rustix::process::kill_process(id, rustix::process::Signal::INT).unwrap();
    let status = program.wait().unwrap();
    assert_eq!(std::os::unix::process::ExitStatusExt::signal(&status), Some(2));
    let stat = format!("/proc/{}/stat", std::fs::read_to_string(&child).unwrap().trim());
    let is_alive = || {
        let stat = std::fs::read_to_string(&stat).unwrap_or_default();
        stat.rsplit(") ").next().is_some_and(|rest| !rest.is_empty() && !rest.starts_with('Z'))
    };
    while is_alive() {
        std::thread::yield_now();
    }
}

#[test]
fn the_example_in_python_agrees_with_the_model_that_it_repeats() {
    let Some(python) = python("numpy and pillow") else { return };
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    let script = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("examples/external-simulator/threshold_crossings.py");
    let list = folder.path().join("list.toml");
    let variants = format!(
        "[[variant]]\nname = \"numpy\"\nfrom = \"frames\"\n\
        command = \"{python} {} {{frames}} {{times}} {{out}}\"\n\
        [[variant]]\nname = \"esim\"\nfrom = \"frames\"\nmodel = \"esim\"\nfull_scale_dn = 1023\n",
        text(&script)
    );
    std::fs::write(&list, variants).unwrap();
    let (code, value, stderr) = generate(&session, &list);
    assert_eq!(code, 0, "{stderr}");
    let n = |i: usize| value["variants"][i]["generation"]["events"].as_u64().unwrap_or(0);
    // 50 edges of 10 rows, ln(900 / 200) / 0.2 = 7 thresholds each; the offsets before the
    // logarithm differ.
    assert!(n(0) > 1_000 && n(0).abs_diff(n(1)) < n(1) / 5, "{} {}", n(0), n(1));
}
