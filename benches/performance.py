"""Writes docs/reference/performance.md: runs the benchmarks and puts their output between its markers.

    python3 benches/performance.py [SECTION ...] [--dir DIR] [--disk-seconds 120] [--sink-seconds 1800]

Sections: aedat4, readers, writers, generate, filter, disk, sink; without an argument all of them. The
output of a section goes between `<!-- measured: NAME -->` and `<!-- end -->`, with the machine, its load
and the command. The text around the markers is written by hand and kept. The first table of the page has
one ratio per line, parsed from the output; lines of sections that are not run are kept. DIR (default: the
system's temporary directory) is where `disk` records: 35 GB in two minutes with LZ4, and as much for the
plain copy. If a benchmark fails, its section is kept and the exit code is 1.
"""

import argparse
import datetime
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "reference" / "performance.md"


def commands(arguments):
    bench = ["cargo", "bench", "--locked", "--bench"]
    return {
        "aedat4": [sys.executable, "benches/aedat4.py", "--events", "20e6", "--repeats", "5"],
        "readers": [sys.executable, "benches/formats.py", "readers", "--events", "20e6"],
        "writers": [sys.executable, "benches/formats.py", "writers", "--events", "20e6"],
        "generate": [*bench, "generate", "--", "--table"],
        "filter": [*bench, "filter"],
        "disk": [*bench, "record", "--", "disk", str(arguments.disk_seconds), arguments.dir,
                 "--compression=lz4"],
        "sink": [*bench, "record", "--", "sink", str(arguments.sink_seconds)],
    }


# Ratios in the output of each section: name of the line, pattern whose first group is the number,
# reference or unit, and aim if there is one.
RATIOS = {
    "aedat4": [
        (f"AEDAT4, {task}", rf"^{task}(?: +[\d.]+){{3}} +([\d.]+)",
         "rate relative to the faster of dv-processing and faery", aim)
        for task, aim in [("encode none", ""), ("decode none", ""), ("encode lz4", "3"),
                          ("decode lz4", "1.5"), ("encode zstd", ""), ("decode zstd", "")]
    ] + [
        (f"AEDAT4, {task}", rf"^{task}: (\d+%)", "share of one core's memcpy", "")
        for task in ["decode none", "encode none"]
    ],
    "readers": [
        (f"import of {name}", rf"^\| {name} \| evrig \| ([\d.]+) \|", "Mev/s, session written", aim)
        for name, aim in [("AEDAT4", "50"), ("npz", ""), ("npy", "50"), ("Parquet", "50"), ("HDF5", "50"),
                          ("EVT 3.0", "50"), ("MCAP", "50"), ("csv", "10"), ("txt", "10")]
    ],
    "writers": [
        (f"export to {name}", rf"^\| {name} \| evrig \| ([\d.]+) \|", "Mev/s, session read", "")
        for name in ["AEDAT4", "Parquet", "HDF5", "EVT 3.0", "MCAP", "csv", "txt"]
    ],
    "generate": [
        (f"generator {model}, 346 x 260, one thread",
         rf"^\| {model} \| 346 x 260 \| 1 \|.*\| ([\d.]+) \|$",
         "processor time relative to one pass through memory", "")
        for model in ["voltmeter", "esim", "v2e-clean", "eventcv-core, clean", "v2e-noisy",
                      "eventcv-core, noisy"]
    ],
    "filter": [
        (f"filter, {name}", rf"^\| {name} \| \d+ \| ([\d.]+) \|$", "time relative to a copy of the columns", "")
        for name in ["region", "region, cropped to 88 px", "region through a lens", "region, all events in it"]
    ],
    "disk": [
        ("recording to disk", r"recording / copy = ([\d.]+)",
         "time relative to a plain copy of the same bytes", ""),
        ("recording to disk, dropped", r"^davis +\d+ samples, (\d+) dropped", "event packets", "0"),
        ("recording to disk, dropped", r"^pi +\d+ samples, (\d+) dropped", "frames", "0"),
        ("recorder to disk", r"^recorder +([\d.]+) cores", "cores", ""),
    ],
    "sink": [
        ("recording into the sink, dropped", r"(\d+) samples dropped", "samples", "0"),
        ("recorder into the sink", r"^recorder +([\d.]+) cores", "cores", ""),
    ],
}


