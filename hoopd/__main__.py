"""`python -m hoopd`, and what the installed `hoopd` runs.

Rules of this file: until the command line is there, Ctrl-C ends the process quietly instead of inside an import (the
built-in module behind `signal` needs no import of its own that could be interrupted); the last resort stands before
anything large is imported.
"""

import _signal

_signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from hoopd import uncaught_errors  # noqa: E402


def main() -> None:
    """Run the command line; whatever nobody foresaw is one line and exit code 1."""
    uncaught_errors.watch()
    from hoopd.commands.cli import main as command_line

    uncaught_errors.run(command_line)


if __name__ == "__main__":
    main()
