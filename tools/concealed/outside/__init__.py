"""Physics outside the library of who is asked: mechanisms with memory, and in coordinates that nobody measures.

Rules of this room: numpy only, nothing of `hoopd`; every mechanism's docstring has its equation and its source; a size
of 0 is the plain device to the bit; whatever has no energy of its own takes energy away.
"""
