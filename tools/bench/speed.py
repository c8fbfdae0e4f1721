"""How much faster than real time is lock-step? `python tools/bench/speed.py`: with and without pictures, in turn."""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

CASES = {"without pictures": (("--camera", "direct"), 50.0, 60.0), "with pictures": ((), 5.0, 15.0)}


def factor(arguments: tuple[str, ...], seconds: float) -> float:
    """Real-time factor of one recorded run."""
    with tempfile.TemporaryDirectory() as name:
        summary = Path(name) / "summary.json"
        command = [sys.executable, "-m", "hoopd", "--sim", "--speed", "max", "--duration", str(seconds), *arguments]
        command += ["--record", name, "--json", str(summary)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return float(json.loads(summary.read_text())["real_time_factor"])


def main() -> int:
    """Print the medians; exit code 1 when one is below its bound."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    found: dict[str, list[float]] = {name: [] for name in CASES}
    for number in range(runs):
        for name, (arguments, _, seconds) in CASES.items():
            found[name].append(factor(arguments, seconds))
            sys.stderr.write(f"\rrun {number + 1} of {runs}, {name}  ")
    sys.stderr.write("\r")
    below = 0
    for name, (_, bound, _) in CASES.items():
        median, values = statistics.median(found[name]), found[name]
        print(f"{name}: median {median:.1f} x real time ({min(values):.1f} to {max(values):.1f}), bound {bound:.0f}")
        below += median < bound
    return int(below > 0)


if __name__ == "__main__":
    sys.exit(main())
