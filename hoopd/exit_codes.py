"""Exit codes of the program and what they mean; scripts and systemd depend on them.

Rules of this file: numbers only.
"""

DONE = 0
# Our own mistake, or a check of the device that failed.
FAILED = 1
# One line said which file, key or option, and why.
UNUSABLE_INPUT = 2
# The board's port was missing: the one failure that waiting mends, so a service tries again.
PORT_MISSING = 3
