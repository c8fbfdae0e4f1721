"""Options of `hoopd replay`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import json_option


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Recompute every command from the recorded inputs and compare bit for bit."""

    recording: Path = argument("A recording (.mcap) made by the daemon.")
    json_path: Path | None = json_option()
    run_law: bool = option("--run-law", text="Run the user's own law in the recording: code.", default=False)