def machine():
    model = platform.processor() or platform.machine()
    info = pathlib.Path("/proc/cpuinfo")
    if info.exists() and (found := re.search(r"model name\s*: (.*)", info.read_text())):
        model = found[1]
    rustc = subprocess.run(["rustc", "--version"], check=True, stdout=subprocess.PIPE, text=True)
    return f"{model}, {os.cpu_count()} cores, {' '.join(rustc.stdout.split()[:2])}"


def measure(command):
    """Returns the standard output of a benchmark and the load of the machine before and after it."""
    before = os.getloadavg()[0]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        return None, None
    return done.stdout.strip(), f"load {before:.1f} before and {os.getloadavg()[0]:.1f} after"


def block(name, command, output, load):
    """Formats a section: tables as Markdown, everything else as preformatted text."""
    shown = " ".join([pathlib.Path(command[0]).name, *command[1:]])
    heading = f"`{shown}`\n\n{datetime.date.today():%-d %B %Y}, {machine()}, {load}:\n\n"
    parts, kind = [], None
    for line in output.splitlines():
        is_table = line.startswith("|")
        if is_table != kind:
            if kind is False:
                parts.append("```")
            parts.append("" if is_table else "\n```text" if parts else "```text")
            kind = is_table
        parts.append(line)
    if kind is False:
        parts.append("```")
    return f"<!-- measured: {name} -->\n{heading}{chr(10).join(parts).strip()}\n<!-- end -->"


def put(page, name, text):
    marked = re.compile(rf"<!-- measured: {name} -->.*?<!-- end -->", re.S)
    if not marked.search(page):
        raise SystemExit(f"{PAGE} has no markers for {name}: expected <!-- measured: {name} -->")
    return marked.sub(lambda _: text, page, count=1)


def ratios(page, outputs):
    """Returns the first table with the lines of these sections replaced."""
    marked = re.search(r"<!-- measured: ratios -->(.*?)<!-- end -->", page, re.S)
    known = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]*) \|$", marked[1] if marked else "", re.M)
    lines = {(name, against): (value, aim.strip()) for name, value, against, aim in known[1:]}
    lines.pop(("---", "---"), None)
    for section, output in outputs.items():
        for name, pattern, against, aim in RATIOS[section]:
            found = re.search(pattern, output, re.M)
            lines[(name, against)] = (found[1] if found else "not printed", aim)
    order = [(name, against) for rows in RATIOS.values() for name, _, against, _ in rows]
    rows = ["| what | measured | reference or unit | aim |", "| --- | ---: | --- | ---: |"]
    for key in order:
        if key in lines:
            (name, against), (value, aim) = key, lines[key]
            rows.append(f"| {name} | {value} | {against} | {aim} |")
    return "<!-- measured: ratios -->\n" + "\n".join(rows) + "\n<!-- end -->"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(RATIOS))
    parser.add_argument("--dir", default=tempfile.gettempdir())
    parser.add_argument("--disk-seconds", type=int, default=120)
    parser.add_argument("--sink-seconds", type=int, default=1800)
    arguments = parser.parse_args()
    if unknown := set(arguments.sections) - set(RATIOS):
        parser.error(f"no such section: {', '.join(sorted(unknown))}; choose from {', '.join(RATIOS)}")
    outputs, failed = {}, []
    for name, command in commands(arguments).items():
        if arguments.sections and name not in arguments.sections:
            continue
        print(f"== {name}: {' '.join(command)}", file=sys.stderr)
        output, load = measure(command)
        if output is None:
            failed.append(name)
            continue
        outputs[name] = output
        # Read the page again each time: it may have been edited during a long run.
        page = put(PAGE.read_text(), name, block(name, command, output, load))
        PAGE.write_text(put(page, "ratios", ratios(page, outputs)))
    if failed:
        raise SystemExit(f"failed, sections kept: {', '.join(failed)}")


if __name__ == "__main__":
    main()
