"""A substitute for picamera2 on machines without a camera of the Pi. Names and behaviour follow the
documentation of the library and the pitfalls its users report; frames are patterns that encode
column, row and frame number, in coordinates of the whole sensor mode.

Intended pitfalls: it prints on standard output; rows are padded and buffers are longer than their
rows; a packed raw format becomes a lossy one on a Pi 5, where unpacked samples are left-justified;
controls take effect three frames late; a request that is not released blocks the camera; autofocus
first reports old states; FrameWallClock is in microseconds.

STANDIN_BOARD is pi4 or pi5, STANDIN_SWAP=1 lets the ISP change BGR888 to RGB888, STANDIN_SKIP=N
leaves out every N-th frame, STANDIN_DIE=N ends the process at frame N, STANDIN_BLIND=1 never focuses.
"""

import os
import threading
import time

import numpy as np

__version__ = "0.0-standin"
print("stand-in for picamera2: a library that prints where it should not")

FULL = (4608, 2592)
LINE_US = 9.21
BOARD = os.environ.get("STANDIN_BOARD", "pi5")


def option(name):
    return int(os.environ.get(f"STANDIN_{name}", "0"))


def grid(width, height):
    return np.arange(width)[None, :], np.arange(height)[:, None]


class MappedArray:
    def __init__(self, request, stream, reshape=True, write=True):
        self.request, self.stream, self.reshape = request, stream, reshape

    def __enter__(self):
        assert self.request.ref_count > 0, "a request that was released"
        assert not self.reshape, "padding makes reshaping fail for some sizes"
        self.array = self.request.buffer(self.stream)
        return self

    def __exit__(self, *_):
        self.array = None


class Request:
    def __init__(self, camera, k, stamp, controls):
        self.camera, self.k, self.stamp, self.controls = camera, k, stamp, controls
        self.ref_count, self.lock = 1, threading.Lock()

    def acquire(self):
        with self.lock:
            assert self.ref_count > 0
            self.ref_count += 1

    def release(self):
        with self.lock:
            self.ref_count -= 1
            assert self.ref_count >= 0
            if self.ref_count == 0:
                self.camera.free.release()

    def get_metadata(self):
        lines = int(self.controls["ExposureTime"] / LINE_US)
        return {
            "SensorTimestamp": self.stamp // 1000 * 1000,
            "FrameWallClock": time.time_ns() // 1000,
            "ExposureTime": int(lines * LINE_US),
            "AnalogueGain": float(np.float32(self.controls["AnalogueGain"])),
            "DigitalGain": 1.0,
            "ColourGains": self.controls.get("ColourGains", (2.1, 1.7)),
            "FrameDuration": self.controls["FrameDurationLimits"][0],
            "LensPosition": self.controls.get("LensPosition", 4.4),
            "AfState": self.camera.af_state(self.k),
            "SensorBlackLevels": (4096, 4096, 4096, 4096),
            "ScalerCrop": self.controls["ScalerCrop"],
        }

    def buffer(self, stream):
        config = self.camera.config[stream]
        (width, height), stride = config["size"], config["stride"]
        rows = np.full((height, stride), 0xAB, np.uint8)
        if stream == "raw":
            column, row = grid(width, height)
            samples = ((column + 7 * row + 13 * self.k) % 1024).astype("<u2")
            if config["format"].endswith("16"):
                samples = samples << 6
            rows[:, : 2 * width] = samples.view(np.uint8)
        else:
            left, top, crop_width, crop_height = self.controls["ScalerCrop"]
            column, row = grid(width, height)
            x = (left - 768) // 2 + column * (crop_width // 2) // width
            y = (top - 432) // 2 + row * (crop_height // 2) // height
            planes = np.broadcast_arrays(np.full_like(x + y, self.k) % 256, x % 256, y % 256)
            if config["format"] == "RGB888":
                planes = planes[::-1]
            rows[:, : 3 * width] = np.stack(planes, axis=2).reshape(height, 3 * width)
        return np.concatenate([rows.reshape(-1), np.zeros(4096, np.uint8)])


class Picamera2:
    @staticmethod
    def global_camera_info():
        return [] if option("ABSENT") else [{"Model": "imx708", "Num": 0}]

    def __init__(self):
        self.camera_properties = {"Model": "imx708"}
        self.camera_controls = {"AfMode": (0, 2, 0), "ExposureTime": (1, 10**6, 100)}
        self.started, self.config, self.post_callback = False, None, None
        self.pending, self.k, self.trigger_at = [], 0, None

    @property
    def sensor_modes(self):
        def mode(width, height, fps, crop):
            return {
                "size": (width, height), "bit_depth": 10, "fps": fps, "crop_limits": crop,
                "format": "SRGGB10_CSI2P", "unpacked": "SRGGB10",
            }
        return [
            mode(1536, 864, 120.13, (768, 432, 3072, 1728)),
            mode(2304, 1296, 56.03, (0, 0, 4608, 2592)),
            mode(4608, 2592, 14.35, (0, 0, 4608, 2592)),
        ]

    def create_video_configuration(self, main, raw, sensor, buffer_count, display, encode, controls):
        return {
            "main": dict(main), "raw": dict(raw), "sensor": dict(sensor),
            "buffer_count": buffer_count, "controls": dict(controls),
        }

    def configure(self, config):
        assert not self.started, "configured while it runs"
        main, raw = config["main"], config["raw"]
        if option("SWAP"):
            main["format"] = "RGB888"
        main["stride"] = (3 * main["size"][0] + 63) // 64 * 64
        packed = raw["format"].endswith("_CSI2P")
        if BOARD == "pi5":
            raw["format"] = "RGGB_PISP_COMP1" if packed else "SRGGB16"
        raw["stride"] = 2 * raw["size"][0] + 64
        self.config = config

    def camera_configuration(self):
        return self.config

    def start(self):
        self.started = True
        self.free = threading.Semaphore(self.config["buffer_count"])
        self.controls = {"ExposureTime": 20000, "AnalogueGain": 1.0}
        self.pending = [(self.k + 3, self.config["controls"])]
        self.controls |= {key: self.config["controls"][key] for key in ("ScalerCrop", "FrameDurationLimits")}
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def stop(self):
        self.started = False
        self.thread.join()

    def set_controls(self, controls):
        self.pending.append((self.k + 3, dict(controls)))

    def af_state(self, k):
        if self.trigger_at is None or k < self.trigger_at:
            return 2
        return 1 if k < self.trigger_at + 30 else 3 if option("BLIND") else 2

    def run(self):
        stamp = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        while self.started:
            for at, controls in [entry for entry in self.pending if entry[0] <= self.k]:
                self.pending.remove((at, controls))
                self.controls = {**self.controls, **controls}
                if controls.get("AfTrigger") == 0:
                    self.trigger_at = self.k
            if option("DIE") and self.k >= option("DIE"):
                os.write(2, b"the stand-in ends as configured\n")
                os._exit(9)
            time.sleep(0.002)
            stamp += self.controls["FrameDurationLimits"][0] * 1000
            self.k += 1
            if option("SKIP") and self.k % option("SKIP") == 0:
                continue
            # A camera without free buffers loses frames; this one waits, so that tests can count.
            if not self.free.acquire(timeout=10):
                os.write(2, b"requests were not released\n")
                os._exit(8)
            request = Request(self, self.k, stamp, dict(self.controls))
            if self.post_callback:
                self.post_callback(request)
            request.release()
