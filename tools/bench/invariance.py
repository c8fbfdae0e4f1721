"""What a diagnosis finds when seconds, metres and newtons are called something else: nothing may change but the units.

python tools/bench/invariance.py [--plant cart] [--seconds 40] [--undeclared] [--only TEXT]
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.scaled_plants import CART, SWING, Scale, Truth, plant_in, recorded, recording_in  # noqa: E402

from hoopd import lab  # noqa: E402

SCALES = {
    "SI": Scale(),
    "milliseconds": Scale(time=1e3),
    "kiloseconds": Scale(time=1e-3),
    "kilometres": Scale(length=1e-3),
    "millinewtons": Scale(force=1e3),
    "all at once": Scale(time=1e3, length=1e-3, force=1e3),
    "a thousand times as large": Scale(length=1e3, force=1e3),
    "a thousandth": Scale(length=1e-3, force=1e-3),
}


@dataclass(frozen=True)
class Found:
    """What is compared."""

    verdict: str
    names: tuple[str, ...]
    nats: float
    sizes: dict[str, float]
    ignored: int

    def __str__(self) -> str:
        sizes = ", ".join(f"{name} {value:.5g}" for name, value in self.sizes.items())
        named = ", ".join(self.names) or "-"
        return f"{self.verdict:18s} {named:28s} {self.nats:8.2f} nats  {self.ignored} set aside  {sizes}"


def found_in(truth: Truth, scale: Scale, seconds: float, declared: bool) -> Found:
    """A diagnosis in other units; sizes in SI units again."""
    recording = recording_in(truth, scale, recorded(truth, seconds))
    made = lab.diagnose(recording, plant=plant_in(truth, scale, declared=declared), free_run=False).diagnosis
    length = 1.0 if truth.turns else scale.length
    back = {
        "J": length / (scale.force * scale.time**2), "c": length / (scale.force * scale.time),
        "k": length / scale.force, "Fc": 1.0 / scale.force,
    }  # fmt: skip
    every = {**made.base.parameters, **{name: q for one in made.effects for name, q in one.parameters.items()}}
    return Found(
        made.verdict,
        tuple(one.name for one in made.effects),
        sum(one.evidence.log_likelihood_gain or 0.0 for one in made.effects),
        {name: (q.value or 0.0) * back.get(name, 1.0) for name, q in every.items()},
        len(made.data_quality.segments_ignored) + (made.data_quality.outliers or 0),
    )


def main() -> None:
    """A line for each plant, with and without an effect, and each choice of units."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plant", choices=("cart", "swing"), action="append")
    parser.add_argument("--seconds", type=float, default=40.0)
    parser.add_argument("--undeclared", action="store_true", help="usual sizes from the data")
    parser.add_argument("--only", default="", help="choices of units whose name holds this text, beside SI")
    options = parser.parse_args()
    chosen = options.plant or ["cart", "swing"]
    for truth in (one for one in (CART, SWING) if one.name in chosen):
        for friction in (0.0, 0.1 * truth.size):
            print(f"{truth.name}, friction {friction:g}")
            for name, scale in SCALES.items():
                if options.only in name or name == "SI":
                    try:
                        made = found_in(
                            truth._replace(friction=friction), scale, options.seconds, not options.undeclared
                        )
                    except Exception as error:
                        made = f"{type(error).__name__}: {error}"
                    print(f"  {name:26s} {made}", flush=True)


if __name__ == "__main__":
    main()
