"""Recording after recording until it is known what a model leaves out: what one believes, what is recorded next, and
the story of it.

Rules of this room: it reads what the ordinary commands have written and decides; nothing is recorded or computed here.
"""
