"""`python -m hoopd`, and what the installed `hoopd` runs.

Rules of this file: until the command line is there, Ctrl-C ends the process quietly instead of inside an import. The
built-in module behind `signal` needs no import of its own that could be interrupted.
"""

import _signal

_signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from hoopd.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
