"""Recordings: the one type, files from and to it, editing.

Rules of this package: immutable data; the daemon imports it, so scipy and h5py are met only inside of `load` and
`save`.
"""

from hoopd.recording.formats import load, load_all, save
from hoopd.recording.recording import Recording, Signal, from_columns, from_signals

__all__ = ["Recording", "Signal", "from_columns", "from_signals", "load", "load_all", "save"]
