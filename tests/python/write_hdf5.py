"""Writes the event table that tests/it/hdf5_python.rs reads, in common layouts.

usage: write_hdf5.py OUT LAYOUT    with LAYOUT one of dsec, flat, table
"""
import sys

import h5py
import numpy as np

out, layout = sys.argv[1:3]
n = 5000
i = np.arange(n)
t, x, y, p = i * 7, i % 12, i % 8, (i // 3) % 2
packed = dict(compression="gzip", shuffle=True, chunks=(1000,))
with h5py.File(out, "w") as file:
    if layout == "dsec":
        file.create_dataset("events/t", data=t.astype("u4"), **packed)
        file.create_dataset("events/x", data=x.astype("u2"), **packed)
        file.create_dataset("events/y", data=y.astype("u2"), **packed)
        file.create_dataset("events/p", data=p.astype("u1"), **packed)
        file["t_offset"] = np.int64(1_700_000_000_000_000)
    elif layout == "flat":
        file["ts"] = t.astype("f8")
        file["xs"] = x.astype("i2")
        file["ys"] = y.astype("i2")
        file["ps"] = (2 * p - 1).astype("i1")
    else:
        rows = np.stack([t, x, y, p], axis=1).astype("i8")
        file.create_dataset("events", data=rows, compression="lzf")
