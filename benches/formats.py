"""Measures reading and writing of files by `evrig import` and `evrig export`, next to Python libraries.

    python3 benches/formats.py readers|writers [--events 10e6] [--repeats 3] [--dir DIR] [--evrig PROGRAM]

Makes a session of real events (tiles of tests/data/davis346-street.aedat4), exports it in each format
and, for `readers`, imports each file again. The other library reads the same file into memory, or
writes the same columns from memory, in the same run, after evrig; it checks nothing, and makes no
session. `evrig import` also decides units and columns, checks the events, compresses them into the
session, and computes its checksum; `evrig export` also reads the session. Programs alternate; medians.
Processor time is that of all threads; peak memory is that of the process.
"""

import argparse
import importlib
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

from aedat4 import ROOT, build, environment, now, run

PACKAGES = ["dv-processing==2.0.4", "faery==0.7.1", "h5py", "numpy", "pandas", "pyarrow"]
# Name of the format, file, and the arguments of `evrig export` beside --out.
FORMATS = {
    "AEDAT4": ("events.aedat4", []),
    "npz": ("events.npz", []),
    "npy": ("events.npy", None),
    "Parquet": ("events.parquet", []),
    "HDF5": ("events.h5", []),
    "EVT 3.0": ("events.raw", []),
    "MCAP": ("events.mcap", ["--format", "ros2"]),
    "csv": ("events.csv", []),
    "txt": ("events.txt", []),
}


def columns(npz):
    import numpy as np

    return np.load(npz)["events"]


def read_dv(path):
    import dv_processing as dv

    recording = dv.io.MonoCameraRecording(path)
    while recording.getNextEventBatch() is not None:
        pass


def read_numpy(path):
    import numpy as np

    read = np.load(path)
    return read["events"] if path.endswith(".npz") else read


def read_h5py(path):
    import h5py

    with h5py.File(path) as file:
        return [file["events"][name][:] for name in "txyp"]


def read_pyarrow(path):
    import pyarrow.parquet

    return pyarrow.parquet.read_table(path)


def read_faery(path):
    import faery

    for _ in faery.events_stream_from_file(path):
        pass


def read_pandas(path):
    import pandas as pd

    return pd.read_csv(path, sep="," if path.endswith(".csv") else " ", header=None, skiprows=1)


def write_numpy(events, path):
    import numpy as np

    (np.savez_compressed if path.endswith(".npz") else np.save)(path, events)


def write_h5py(events, path):
    import h5py

    with h5py.File(path, "w") as file:
        for name, column, kind in zip("txyp", events.T, ["u4", "u2", "u2", "u1"]):
            column = (column - (column[0] if name == "t" else 0)).astype(kind)
            file.create_dataset(f"events/{name}", data=column, chunks=(1 << 15,), shuffle=True, compression=4)


def write_pyarrow(events, path):
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    table = pa.table(dict(zip("txyp", events.T)))
    if path.endswith(".csv"):
        pyarrow.csv.write_csv(table, path)
    else:
        pyarrow.parquet.write_table(table, path, compression="zstd")


def write_faery(events, path):
    import faery
    import numpy as np

    array = np.zeros(len(events), dtype=faery.EVENTS_DTYPE)
    array["t"], array["x"], array["y"], array["on"] = events.T
    array["t"] -= array["t"][0]
    faery.events_stream_from_array(array, (346, 260)).to_file(path)


# The other library of each format.
READERS = {
    "AEDAT4": ("dv-processing", "read_dv"), "npz": ("NumPy", "read_numpy"),
    "npy": ("NumPy", "read_numpy"), "Parquet": ("pyarrow", "read_pyarrow"),
    "HDF5": ("h5py", "read_h5py"), "EVT 3.0": ("faery", "read_faery"),
    "csv": ("pandas", "read_pandas"), "txt": ("pandas", "read_pandas"),
}
WRITERS = {
    "AEDAT4": ("faery", "write_faery"), "npz": ("NumPy", "write_numpy"),
    "Parquet": ("pyarrow", "write_pyarrow"), "HDF5": ("h5py", "write_h5py"),
    "EVT 3.0": ("faery", "write_faery"), "csv": ("pyarrow", "write_pyarrow"),
}


