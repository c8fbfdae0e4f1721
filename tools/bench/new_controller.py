"""New controllers in a running daemon: is a model that fits ever refused, is one that does not ever taken, and does a
trial of the very same law ever go back?

    python tools/bench/new_controller.py [--seeds 1] [--changes 12] [--json FILE]

Each row is a run of the whole daemon in lock-step, in which a controller takes over every eight seconds while the
reference moves (or rests). `hand-over` loads controllers on a model whose inertia or friction is off by so much;
rows with `Fc` are of a rig with dry friction of 6 mN m, on models that have that of the rig, another one or none, each
with the normal innovations that its design tells; `trial` puts the law that acts on trial and accepts it after four.
`step` is the largest change of the torque from one tick to the next in the ticks of changes, `usual` the largest of all
others. Exit code 1 when a right model is refused, a trial of the same law goes back, or a change is a
larger step than any other tick.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.runs import Run, run  # noqa: E402

from hoopd.core.estimator import EkfSettings  # noqa: E402
from hoopd.design.innovation_levels import innovation_levels  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.plants.hoop.loop.writeback import filter_plant  # noqa: E402
from hoopd.plants.model_file import effects_of, load_model  # noqa: E402

# The accepted law has to act for three seconds before a trial, and a supervisor may be silent for five.
EVERY_S, FIRST_S, TRIAL_S = 8.0, 5.0, 4.0
MOVES = {"steps": (0.1, 0.0, -0.1, 0.05, 0.0), "rest": (0.0,)}
STEP_EVERY_S = 2.5
LAWS = ("lqg", "arx")
INERTIA, FRICTION = "1.518e-3", "7.0e-4"
# Which number of the shipped model is replaced by what.
MODELS = {
    "right": (INERTIA, INERTIA),
    "inertia +3 %": (INERTIA, "1.564e-3"),
    "inertia +10 %": (INERTIA, "1.67e-3"),
    "inertia +30 %": (INERTIA, "1.97e-3"),
    "friction +50 %": (FRICTION, "10.5e-4"),
}
# Dry friction of the rig, and the share of it that a model has; each has the levels of its own numbers.
DRY_NM = 0.006
DRY = {"Fc right": 1.0, "Fc none": 0.0, "Fc x 0.5": 0.5, "Fc x 1.5": 1.5, "Fc x 2": 2.0}
DRY_MODELS = {**dict.fromkeys(DRY, (INERTIA, INERTIA)), "Fc, inertia +30 %": MODELS["inertia +30 %"]}
DRY_EFFECT = {"name": "hoop.coulomb_friction", "parameters": {"Fc": DRY_NM}}
PICTURE_AGE_S, TICK_S = 0.05, 0.02


class Row(NamedTuple):
    """What is tried."""

    what: str  # hand-over or trial
    model: str
    law: str
    moves: str


def controllers(folder: Path, row: Row) -> list[str]:
    """Keys of two controllers that differ in a word of their model's file alone, so that each has its own filter."""
    keys, levels = [], dict[str, Any]()
    for name in ("one", "other"):
        path, model = folder / f"model_{name}.yaml", model_text(row.model)
        path.write_text(f"{model}# {name}\n" if row.what == "hand-over" else model)
        law = (defaults_folder() / "controllers" / f"{row.law}.yaml").read_text()
        text = law.replace("models/hoop.yaml", path.name) if row.what == "hand-over" else f"{law}# {name}\n"
        if row.model in DRY_MODELS:
            levels = levels or normal_innovations(path)
            content = yaml.safe_load(text)
            content["estimator"]["innovations"] = levels
            text = yaml.safe_dump(content)
        (folder / f"{name}.yaml").write_text(text)
        keys.append(f"{name}.yaml@{hashlib.sha256(text.encode()).hexdigest()}")
    return keys


def model_text(name: str) -> str:
    """The shipped model with another number, or with dry friction."""
    text = replaced((defaults_folder() / "models" / "hoop.yaml").read_text(), *{**MODELS, **DRY_MODELS}[name])
    friction_nm = DRY_NM * DRY.get(name, 1.0) if name in DRY_MODELS else 0.0
    entry = f"{{name: hoop.coulomb_friction, parameters: {{Fc: {{value: {friction_nm}, unit: N m}}}}}}"
    return replaced(text, "effects: []", f"effects: [{entry}]") if friction_nm else text


