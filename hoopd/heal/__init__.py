"""A running loop that is followed and mended: what changed, whether it may be learned, the trial of what was learned,
and the versions with their evidence.

Rules of this room: it decides from ticks, facts and files of the ordinary commands; it reads no clock, sends nothing
and starts no process.
"""
