"""Checks the exports that other programs' readers take, for tests/it/import_recordings.rs.

`read_more_exports.py FOLDER`: `events.npz` holds the events; `a.raw` is read with faery, `v2e.h5` with
h5py, `a.zip` as rpg_e2vid does (pandas), `ros2.mcap` with mcap and rosbags, whose words faery decodes,
and `a.gif` with Pillow. Exit code 0 means equal; a difference is printed and gives 1.
"""

import sys
import tempfile
import zipfile
from pathlib import Path

import faery
import h5py
import numpy as np
import pandas as pd
from mcap.reader import make_reader
from PIL import Image
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def of_faery(path):
    packets = [np.array(packet) for packet in faery.events_stream_from_file(path)]
    events = np.concatenate(packets)
    polarity = events["on" if "on" in events.dtype.names else "p"]
    return np.stack([events[k].astype(np.int64) for k in "txy"] + [polarity.astype(np.int64)], 1)


def of_zip(path):
    with zipfile.ZipFile(path) as archive:
        (name,) = archive.namelist()
        with archive.open(name) as text:
            width, height = text.readline().split()
            table = pd.read_csv(text, sep=r"\s+", header=None, names=list("txyp"))
    table["t"] = np.round(table["t"] * 1e6)
    return table.to_numpy().astype(np.int64), (int(width), int(height))


def of_messages(path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    words, first = b"", None
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert (schema.name, channel.message_encoding) == (
                "event_camera_msgs/msg/EventPacket", "cdr")
            if first is None:
                definition = schema.data.decode().split("=" * 80)[0]
                store.register(get_types_from_msg(definition, schema.name))
            packet = store.deserialize_cdr(message.data, schema.name)
            assert packet.encoding == "evt3" and not packet.is_bigendian
            stamp = packet.header.stamp.sec * 10**9 + packet.header.stamp.nanosec
            assert message.log_time == stamp
            first = stamp // 1000 if first is None else first
            words += bytes(packet.events)
            size = packet.width, packet.height
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "words.raw"
        header = f"% evt 3.0\n% format EVT3;height={size[1]};width={size[0]}\n% end\n"
        raw.write_bytes(header.encode() + words)
        events = of_faery(raw)
    events[:, 0] += first - events[0, 0]
    return events, size


def main():
    folder = Path(sys.argv[1])
    events = np.load(folder / "events.npz")["events"]
    zipped, zip_size = of_zip(folder / "a.zip")
    messages, size = of_messages(folder / "ros2.mcap")
    with h5py.File(folder / "v2e.h5") as file:
        v2e = file["events"][:]
    with Image.open(folder / "a.gif") as image:
        gif_size = image.size
    assert v2e.dtype == np.uint32
    assert zip_size == size == gif_size, (zip_size, size, gif_size)
    of_raw = of_faery(folder / "a.raw")
    for name, found in [("a.raw", of_raw), ("v2e.h5", v2e.astype(np.int64)), ("a.zip", zipped),
                        ("ros2.mcap", messages)]:
        if not np.array_equal(found, events):
            print(f"{name}: {found[:3]} ... of {len(found)}, expected {events[:3]} of {len(events)}")
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