def replaced(text: str, old: str, new: str) -> str:
    """The text with a part replaced; ValueError when it is not there, since something else would be tried then."""
    if old not in text:
        raise ValueError(f"the shipped model has no {old!r}")
    return text.replace(old, new)


def normal_innovations(path: Path) -> dict[str, Any]:
    """As `hoopd design` tells them of a model."""
    plant = filter_plant(effects_of(load_model(path)))
    return dict(innovation_levels(plant, EkfSettings(), PICTURE_AGE_S, TICK_S))


def script(row: Row, keys: list[str], changes: int) -> Iterator[dict[str, Any]]:
    """The rig's operator."""
    for k in range(changes):
        t = FIRST_S + EVERY_S * k
        yield {"at_s": t, "name": "controller" if row.what == "hand-over" else "trial", "key": keys[k % 2]}
        if row.what == "trial":
            yield {"at_s": t + TRIAL_S, "name": "accept"}
    moves = itertools.cycle(MOVES[row.moves])
    for k in range(int(EVERY_S * changes / STEP_EVERY_S)):
        yield {"at_s": 2.0 + STEP_EVERY_S * k, "name": "reference", "value": next(moves)}


def steps_of(done: Run) -> tuple[float, float]:
    """Largest step of the torque in the ticks of changes, and in all others while the law acts, N m."""
    changed = {round(event.t, 6) for event in done.events if event.event == "controller"}
    there, elsewhere = [0.0], [0.0]
    for before, tick in itertools.pairwise(done.ticks):
        if before.mode == tick.mode == "RUNNING" and tick.t > FIRST_S - 1.0:
            (there if round(tick.t, 6) in changed else elsewhere).append(abs(tick.u - before.u))
    return max(there), max(elsewhere)


def tried(row: Row, seed: int, changes: int) -> dict[str, Any]:
    """One run."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "controllers").mkdir()
        commands = list(script(row, controllers(folder / "controllers", row), changes))
        control = {"file": f"controllers/{row.law}.yaml", "folder": str(folder / "controllers")}
        duration_s = FIRST_S + EVERY_S * changes
        rig: dict[str, Any] = {"effects": [DRY_EFFECT]} if row.model in DRY_MODELS else {}
        config = {"control": control}
        done = run(folder / "run", config=config, commands=commands, duration_s=duration_s, seed=seed, **rig)
    count = {name: sum(event.event == name for event in done.events) for name in ("controller", "trial_returned")}
    reasons = [event.fields["reason"] for event in done.events if event.event == "command_refused"]
    step, usual = steps_of(done)
    return {
        "taken": count["controller"],
        "refused": sum("does not fit" in reason for reason in reasons),
        "went back": count["trial_returned"],
        "step": step,
        "usual": usual,
    }


def rows() -> Iterator[Row]:
    """All that is tried."""
    for law, moves in itertools.product(LAWS, MOVES):
        for model in MODELS:
            yield Row("hand-over", model, law, moves)
        yield Row("trial", "right", law, moves)
    for moves, model in itertools.product(MOVES, DRY_MODELS):
        yield Row("hand-over", model, "lqg", moves)


def main() -> int:
    """Print the table; 1 when something is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--changes", type=int, default=12)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table, wrong = [], 0
    print(f"{'what':10} {'model':17} {'law':4} {'moves':6}  taken refused went back   step  usual N m")
    for row in rows():
        found = [tried(row, seed, options.changes) for seed in range(options.seeds)]
        figures = {name: sum(one[name] for one in found) for name in ("taken", "refused", "went back")}
        figures |= {name: max(one[name] for one in found) for name in ("step", "usual")}
        right = row.model in ("right", "Fc right")
        wrong += right and (figures["refused"] > 0 or figures["went back"] > 0 or figures["step"] > figures["usual"])
        table.append({**row._asdict(), **figures})
        counts = f"{figures['taken']:6} {figures['refused']:7} {figures['went back']:9}"
        steps = f"{figures['step']:.3f}  {figures['usual']:.3f}"
        print(f"{row.what:10} {row.model:17} {row.law:4} {row.moves:6} {counts}  {steps}")
    if options.json:
        options.json.write_text(json.dumps(table, indent=2))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
