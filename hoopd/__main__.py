"""`python -m hoopd`, and what the installed `hoopd` runs.

Rules of this file: until the command line is there, Ctrl-C ends the process quietly instead of inside an import.
"""

import signal

signal.signal(signal.SIGINT, signal.SIG_DFL)

from hoopd.cli import main  # noqa: E402

if __name__ == "__main__":
    main()
