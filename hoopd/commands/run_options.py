"""What runs the daemon, from the record of whichever command asks for it.

Rules of this file: every command that runs one says the same of rig, configuration, clock and camera; what a record
has no option for is as it is without it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hoopd.commands.options.running import checked_speed, without_pictures

if TYPE_CHECKING:
    from hoopd.daemon.app import Options


def run_options(asked: Any, **others: Any) -> Options:
    """The run of a command's options; `others`: what the command decides itself. InputError for a wrong word."""
    from hoopd.daemon.app import Options

    return Options(
        sim=asked.sim,
        config=asked.config,
        sets=asked.sets,
        direct=without_pictures(asked.camera),
        **{"seed": asked.seed, "speed": checked_speed(getattr(asked, "speed", "1")), **others},
    )
