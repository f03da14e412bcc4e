"""Reads every event of an HDF5 export. usage: read_hdf5.py FILE N_EVENTS"""

import sys

import h5py

with h5py.File(sys.argv[1]) as f:
    lengths = [len(f[f"events/{name}"][:]) for name in "txyp"]
    assert lengths == [int(sys.argv[2])] * 4, lengths
    print(f"h5py {h5py.version.version} with HDF5 {h5py.version.hdf5_version}")
