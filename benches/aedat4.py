"""Compares AEDAT4 with dv-processing and faery on the same data in one run.

    python3 benches/aedat4.py [--events 20e6] [--repeats 5] [--dir DIR]

Makes a virtual environment in DIR (default target/bench-aedat4) with dv-processing and faery from
PyPI, builds `benches/aedat4.rs` in release, makes one file of real events (tiles of
tests/data/davis346-street.aedat4), lets dv-processing write it in each compression, and times
reading all its events and writing them from memory. The programs alternate within each repeat, so
that load on the machine affects all alike; the median counts. Processor time (of all threads) is
shown as well: it depends less on the load than wall time does, especially for programs with several
threads. Times are taken inside each process, without its start. Prints a table and the ratios.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import time
import venv

ROOT = pathlib.Path(__file__).resolve().parent.parent
COMPRESSIONS = ["none", "lz4", "zstd"]
PACKAGES = ["dv-processing==2.0.4", "faery==0.7.1", "numpy"]


def now():
    return time.perf_counter(), time.process_time()


def report(start, n_events):
    seconds, cpu = (end - begin for begin, end in zip(start, now()))
    print(json.dumps({"seconds": seconds, "cpu_seconds": cpu, "events": n_events}))


def load(path):
    """The whole file as an event store in the memory of dv-processing."""
    import dv_processing as dv

    recording, store = dv.io.MonoCameraRecording(path), dv.EventStore()
    while (batch := recording.getNextEventBatch()) is not None:
        store.add(batch)
    return store


def dv_decode(path):
    import dv_processing as dv

    start, n_events = now(), 0
    recording = dv.io.MonoCameraRecording(path)
    while (batch := recording.getNextEventBatch()) is not None:
        n_events += len(batch)
    report(start, n_events)


def dv_encode(path, compression, out):
    import dv_processing as dv

    store = load(path)
    start = now()
    kind = getattr(dv.CompressionType, compression.upper())
    config = dv.io.MonoCameraWriter.EventOnlyConfig("bench", (346, 260), kind)
    writer = dv.io.MonoCameraWriter(out, config)
    writer.writeEvents(store)
    del writer  # Its destructor writes what is pending and closes the file.
    report(start, len(store))


def faery_decode(path):
    import faery

    start, n_events = now(), 0
    for events in faery.events_stream_from_file(path):
        n_events += len(events)
    report(start, n_events)


def faery_encode(path, compression, out):
    import faery
    import numpy as np

    store = load(path).numpy()
    events = np.zeros(len(store), dtype=faery.EVENTS_DTYPE)
    events["t"] = store["timestamp"] - store["timestamp"][0]
    events["x"], events["y"], events["on"] = store["x"], store["y"], store["polarity"]
    kind = None if compression == "none" else (compression, 1)
    start = now()
    faery.events_stream_from_array(events, (346, 260)).to_file(out, compression=kind)
    report(start, len(events))


def build(command, name):
    """Runs cargo and returns the path of the program of that name."""
    command = ["cargo", *command, "--locked", "--message-format=json"]
    lines = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    artifacts = [json.loads(line) for line in lines.splitlines() if line.startswith("{")]
    return next(a["executable"] for a in artifacts if a.get("executable") and a["target"]["name"] == name)


def environment(folder, packages):
    python = folder / "venv" / "bin" / "python"
    if not python.exists():
        venv.create(folder / "venv", with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "-q", *packages], check=True)
    return str(python)


def run(command):
    output = subprocess.run([str(part) for part in command], check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(output.stdout.splitlines()[-1])


def measure(task, programs, repeats, results):
    """Alternates the programs; rates in million events per second and ns of processor time per event."""
    for _ in range(repeats):
        for name, command in programs.items():
            outcome = run(command)
            rate = outcome["events"] / outcome["seconds"] / 1e6
            cpu_ns = outcome["cpu_seconds"] / outcome["events"] * 1e9
            results.setdefault(task, {}).setdefault(name, []).append((rate, cpu_ns))
            print(f"{task} {name}: {rate:.1f} Mev/s, {cpu_ns:.1f} cpu ns/event", file=sys.stderr)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--events", type=float, default=20e6)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--dir", type=pathlib.Path, default=ROOT / "target" / "bench-aedat4")
    arguments = parser.parse_args()
    folder, n_events = arguments.dir, int(arguments.events)
    folder.mkdir(parents=True, exist_ok=True)
    ours = build(["bench", "--bench", "aedat4", "--no-run"], "aedat4")
    python = environment(folder, PACKAGES)
    theirs = [python, __file__]
    source = folder / "source.aedat4"
    run([ours, "make", ROOT / "tests/data/davis346-street.aedat4", n_events, source])
    results, sizes, load = {}, {}, os.getloadavg()[0]
    for kind in COMPRESSIONS:
        written = {name: folder / f"{name}-{kind}.aedat4" for name in ["evrig", "dv", "faery"]}
        measure(f"encode {kind}", {
            "evrig": [ours, "encode", source, kind, written["evrig"]],
            "dv": [*theirs, "--run", "dv_encode", source, kind, written["dv"]],
            "faery": [*theirs, "--run", "faery_encode", source, kind, written["faery"]],
        }, arguments.repeats, results)
        sizes[f"encode {kind}"] = {n: os.path.getsize(p) / n_events for n, p in written.items()}
        # The file written by dv-processing, so that evrig does not read a file of its own.
        measure(f"decode {kind}", {
            "evrig": [ours, "decode", written["dv"]],
            "dv": [*theirs, "--run", "dv_decode", written["dv"]],
            "faery": [*theirs, "--run", "faery_decode", written["dv"]],
        }, arguments.repeats, results)
    medians = {
        task: {name: tuple(map(statistics.median, zip(*runs))) for name, runs in programs.items()}
        for task, programs in results.items()
    }
    loads = f"load {load:.1f} before and {os.getloadavg()[0]:.1f} after"
    print(f"{n_events} events, medians of {arguments.repeats}, {os.cpu_count()} cores, {loads}")
    show(medians, sizes, run([ours, "copy", 16 * n_events]))


def show(results, sizes, copied):
    print(f"{'':12} {'evrig':>8} {'dv':>8} {'faery':>8}  Mev/s    evrig / faster other")
    for task, rates in results.items():
        (evrig, *others), cpu = zip(*(rates[name] for name in ["evrig", "dv", "faery"]))
        line = f"{task:12}" + "".join(f" {rate:8.1f}" for rate in (evrig, *others))
        line += f"  {evrig / max(others):12.2f}    cpu ns/event " + ", ".join(f"{ns:.1f}" for ns in cpu)
        if task in sizes:
            line += "    bytes/event " + ", ".join(f"{n} {s:.2f}" for n, s in sizes[task].items())
        print(line)
    bandwidth = copied["bytes"] / copied["seconds"]
    for task in ["decode none", "encode none"]:
        share = results[task]["evrig"][0] * 1e6 * 16 / bandwidth
        print(f"{task}: {share:.0%} of memory bandwidth (memcpy on one core, {bandwidth / 1e9:.1f} GB/s)")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        globals()[sys.argv[2]](*sys.argv[3:])
    else:
        main()
