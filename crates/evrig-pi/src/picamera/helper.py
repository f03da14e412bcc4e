"""Hands the frames of the Pi's camera to evrig over a pipe. Started by `evrig pi`.

Commands come as JSON lines on standard input. What goes out on the first standard output is, each
time, two little-endian 32-bit lengths, a JSON head and the pictures' bytes. Libraries print where
they like, so file descriptor 1 itself is turned to standard error before any is loaded.
"""

import json
import os
import queue
import struct
import sys
import threading
import time

OUT = os.fdopen(os.dup(1), "wb", buffering=0)
os.dup2(2, 1)
OUT_LOCK = threading.Lock()

# More buffers than frames that may wait, so that the camera never runs dry of them.
N_BUFFERS = 12
N_WAITING = 8
SETTLING_S = 5.0
FOCUS_S = 8.0


class Refused(Exception):
    """What cannot be done, in words for the operator."""


def send(head, *pictures):
    text = json.dumps(head, default=str).encode()
    with OUT_LOCK:
        for part in (struct.pack("<II", len(text), sum(map(len, pictures))), text, *pictures):
            view = memoryview(part)
            while view:
                view = view[OUT.write(view):]


class Camera:
    def __init__(self):
        try:
            import picamera2
        except ImportError as error:
            raise Refused(f"{error}; install it with `sudo apt install python3-picamera2`")
        self.library = picamera2
        self.device = None
        self.held = None
        self.is_streaming = False
        self.n_lost = 0
        self.waiting = queue.Queue(N_WAITING)
        self.latest = None
        self.came = threading.Condition()
        threading.Thread(target=self.send_all, daemon=True).start()

    def identify(self):
        """Says what is connected; the camera stays free for other programs."""
        send({
            "kind": "identified",
            "model": self.model(),
            "picamera2": getattr(self.library, "__version__", None),
        })

    def model(self):
        cameras = self.library.Picamera2.global_camera_info()
        if not cameras:
            raise Refused("no camera is connected; look at its cable and `rpicam-hello --list-cameras`")
        return str(cameras[0].get("Model"))

    def configure(self, order):
        if self.device is None:
            self.model()
            self.device = self.library.Picamera2()
        if self.device.started:
            self.device.stop()
        width, height = order["width"], order["height"]
        mode = self.mode_for(order)
        mode_width, mode_height = mode["size"]
        # Even offsets keep the order of the colours; four samples are a packed group.
        x0 = (mode_width - width) // 2 & ~3
        y0 = (mode_height - height) // 2 & ~1
        left, top, limit_width, limit_height = mode["crop_limits"]
        sx, sy = limit_width / mode_width, limit_height / mode_height
        crop = (round(left + x0 * sx), round(top + y0 * sy), round(width * sx), round(height * sy))
        duration = round(1e6 / order["frame_rate_hz"])
        controls = {
            "AeEnable": False,
            "AwbEnable": True,
            "ExposureTime": round(order["exposure_us"]),
            "AnalogueGain": order["gain"],
            "FrameDurationLimits": (duration, duration),
            "ScalerCrop": crop,
        }
        config = self.device.create_video_configuration(
            # picamera2 names colours from the highest byte: BGR888 lies in memory as R, G, B.
            main={"size": (width, height), "format": "BGR888"},
            # Unpacked, since a Pi 5 answers a packed format with a compression that loses bits.
            raw={"size": mode["size"], "format": str(mode["unpacked"])},
            sensor={"output_size": mode["size"], "bit_depth": mode["bit_depth"]},
            buffer_count=N_BUFFERS,
            display=None,
            encode=None,
            controls=controls,
        )
        self.device.configure(config)
        held = self.device.camera_configuration()
        main, raw = held["main"], held["raw"]
        if tuple(main["size"]) != (width, height):
            raise Refused(f"asked for {width} x {height} RGB, the ISP gives {main['size']}; take an even size")
        if tuple(raw["size"]) != tuple(mode["size"]):
            raise Refused(f"asked for the mode {mode['size']}, the sensor gives {raw['size']}")
        self.held = {
            "size": (width, height), "offset": (x0, y0), "mode": mode["size"],
            "raw": (raw["format"], raw["stride"]), "main": (main["format"], main["stride"]),
            "wants": (order["raw"], order["rgb"]),
        }
        self.device.post_callback = self.on_frame
        self.device.start()
        focused = self.focus(order["focus"])
        metadata = self.settle(order)
        self.device.set_controls({"AwbEnable": False, "ColourGains": tuple(metadata["ColourGains"])})
        send({
            "kind": "configured",
            "raw_format": str(raw["format"]),
            "rgb_format": str(main["format"]),
            "exposure_us": metadata["ExposureTime"],
            "gain": metadata["AnalogueGain"],
            "frame_duration_us": metadata.get("FrameDuration", duration),
            "description": {
                "model": self.device.camera_properties.get("Model"),
                "mode_px": mode["size"],
                "crop_px": [x0, y0, width, height],
                "scaler_crop": {"asked": crop, "set": metadata.get("ScalerCrop")},
                "raw_format": str(raw["format"]),
                "rgb_format": str(main["format"]),
                "colour_gains": metadata["ColourGains"],
                "lens_position": metadata.get("LensPosition"),
                "focus": focused,
                "picamera2": getattr(self.library, "__version__", None),
            },
        })

    def mode_for(self, order):
        size, rate = (order["width"], order["height"]), order["frame_rate_hz"]
        modes = self.device.sensor_modes
        fits = [
            mode for mode in modes
            if mode["bit_depth"] == 10 and mode["fps"] >= rate * 0.999
            and mode["size"][0] >= size[0] and mode["size"][1] >= size[1]
        ]
        if not fits:
            known = ", ".join(f"{m['size'][0]} x {m['size'][1]} at {m['fps']:.0f}" for m in modes)
            raise Refused(f"no 10-bit mode holds {size[0]} x {size[1]} at {rate} frames a second; there are {known}")
        return min(fits, key=lambda mode: mode["size"][0] * mode["size"][1])

    def focus(self, focus):
        """Sets the lens; returns what came of it."""
        if "AfMode" not in self.device.camera_controls:
            return "the lens is fixed"
        manual, auto, continuous = 0, 1, 2
        if focus == "continuous":
            self.device.set_controls({"AfMode": continuous})
            return "continuous"
        if focus != "once":
            position = focus["dioptres"]
            self.device.set_controls({"AfMode": manual, "LensPosition": position})
            return f"set to {position} dioptres"
        self.device.set_controls({"AfMode": auto, "AfTrigger": 0})
        # 2 is focused, 3 is failed; states from before the trigger are passed over.
        began = time.monotonic()
        state, seen_scanning = None, False
        while time.monotonic() - began < FOCUS_S:
            metadata = self.next_metadata()
            state = metadata.get("AfState")
            seen_scanning = seen_scanning or state == 1
            if state == 2 and seen_scanning:
                break
            if state == 3:
                raise Refused("autofocus found nothing sharp; light the target, or set pi.focus to dioptres (1 / distance in m)")
        else:
            raise Refused(f"autofocus did not end within {FOCUS_S} s (state {state})")
        position = metadata["LensPosition"]
        self.device.set_controls({"AfMode": manual, "LensPosition": position})
        return f"autofocus once, then locked at {position} dioptres"

    def settle(self, order):
        """Controls act some frames after they are set; waits until they do."""
        began = time.monotonic()
        wanted = order["exposure_us"]
        while True:
            metadata = self.next_metadata()
            off = abs(metadata["ExposureTime"] - wanted)
            if off <= max(50, 0.01 * wanted) and abs(metadata["AnalogueGain"] - order["gain"]) <= 0.05 * order["gain"]:
                return metadata
            if time.monotonic() - began > SETTLING_S:
                raise Refused(
                    f"asked for {wanted:.0f} us and gain {order['gain']}, the sensor stays at "
                    f"{metadata['ExposureTime']} us and {metadata['AnalogueGain']:.2f}"
                )

    def next_metadata(self):
        with self.came:
            self.latest = None
            if not self.came.wait_for(lambda: self.latest is not None, SETTLING_S):
                raise Refused(f"no frame came within {SETTLING_S} s; look at the camera's cable")
            return self.latest

    def on_frame(self, request):
        # Called once for each frame by picamera2's thread, which must not be held up.
        real_time = time.time_ns()
        if not self.is_streaming:
            with self.came:
                self.latest = request.get_metadata()
                self.came.notify_all()
            return
        if self.waiting.full():
            self.n_lost += 1
            return
        request.acquire()
        self.waiting.put((request, real_time))

    def send_all(self):
        while True:
            request, real_time = self.waiting.get()
            try:
                self.send_frame(request, real_time)
            except Exception as error:
                send({"kind": "error", "because": f"a frame cannot be read: {error!r}"})
            finally:
                # Held, it would starve the camera of buffers.
                request.release()
                self.waiting.task_done()

    def send_frame(self, request, real_time):
        wants_raw, wants_rgb = self.held["wants"]
        pictures = [self.raw(request)] if wants_raw else []
        pictures += [self.rgb(request)] if wants_rgb else []
        lengths = iter(map(len, pictures))
        send({
            "kind": "frame",
            "metadata": request.get_metadata(),
            "real_time_ns": real_time,
            "n_raw": next(lengths) if wants_raw else None,
            "n_rgb": next(lengths) if wants_rgb else None,
            "n_lost": self.n_lost,
        }, *pictures)

    def raw(self, request):
        name, stride = self.held["raw"]
        (x0, y0), (width, height) = self.held["offset"], self.held["size"]
        # Bytes of four samples: five packed, eight in 16-bit containers.
        group = 5 if str(name).endswith("_CSI2P") else 8
        columns = slice(x0 // 4 * group, (x0 + width) // 4 * group)
        return self.cut(request, "raw", stride, slice(y0, y0 + height), columns)

    def rgb(self, request):
        stride = self.held["main"][1]
        width, height = self.held["size"]
        return self.cut(request, "main", stride, slice(0, height), slice(0, 3 * width))

    def cut(self, request, stream, stride, rows, columns):
        # Rows are padded at their end, and a buffer may be longer than its rows.
        with self.library.MappedArray(request, stream, reshape=False) as mapped:
            buffer = mapped.array
            n_rows = len(buffer) // stride
            return buffer[: n_rows * stride].reshape(n_rows, stride)[rows, columns].tobytes()

    def start(self):
        self.n_lost = 0
        self.is_streaming = True

    def stop(self):
        self.is_streaming = False
        self.waiting.join()
        send({"kind": "stopped", "n_lost": self.n_lost})


def main():
    camera = None
    for line in sys.stdin:
        try:
            command = json.loads(line)
            camera = camera or Camera()
            verb = command.pop("do")
            camera.configure(command) if verb == "configure" else getattr(camera, verb)()
        except Refused as error:
            send({"kind": "error", "because": str(error)})
        except Exception as error:
            send({"kind": "error", "because": f"picamera2: {error!r}"})
    # The agent is gone. The library's own threads would keep this process, and the camera, alive.
    os._exit(0)


main()
