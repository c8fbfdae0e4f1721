"""Real-time controller daemon for a ball-in-hoop laboratory device."""

from hoopd import moved

__version__ = "0.1.0"

moved.install()
