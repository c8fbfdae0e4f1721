"""Recordings: the one type, files from and to it, editing.

Rules of this package: immutable data; the daemon imports it, so scipy and h5py are met only inside of `load` and
`save`.
"""

from hoopd.recording.formats import load, load_all, save
from hoopd.recording.recording import Recording

__all__ = ["Recording", "load", "load_all", "save"]
