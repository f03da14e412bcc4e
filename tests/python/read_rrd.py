"""Reads an exported rrd with the package of Rerun and compares it with the npz of the same stream.

usage: read_rrd.py FOLDER   with real.rrd, real.npz and their FILE.json
"""

import json
import sys
from pathlib import Path

import numpy as np
import rerun.dataframe

folder = Path(sys.argv[1])
WINDOW_US = 20_000

recording = rerun.dataframe.load_recording(folder / "real.rrd")
assert recording.application_id() == "evrig", recording.application_id()


def column(entity, name):
    """Times (us) and values of a component of an entity, on the clock of the events."""
    view = recording.view(index="events", contents=entity)
    table = view.select().read_all()
    found = [c for c in table.column_names if c.startswith(f"{entity}:") and c.endswith(f":{name}")]
    assert len(found) == 1, (entity, name, table.column_names)
    rows = zip(table["events"].to_pylist(), table[found[0]].to_pylist())
    known = [(np.datetime64(t, "ns").astype(np.int64) // 1000, v) for t, v in rows if v is not None]
    return [t for t, _ in known], [v for _, v in known]


t = np.load(folder / "real.npz")["events"][:, 0]
p = np.load(folder / "real.npz")["events"][:, 3]
for side, sign in (("on", 1), ("off", 0)):
    times, rates = column(f"/rate/real/{side}", "scalars")
    ends = (t[p == sign] // WINDOW_US + 1) * WINDOW_US
    wanted = {int(end): int(n) for end, n in zip(*np.unique(ends, return_counts=True))}
    found = {int(at): round(rate[0] * WINDOW_US * 1e-6) for at, rate in zip(times, rates) if rate[0] > 0}
    assert found == wanted, side
times, pictures = column("/events/real", "buffer")
assert times == sorted(times) and len(times) == len(np.unique(t // WINDOW_US))
about = json.loads((folder / "real.rrd.json").read_text())
for picture in pictures:
    (data,) = picture
    assert len(data) == about["width"] * about["height"] and set(data) <= {0, 128, 255}
(aps,) = [image for image in about["images"] if image["stream"] == "aps"]
times, _ = column("/frames/aps", "buffer")
assert times == aps["columns"]["t_us"]
times, strips = column("/frames/aps/picture", "strips")
corners = dict(zip(aps["columns"]["t_us"], aps["columns"]["picture_px"]))
assert len(times) > 5
for at, strip in zip(times, strips):
    (line,) = strip
    wanted = np.array(corners[int(at)]).reshape(4, 2)
    assert np.allclose(line[:4], wanted, atol=1e-3) and line[4] == line[0], at
print(f"{len(pictures)} pictures, {len(times)} outlines: as in the npz")
