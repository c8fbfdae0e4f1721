"""Attacks from the same machine on the daemon's ways in: who does what, and what it costs the loop."""
