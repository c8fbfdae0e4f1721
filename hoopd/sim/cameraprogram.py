"""Starts the rig's camera: before it loads what takes long, it goes before all ordinary work, as its loop does.

Rules of this file: standard library and the daemon's service only. Below the loop until everything is loaded; a start
at ordinary priority beside a load takes longer than the daemon waits for a first picture.
"""

from __future__ import annotations

import sys

from hoopd.shell.service import HELPER_PRIORITY, raise_thread_priority

if __name__ == "__main__":
    if "--fifo" in sys.argv and sys.argv[sys.argv.index("--fifo") + 1 :][:1] != ["0"]:
        raise_thread_priority(HELPER_PRIORITY)
    from hoopd import uncaught_errors
    from hoopd.sim.camera import main

    uncaught_errors.watch()
    sys.exit(main())
