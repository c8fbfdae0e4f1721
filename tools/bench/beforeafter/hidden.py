"""Ten concealed cases: made by `tools/concealed`, diagnosed by any checkout, compared with what was kept.

Rules of this file: cases and diagnoses lie in a folder of work; what is there is not made again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from beforeafter import figures, trees

SEED = 22
EFFECTS = (
    "camera.latency", "hoop.coulomb_friction", "hoop.imbalance", "actuator.delay", "encoder.eccentricity",
    "ball.rolling_resistance", "unknown.detent",
)  # fmt: skip
# Two nulls, six singles of four slots and in one a closed loop, a pair, an effect that the library lacks.
GENERATE = (
    "generate", "--family", "null,single,compound,unknown", "--singles", "1", "--nulls", "2", "--compounds", "2",
    "--unknown", "1", "--only", ",".join(EFFECTS), "--seed", str(SEED),
)  # fmt: skip
DIAGNOSE = (
    "diagnose", "train_1.csv", "train_2.csv", "--holdout", "holdout.csv", "--seed", "0", "--no-free-run", "--json",
)  # fmt: skip
Say = Callable[[str], None]


def cases(tree: Path, work: Path) -> dict[str, dict[str, Any]]:
    """Answers of the ten cases by identifier; made by the checkout's own generator when they are not there."""
    if not (work / "answers").exists():
        verb, *options = GENERATE
        trees.python(tree, [str(tree.resolve() / "tools" / "concealed"), verb, str(work), *options], tree)
    return {path.stem: json.loads(path.read_text()) for path in sorted((work / "answers").glob("*.json"))}


def diagnosed(tree: Path, work: Path, identifier: str) -> dict[str, Any]:
    """Figures of a case's diagnosis."""
    out = (work / "diagnoses" / f"{identifier}.json").resolve()
    if not out.exists():
        out.parent.mkdir(exist_ok=True)
        trees.hoopd(tree, [*DIAGNOSE, str(out)], work / "cases" / identifier)
    return figures.of_diagnosis(json.loads(out.read_text()))


def run(tree: Path, work: Path, say: Say) -> dict[str, Any]:
    """All cases with their figures, in the form in which they are kept."""
    found = {}
    for identifier, answer in cases(tree, work).items():
        say(f"{identifier}: {answer['family']} {', '.join(_hidden(answer)) or '-'}")
        found[identifier] = {
            "family": answer["family"],
            "hidden": _hidden(answer),
            "recordings": _digests(work / "cases" / identifier),
            "figures": diagnosed(tree, work, identifier),
        }
    return {
        "generate": " ".join(("python tools/concealed", GENERATE[0], "FOLDER", *GENERATE[1:])),
        "diagnose": " ".join(("hoopd", *DIAGNOSE, "OUT.json")),
        "versions": figures.versions(),
        "cases": found,
    }


def _hidden(answer: Mapping[str, Any]) -> list[str]:
    return [effect["name"] for effect in answer["effects"]]


def _digests(folder: Path) -> dict[str, str]:
    """Of the recordings' bytes: a generator that has changed makes other cases."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest()[:16] for path in sorted(folder.glob("*.csv"))}
