"""Reads exported events with common libraries and compares the results.

usage: read_exports.py FOLDER   with real.npz, real.h5, real.parquet, real.aedat4, real.mcap
"""

import json
import sys
from pathlib import Path

import numpy as np

folder = Path(sys.argv[1])


def npz():
    t_us, x, y, p = np.load(folder / "real.npz")["events"].T
    return t_us, x, y, p


def hdf5():
    import h5py

    with h5py.File(folder / "real.h5") as f:
        t = f["events/t"][:].astype(np.int64) + f["t_offset"][()]
        x, y, p = (f["events"][name][:] for name in "xyp")
        assert f["events/t"].dtype == np.uint32 and x.dtype == y.dtype == np.uint16 and p.dtype == np.uint8
        assert f["events/t"].compression == "gzip"
        # As in DSEC: t[ms_to_idx[ms]] >= ms * 1000, and the previous event is earlier.
        index = f["ms_to_idx"][:]
        raw = f["events/t"][:].astype(np.int64)
        assert index.dtype == np.uint64 and index[0] == 0 and index[-1] == len(raw)
        for ms in range(0, len(index) - 1, 7):
            i = int(index[ms])
            assert raw[i] >= ms * 1000 and (i == 0 or raw[i - 1] < ms * 1000), ms
        # Image times divide the events: those of an interval are between its times.
        images = f["images/aps"]
        first, times = images["first_event"][:], images["t_us"][:]
        assert len(first) == len(times) > 2 and (np.diff(times) > 0).all()
        inside = t[first[1] : first[2]]
        assert len(inside) and inside[0] >= times[1] and inside[-1] < times[2]
        assert (images["exposure_end_us"][:] > images["exposure_start_us"][:]).all()
        about = json.loads(f["evrig"][()])
        assert about["n_events"] == len(t) and about["unit"] == "us", about
    return t, x, y, p


def parquet():
    import pyarrow.parquet as pq

    table = pq.read_table(folder / "real.parquet")
    assert [str(field.type) for field in table.schema] == ["int64", "uint16", "uint16", "uint8"], table.schema
    about = json.loads(table.schema.metadata[b"evrig"])
    assert about["stream"] == "real" and about["width"] == 346
    return tuple(table[name].to_numpy() for name in "txyp")


def aedat4():
    import dv_processing as dv

    reader = dv.io.MonoCameraRecording(str(folder / "real.aedat4"))
    assert list(reader.getEventResolution()) == [346, 260]
    columns = []
    while (batch := reader.getNextEventBatch()) is not None:
        columns.append(batch.numpy())
    events = np.concatenate(columns)
    return events["timestamp"], events["x"], events["y"], events["polarity"]


def structured():
    """Events as in tonic: one array with named fields."""
    t, x, y, p = npz()
    events = np.empty(len(t), dtype=[("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "<i1")])
    events["t"], events["x"], events["y"], events["p"] = t, x, y, p
    return tuple(events[name] for name in "txyp")


def mcap():
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    n = {}
    rate = 0.0
    with open(folder / "real.mcap", "rb") as f:
        reader = make_reader(f, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            n[channel.topic] = n.get(channel.topic, 0) + 1
            if channel.topic == "/rate/real":
                value = json.loads(message.data)
                rate += value["on_hz"] + value["off_hz"]
        for _, channel, _, image in reader.iter_decoded_messages(topics=["/events/real"]):
            assert (image.width, image.height, image.encoding) == (346, 260, "mono8")
            assert len(image.data) == 346 * 260 and set(image.data) <= {0, 128, 255}
    assert n["/frames/aps"] > 2 and n["/events/real"] == n["/rate/real"] > 2, n
    # A rate times its 20 ms is the number of events.
    assert round(rate * 0.02) == len(npz()[0]), rate
    layout = json.loads((folder / "real.mcap.layout.json").read_text())
    topics = {c["imageMode"]["imageTopic"] for c in layout["configById"].values() if "imageMode" in c}
    assert topics == {"/events/real", "/frames/aps"} <= set(n), topics


expected = npz()
assert len(expected[0]) > 1000 and (np.diff(expected[0]) >= 0).all()
for read in (hdf5, parquet, aedat4, structured):
    for name, found, wanted in zip("txyp", read(), expected):
        assert np.array_equal(found.astype(np.int64), wanted), f"{read.__name__}: {name} differs"
mcap()
side = json.loads((folder / "real.npz.json").read_text())
assert side["schema"] == "evrig.export/1" and side["n_events"] == len(expected[0])
(aps,) = side["images"]
assert aps["stream"] == "aps" and len(aps["columns"]["first_event"]) == len(aps["columns"]["t_us"])
print(f"{len(expected[0])} events, the same from every file")
