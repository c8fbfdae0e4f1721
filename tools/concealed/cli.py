"""Command line of the proof.

python tools/concealed generate DIR --family single,null --per-effect 1 --nulls 5 --seed N    cases and answers
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from concealed import cases
from concealed.families import FAMILIES
from concealed.recipes import Wish

console = Console(stderr=True)


def wishes(options: argparse.Namespace) -> list[Wish]:
    """The cases that were asked for."""
    counts = {"single": options.per_effect, "null": options.nulls, "decoy": options.decoys,
              "confounded": options.confounded, "compound": options.compounds, "unknown": options.unknown}  # fmt: skip
    rng = np.random.default_rng([options.seed, 1])
    found: list[Wish] = []
    for family in options.family.split(","):
        found += FAMILIES[family](counts[family], rng)
    return [wish for wish in found if not options.only or set(options.only.split(",")) & set(wish.effects)]


def generate(options: argparse.Namespace) -> None:
    """Writes DIR/cases and DIR/answers."""
    wanted, start = wishes(options), time.perf_counter()
    console.print(f"{len(wanted)} cases, seed {options.seed}")
    cases.make(
        wanted, options.seed, options.dir / "cases", options.dir / "answers",
        lambda text: console.print(f"{time.perf_counter() - start:6.1f} s  {text}"),
    )  # fmt: skip


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        prog="concealed", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    make = commands.add_parser("generate", help="write cases and their answers into a folder")
    make.add_argument("dir", type=Path)
    make.add_argument("--family", default="single,null", help=f"comma-separated: {', '.join(FAMILIES)}")
    make.add_argument("--only", default="", help="comma-separated names of effects")
    make.add_argument("--per-effect", type=int, default=1)
    for name, count in (("nulls", 10), ("decoys", 6), ("confounded", 12), ("compounds", 8), ("unknown", 7)):
        make.add_argument(f"--{name}", type=int, default=count)
    make.add_argument("--seed", type=int, default=1)
    make.set_defaults(run=generate)
    options = parser.parse_args()
    options.run(options)
