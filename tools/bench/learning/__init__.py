"""Devices of the proof's own generator that play what a campaign asks for."""
