#!/usr/bin/env python3
"""Reads a recording with rerun's own importer, and tells what it made of each topic.

    python tools/viewers/check_rerun.py RECORDING [--rerun PROGRAM]

PROGRAM is `rerun` of an environment of its own (`python -m venv VENV && VENV/bin/pip install rerun-sdk`); it is no
dependency of this project. Prints one JSON object. Exit code 0: every message of the recording was imported; 1: not;
77: not checked, there is no such program.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

SKIPPED = 77
TIMEOUT_S = 120.0
CHUNK = re.compile(r"with (\d+) rows? .* - (/\S*) - data columns: \[(.*)\]")


def imported(program: str, recording: Path) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Rows and components of each entity that the importer made, and its warnings."""
    environment = os.environ | {"NO_COLOR": "1", "RERUN_ANALYTICS": "0"}

    def run(*arguments: str) -> tuple[str, str]:
        done = subprocess.run(
            [program, *arguments], capture_output=True, text=True, timeout=TIMEOUT_S, env=environment, check=True
        )
        return done.stdout, done.stderr

    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "out.rrd")
        _, said = run("mcap", "convert", str(recording), "-o", out)
        printed, _ = run("rrd", "print", out)
    rows: Counter[str] = Counter()
    components: dict[str, set[str]] = {}
    for count, entity, columns in CHUNK.findall(printed):
        components.setdefault(entity, set()).update(columns.split())
        rows[entity] += int(count) if "McapMessage:data" in columns else 0
    warnings = [re.sub(r".*WARN\S*\s+", "", line) for line in said.splitlines() if "WARN" in line]
    return {name: {"messages": rows[name], "components": sorted(components[name])} for name in components}, warnings


def recorded(recording: Path) -> dict[str, int]:
    """Messages of each topic."""
    with recording.open("rb") as file:
        return dict(Counter(channel.topic for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages()))


def main() -> int:
    """Import, compare, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--rerun", default="rerun", metavar="PROGRAM")
    arguments = parser.parse_args()
    program = shutil.which(arguments.rerun)
    if program is None:
        print(f"skipped: no program {arguments.rerun}")
        return SKIPPED
    try:
        entities, warnings = imported(program, arguments.recording)
    except subprocess.SubprocessError as error:
        print(f"{arguments.recording}: {getattr(error, 'stderr', None) or error}", file=sys.stderr)
        return 1
    wanted = recorded(arguments.recording)
    missing = {topic: n for topic, n in wanted.items() if entities.get(topic, {}).get("messages") != n}
    print(json.dumps({"entities": entities, "warnings": warnings, "not imported": missing}, indent=1))
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
