"""Fits of real recordings from published values: none may end at a worse criterion than it started with.

python tools/bench/fit_start.py --out FOLDER [--only TEXT] [--tree CHECKOUT]

For each recording and start three fits: `hoopd fit` by free runs, `hoopd fit --method prediction`, and the base of
`hoopd diagnose`. Of the first two the free runs' errors are compared (of predictions only what they are, for they are
not what was minimised), of the third the likelihood of the filter's innovations with noise levels fitted at both ends.
Exit code 1 when a criterion is worse at the end, 2 when the recordings are not there. `--only`: cases whose name holds
this text. Results of commands are kept in --out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from beforeafter import trees
from realdata import starts
from realdata.kept import Commands, Data
from realdata.places import HOOPS, shared_file

from hoopd.files.plant_text import with_values
from hoopd.files.reading import read_text
from hoopd.files.shipped import or_shipped
from hoopd.plants import registry
from hoopd.plants.plant_model import load_plant_model, nominal_model


class Case(NamedTuple):
    """A recording and where its fit begins: a model of the hoop, or a registered plant with other values."""

    name: str
    path: Path
    arguments: tuple[str, ...]
    start: str
    values: Mapping[str, float] = {}

    @property
    def is_hoop(self) -> bool:
        """Whether `start` is a model file of the hoop."""
        return self.start.endswith(".yaml")


# The mass that was published of the axis; friction and offset as a fit of forces without dry friction has them. The
# pendulum's inertia from the period of small swings.
AXIS = {"M": 95.1, "Fv": 410.0, "offset": -3.1}
PENDULUM = {"J": 1.563e-4, "c": 1.5e-5}


def cases() -> list[Case]:
    """All; ToolError when a recording is not there."""
    found = []
    for plant, values, files in (
        ("axis", AXIS, ("axis_1kHz",)),
        ("pendulum", PENDULUM, ("pendulum_decay_7", "pendulum_decay_11")),
    ):
        for file in files:
            path = shared_file(f"plants/{file}.csv")
            found += [Case(f"{file}, nominal", path, (), plant), Case(f"{file}, published", path, (), plant, values)]
    for one in HOOPS:
        models = ("models/hoop.yaml",) if one.arguments or one.name in ("sine", "ball") else STARTS
        found += [Case(f"{one.name}, {Path(model).stem}", one.path, one.arguments, model) for model in models]
    return found


# The entries of the thesis are of hoop and ball together.
STARTS = ("models/hoop.yaml", "models/thesis.yaml")


def _fitted(commands: Commands, case: Case, method: str) -> starts.Start | str:
    """`hoopd fit`, or why it failed."""
    if case.is_hoop:
        structure = "entries" if "thesis" in case.start else "rolling"
        how: tuple[str | Data, ...] = ("--model", case.start, "--structure", structure)
    else:
        how = ("--plant", Data(_plant_file(case, commands.out)) if case.values else case.start)
    done = commands.run(["fit", Data(case.path), *case.arguments, *how, "--method", method])
    return done.failure if done.result is None else starts.of_output(done.result)


def _plant_file(case: Case, out: Path) -> Path:
    """The plant's own file with other numbers."""
    out.mkdir(parents=True, exist_ok=True)
    own = Path(registry.__file__).with_name(f"{case.start}.yaml")
    target = out / f"{case.start}_published.yaml"
    target.write_text(with_values(read_text(own), own, case.values, {}, target.stem), encoding="utf-8")
    return target


def _base(case: Case) -> starts.Start:
    model = load_plant_model(or_shipped(Path(case.start))) if case.is_hoop else nominal_model(case.start)
    columns = case.arguments[1] if case.arguments else None
    return starts.of_base(str(case.path), model.plant, {**model.values, **case.values}, columns)


def _shown(what: str, found: starts.Start | str, *, judged: bool) -> bool:
    """A line of the table; whether its bound holds."""
    if isinstance(found, str):
        print(f"  {what:12} FAILED: {found}", flush=True)
        return False
    if not (judged or found.percent):
        print(f"  {what:12} its record has no free runs", flush=True)
        return True
    told = "  ".join(f"{name} {one:.1f} -> {other:.1f} %" for name, (one, other) in found.percent.items())
    mark = "  WORSE" if found.is_worse else ""
    mark += "" if judged or not mark else " (not what it minimises)"
    print(f"  {what:12} {found.end_nats - found.start_nats:+12.1f} nats  {told}{mark}", flush=True)
    return not (judged and found.is_worse)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of results; what is there is not made again")
    parser.add_argument("--tree", type=Path, default=trees.ROOT, help="checkout that fits (this one; not the base)")
    parser.add_argument("--only", default="", help="cases whose name holds this text")
    return parser.parse_args()


def main() -> int:
    """Measure and judge."""
    options = _options()
    try:
        asked = [one for one in cases() if options.only in one.name]
    except trees.ToolError as error:
        print(f"fit_start: {error}", file=sys.stderr)
        return 2
    commands, well = Commands(options.out, options.tree, 2 * len(asked)), []
    for case in asked:
        print(case.name)
        well.append(_shown("free runs", _fitted(commands, case, "output"), judged=True))
        well.append(_shown("prediction", _fitted(commands, case, "prediction"), judged=False))
        well.append(_shown("diagnosis", _base(case), judged=True))
    print(f"{sum(well)} of {len(well)} fits end no worse than they started")
    return int(not all(well))


if __name__ == "__main__":
    sys.exit(main())
