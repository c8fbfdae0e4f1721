"""`hoopd learn` and `hoopd heal` killed at random moments.

    python tools/bench/kills.py [--kills 20] [--seed 1] [--only learn|heal] [--json FILE]

learn   one campaign on the rig whose diagnoses are told (two seconds each), killed by SIGKILL so often, each time in
        the middle of some step: no process goes on, the board's own log ends without torque, no finished file changes,
        and in the end there is to the byte what a campaign has that nobody killed
heal    runs of the whole daemon in lock-step in which friction grows, five kills in each: while nobody watches the
        accepted law acts, no file changes or goes, and in the end the friction is learned and the recording replays

Exit code 1 when anything of that is not so.
"""

from __future__ import annotations

import argparse
import collections
import json
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness import heal_kills, learn_kills  # noqa: E402

IN_A_RUN = 5


def learn(kills: int, seed: int) -> tuple[list[str], list[str]]:
    """What was done when it was killed, and what is wrong."""
    with tempfile.TemporaryDirectory(prefix="hoopd-kills-") as folder:
        killed = learn_kills.run_killed(Path(folder), kills, seed, lambda text: print(f"learn {text}", flush=True))
    return [one.partition(": ")[2].split(" ")[0] or one or "beginning" for one in killed.met], list(killed.wrong)


def heal(kills: int, seed: int) -> tuple[list[str], list[str]]:
    """In which phases it was killed, and what is wrong."""
    phases, wrong = list[str](), list[str]()
    while len(phases) < kills:
        count, run = min(IN_A_RUN, kills - len(phases)), seed + len(phases)
        with tempfile.TemporaryDirectory(prefix="hoopd-kills-") as folder:
            killed = heal_kills.run_killed(Path(folder), count, run, lambda text: print(f"heal {text}", flush=True))
        phases += killed.phases
        wrong += [f"run {run}: {one}" for one in killed.wrong]
    return phases, wrong


def main() -> int:
    """Kill, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=("learn", "heal"))
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    found = {name: what(asked.kills, asked.seed) for name, what in WHAT.items() if asked.only in (None, name)}
    for name, (met, wrong) in found.items():
        told = ", ".join(f"{count} {one}" for one, count in collections.Counter(met).most_common())
        print(f"{name}: {len(met)} kills ({told}); wrong: {'; '.join(wrong) or 'nothing'}")
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1))
    return int(any(wrong for _, wrong in found.values()))


WHAT = {"learn": learn, "heal": heal}

if __name__ == "__main__":
    sys.exit(main())
