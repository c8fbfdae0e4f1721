"""Real-time controller daemon for a ball-in-hoop laboratory device."""

__version__ = "0.1.0"
