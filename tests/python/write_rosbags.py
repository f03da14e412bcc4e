"""Writes recordings of ROS 1 and ROS 2 with the library rosbags, for tests/it/import_recordings.rs.

`write_rosbags.py KIND OUT`: KIND is ros1 (a bag), mcap or sqlite3 (a folder of ROS 2). The recording
holds, planted as tests/it/import_recordings.rs computes it,

- `/dvs/events`: dvs_msgs/EventArray, 40 messages of 50 events: event i at 1000 s + 37 i us,
  x = 7 i % 240, y = 3 i % 180, ON where i % 3 == 0;
- `/dvs/image_raw`: sensor_msgs/Image, mono8 of 240 x 180, frame k at 1000 s + 20 ms k, all pixels k;
- `/dvs/imu`: sensor_msgs/Imu, sample k at 1000 s + 10 ms k, k m/s^2 along z;
- `/tf`: std_msgs/String, which is left out;
- for ROS 2 also `/other/events`: event_camera_msgs/EventPacket of the encoding mono, event i at
  1000 s + 1 ms + i us, x = i, y = 2 i, ON where i % 2 == 0.
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

BASE_NS = 1000 * 1_000_000_000

EVENT = "uint16 x\nuint16 y\nTIME ts\nbool polarity\n"
ARRAY = "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n"
PACKET = (
    "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\n"
    "string encoding\nbool is_bigendian\nuint8[] events\n"
)


def messages(store, is_ros1):
    time = "time" if is_ros1 else "builtin_interfaces/Time"
    for text, name in [
        (EVENT.replace("TIME", time), "dvs_msgs/msg/Event"),
        (ARRAY, "dvs_msgs/msg/EventArray"),
        (PACKET, "event_camera_msgs/msg/EventPacket"),
    ]:
        store.register(get_types_from_msg(text, name))
    types = store.types

    def stamp(ns):
        return types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)

    def header(ns):
        fields = {"seq": 0} if is_ros1 else {}
        return types["std_msgs/msg/Header"](**fields, stamp=stamp(ns), frame_id="cam")

    event = types["dvs_msgs/msg/Event"]
    for k in range(40):
        events = [
            event(x=7 * i % 240, y=3 * i % 180, ts=stamp(BASE_NS + 37_000 * i), polarity=i % 3 == 0)
            for i in range(50 * k, 50 * k + 50)
        ]
        ns = BASE_NS + 37_000 * 50 * k
        yield ns, "/dvs/events", types["dvs_msgs/msg/EventArray"](
            header=header(ns), height=180, width=240, events=events)
    for k in range(4):
        ns = BASE_NS + 20_000_000 * k
        yield ns, "/dvs/image_raw", types["sensor_msgs/msg/Image"](
            header=header(ns), height=180, width=240, encoding="mono8", is_bigendian=0, step=240,
            data=np.full(240 * 180, k, np.uint8))
    vector = types["geometry_msgs/msg/Vector3"]
    for k in range(8):
        ns = BASE_NS + 10_000_000 * k
        yield ns, "/dvs/imu", types["sensor_msgs/msg/Imu"](
            header=header(ns),
            orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9), angular_velocity=vector(x=0.0, y=0.0, z=0.0),
            angular_velocity_covariance=np.zeros(9), linear_acceleration=vector(x=0.0, y=0.0, z=float(k)),
            linear_acceleration_covariance=np.zeros(9))
    yield BASE_NS, "/tf", types["std_msgs/msg/String"](data="nothing")
    if not is_ros1:
        i = np.arange(100, dtype=np.uint64)
        words = ((i + np.uint64(1) & np.uint64(1)) << np.uint64(63)) | (2 * i << np.uint64(48)) \
            | (i << np.uint64(32)) | (1000 * i)
        ns = BASE_NS + 1_000_000
        yield ns, "/other/events", types["event_camera_msgs/msg/EventPacket"](
            header=header(ns), height=480, width=640, seq=0, time_base=123, encoding="mono",
            is_bigendian=False, events=words.astype("<u8").view(np.uint8))


def main():
    kind, out = sys.argv[1], Path(sys.argv[2])
    if kind == "ros1":
        from rosbags.rosbag1 import Writer

        store = get_typestore(Stores.ROS1_NOETIC)
        writer, serialize = Writer(out), store.serialize_ros1
        writer.set_compression(Writer.CompressionFormat.LZ4)
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer

        store = get_typestore(Stores.ROS2_HUMBLE)
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer, serialize = Writer(out, version=9, storage_plugin=plugin), store.serialize_cdr
    connections = {}
    with writer:
        for ns, topic, message in sorted(messages(store, kind == "ros1"), key=lambda m: m[0]):
            kind_of = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind_of, typestore=store)
            writer.write(connections[topic], ns, serialize(message, kind_of))


if __name__ == "__main__":
    main()
