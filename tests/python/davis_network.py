"""A stream over TCP between evrig and dv-processing. Run by tests/devices/davis_dv.rs.

`serve PORT KIND COMPRESSION N` serves N packets with dv-processing's NetworkWriter once a client
has connected: events (1000 per packet, event i of packet k at t = 1000000 + 1000 k + i, x = i % 346,
y = k % 260, ON where i is even) or frames (k at t = 1000000 + 1000 k, every pixel k % 256).
`read PORT KIND N` reads with NetworkReader until N events or frames have arrived and prints, as JSON,
their number, first and last time, and a sum over x, y, polarity or pixels.
"""

import json
import os
import sys
import time

import dv_processing as dv
import numpy as np

RESOLUTION = (346, 260)


def serve(port, kind, compression, n):
    compression = getattr(dv.CompressionType, compression.upper())
    add = {"events": dv.io.Stream.EventStream, "frames": dv.io.Stream.FrameStream}[kind]
    stream = add(0, kind, "DAVIS346_00000042", RESOLUTION)
    stream.setCompression(compression)
    writer = dv.io.NetworkWriter("127.0.0.1", port, stream)
    print("listening", flush=True)
    deadline = time.monotonic() + 30
    while writer.getClientCount() == 0:
        if time.monotonic() > deadline:
            return 1
        time.sleep(0.005)
    for k in range(n):
        if kind == "events":
            store = dv.EventStore()
            for i in range(1000):
                store.push_back(1_000_000 + 1000 * k + i, i % 346, k % 260, i % 2 == 0)
            writer.writeEvents(store)
        else:
            image = np.full((260, 346), k % 256, dtype=np.uint8)
            writer.writeFrame(dv.Frame(1_000_000 + 1000 * k, image))
    print("written", flush=True)
    # The reading process signals when it has everything.
    sys.stdin.readline()
    # The writer's destructor can wait forever for a client that has disconnected.
    sys.stdout.flush()
    os._exit(0)


def read(port, kind, n):
    reader = dv.io.NetworkReader("127.0.0.1", port)
    deadline = time.monotonic() + 30
    count, total, first, last = 0, 0, None, None
    print("connected", flush=True)
    while count < n and time.monotonic() < deadline:
        if kind == "events":
            batch = reader.getNextEventBatch()
            if batch is None:
                continue
            times = batch.timestamps()
            begin, end, length = int(times[0]), int(times[-1]), len(batch)
            total += int(batch.coordinates().astype(np.int64).sum()) + int(batch.polarities().sum())
        else:
            frame = reader.getNextFrame()
            if frame is None:
                continue
            begin = end = frame.timestamp
            length = 1
            total += int(frame.image.astype(np.int64).sum())
        first = begin if first is None else first
        last = end
        count += length
    size = reader.getEventResolution() if kind == "events" else reader.getFrameResolution()
    print(json.dumps({"count": count, "first": first, "last": last, "sum": total,
                      "size": list(size), "camera": reader.getCameraName()}), flush=True)
    return 0


def main():
    verb, port, kind, *rest = sys.argv[1:]
    if verb == "serve":
        return serve(int(port), kind, rest[0], int(rest[1]))
    return read(int(port), kind, int(rest[0]))


if __name__ == "__main__":
    sys.exit(main())