# What each function imports, which is not part of its time.
MODULES = {"dv": "dv_processing", "pyarrow": "pyarrow.parquet", "pandas": "pandas"}


def other(function, npz, path):
    """Runs in a process of its own: times one function of this file and prints the time as JSON."""
    library = function.split("_")[1]
    importlib.import_module(MODULES.get(library, library))
    given = [path] if function.startswith("read") else [columns(npz), path]
    start = now()
    kept = globals()[function](*given)
    seconds, cpu = (end - begin for begin, end in zip(start, now()))
    print(json.dumps({"seconds": seconds, "cpu_seconds": cpu}))
    del kept


def measure(command):
    """Wall and processor time and peak memory of a process; its own times where it prints them."""
    start = time.perf_counter()
    child = subprocess.Popen([str(part) for part in command], text=True,
                             stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    output = child.stdout.read()
    _, status, usage = os.wait4(child.pid, 0)
    seconds, child.returncode = time.perf_counter() - start, os.waitstatus_to_exitcode(status)
    if child.returncode not in (0, 4):
        raise SystemExit(f"{command} ended with {child.returncode}")
    cpu = usage.ru_utime + usage.ru_stime
    if "--run" in command:
        printed = json.loads(output.splitlines()[-1])
        seconds, cpu = printed["seconds"], printed["cpu_seconds"]
    return seconds, cpu, usage.ru_maxrss / 1024


def row(name, program, measured, n_events):
    seconds, cpu, memory = (statistics.median(column) for column in zip(*measured))
    print(f"| {name} | {program} | {n_events / seconds / 1e6:.1f} | {cpu / n_events * 1e9:.1f} | {memory:.0f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=["readers", "writers"])
    parser.add_argument("--events", type=float, default=10e6)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--dir", type=pathlib.Path, default=ROOT / "target" / "bench-formats")
    parser.add_argument("--evrig", help="the program; built in release by default")
    arguments = parser.parse_args()
    folder, n_events = arguments.dir, int(arguments.events)
    folder.mkdir(parents=True, exist_ok=True)
    python = environment(folder, PACKAGES)
    evrig = arguments.evrig or build(["build", "--release", "--bin", "evrig"], "evrig")
    source, session = folder / "source.aedat4", folder / "session"
    tiles = build(["bench", "--bench", "aedat4", "--no-run"], "aedat4")
    run([tiles, "make", ROOT / "tests/data/davis346-street.aedat4", n_events, source])
    shutil.rmtree(session, ignore_errors=True)
    measure([evrig, "import", source, "--out", session])
    export = [evrig, "export", session, "--stream", "real", "--out"]
    npz = folder / "events.npz"
    measure([*export, npz])
    convert = "import numpy, sys; numpy.save(sys.argv[2], numpy.load(sys.argv[1])['events'])"
    subprocess.run([python, "-c", convert, npz, folder / "events.npy"], check=True)
    print(f"{n_events} events, medians of {arguments.repeats}\n")
    print("| format | program | Mev/s | processor ns/event | peak memory, MB |")
    print("| --- | --- | ---: | ---: | ---: |")
    for name, (file, options) in FORMATS.items():
        path = folder / file
        others = READERS if arguments.what == "readers" else WRITERS
        ours, theirs = [], []
        if options is not None and (arguments.what == "readers" or name != "npz"):
            measure([*export, path, *options])
        for _ in range(arguments.repeats):
            if arguments.what == "readers":
                shutil.rmtree(folder / "imported", ignore_errors=True)
                ours.append(measure([evrig, "import", path, "--out", folder / "imported"]))
            elif options is not None:
                ours.append(measure([*export, path, *options]))
            if name in others:
                out = path if arguments.what == "readers" else folder / f"other-{file}"
                theirs.append(measure([python, __file__, "--run", others[name][1], npz, out]))
        if ours:
            row(name, "evrig", ours, n_events)
        if theirs:
            row(name, others[name][0], theirs, n_events)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        other(*sys.argv[2:])
    else:
        main()
