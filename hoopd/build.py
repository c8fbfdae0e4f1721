"""From files to a tick: the same construction for the daemon and for a replay.

Rules of this file: everything is made from texts, so that a recording that holds them rebuilds the same tick; no
port, no camera, no clock.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from hoopd.core.controllers import Controller
from hoopd.core.limits import Limiter
from hoopd.core.tick import Tick
from hoopd.files import InputError, read_text
from hoopd.shell.config import Config, dump, find


class Texts(NamedTuple):
    """All that a tick is made of, as the files hold it."""

    config: str
    model: str
    controller: str
    law: str = ""


def read_texts(config: Config, config_path: Path | None) -> Texts:
    """Texts of the files that a configuration names."""
    law = config.control.law
    return Texts(
        dump(config),
        read_text(find(config.device.model, config_path)),
        read_text(find(config.control.file, config_path)),
        read_text(find(law, config_path)) if law else "",
    )


def load_law(text: str, name: str) -> Callable[[], Controller]:
    """Class `Law` of a user's Python file; it is the user's own code and runs with the daemon's rights."""
    space: dict[str, Any] = {"__name__": "hoopd_law"}
    try:
        exec(compile(text, name, "exec"), space)
    except Exception as error:
        raise InputError(name, "", f"cannot be loaded: {type(error).__name__}: {error}") from None
    law = space.get("Law")
    if not isinstance(law, type) or not all(callable(getattr(law, part, None)) for part in ("update", "reset")):
        raise InputError(name, "Law", "needs a class Law with update(measurement) and reset()")
    return law
