"""Checks that dv-processing reads the files of evrig, and vice versa.

Run by tests/it/aedat4_dv.rs, which runs it when EVRIG_PYTHON names a Python with
`pip install dv-processing numpy`:

    EVRIG_PYTHON=.venv/bin/python cargo test --test it aedat4_dv

`check TRUTH FILE` reads FILE with dv-processing's MonoCameraRecording and requires the
contents of TRUTH (JSON), value by value; `write TRUTH FILE COMPRESSION` writes them with
its MonoCameraWriter. Exit code 0 means equal; a difference is printed and gives 1.
"""

import datetime
import json
import sys

import dv_processing as dv
import numpy as np

IMU_FIELDS = [
    "temperature",
    "accelerometerX", "accelerometerY", "accelerometerZ",
    "gyroscopeX", "gyroscopeY", "gyroscopeZ",
    "magnetometerX", "magnetometerY", "magnetometerZ",
]


def image_of(frame):
    shape = (frame["height"], frame["width"])
    if frame["channels"] > 1:
        shape += (frame["channels"],)
    dtype = {8: np.uint8, 16: np.uint16}[frame["bits"]]
    return np.array(frame["samples"], dtype=dtype).reshape(shape)


def all_of(next_batch):
    batch = next_batch()
    while batch is not None:
        yield from (batch if hasattr(batch, "__iter__") else [batch])
        batch = next_batch()


def microseconds(span):
    return span // datetime.timedelta(microseconds=1)


def read(path):
    recording = dv.io.MonoCameraRecording(path)
    events = [
        [event.timestamp(), event.x(), event.y(), int(event.polarity())]
        for event in all_of(recording.getNextEventBatch)
    ]
    frames = []
    for frame in all_of(recording.getNextFrame):
        image = frame.image
        frames.append({
            "t": frame.timestamp,
            "exposure_us": microseconds(frame.exposure),
            "origin": [frame.positionX, frame.positionY],
            "height": image.shape[0],
            "width": image.shape[1],
            "channels": image.shape[2] if image.ndim == 3 else 1,
            "bits": image.dtype.itemsize * 8,
            "samples": image.ravel().tolist(),
        })
    imu = [
        [sample.timestamp] + [getattr(sample, field) for field in IMU_FIELDS]
        for sample in all_of(recording.getNextImuBatch)
    ]
    triggers = [
        [trigger.timestamp, int(trigger.type)]
        for trigger in all_of(recording.getNextTriggerBatch)
    ]
    size = recording.getEventResolution()
    return {
        "camera": recording.getCameraName(),
        "width": size[0], "height": size[1],
        "events": events, "frames": frames, "imu": imu, "triggers": triggers,
    }


def check(truth, path):
    found = read(path)
    for key, expected in truth.items():
        if found[key] != expected:
            length = lambda value: len(value) if hasattr(value, "__len__") else value
            print(f"{key}: expected {length(expected)}, found {length(found[key])}")
            if isinstance(expected, list):
                pairs = zip(expected, found[key])
                print(next((pair for pair in pairs if pair[0] != pair[1]), "lengths differ"))
            return 1
    # Seeking needs the data table; half of the time range must give a part of the events.
    times = [event[0] for event in truth["events"]]
    middle = times[len(times) // 2]
    part = dv.io.MonoCameraRecording(path).getEventsTimeRange(times[0], middle)
    expected = sum(t < middle for t in times)
    if part is None or len(part) != expected:
        print(f"up to {middle}: expected {expected} events, found {part and len(part)}")
        return 1
    return 0


def write(truth, path, compression):
    config = dv.io.MonoCameraWriter.Config(truth["camera"])
    config.compression = getattr(dv.CompressionType, compression.upper())
    size = (truth["width"], truth["height"])
    config.addEventStream(size)
    config.addFrameStream(size)
    config.addImuStream()
    config.addTriggerStream()
    writer = dv.io.MonoCameraWriter(path, config)
    store = dv.EventStore()
    for t, x, y, on in truth["events"]:
        store.push_back(t, x, y, bool(on))
    writer.writeEvents(store)
    for frame in truth["frames"]:
        exposure = frame["exposure_us"]
        x, y = frame["origin"]
        source = dv.FrameSource.SENSOR
        writer.writeFrame(dv.Frame(frame["t"], exposure, x, y, image_of(frame), source))
    for sample in truth["imu"]:
        writer.writeImu(dv.IMU(*sample))
    for t, code in truth["triggers"]:
        writer.writeTrigger(dv.Trigger(t, dv.TriggerType(code)))
    return 0


def main():
    verb, truth, path, *rest = sys.argv[1:]
    with open(truth) as file:
        truth = json.load(file)
    return check(truth, path) if verb == "check" else write(truth, path, *rest)


if __name__ == "__main__":
    sys.exit(main())
