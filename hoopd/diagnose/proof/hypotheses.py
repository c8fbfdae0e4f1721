"""Every hypothesis of a diagnosis on the held-out recordings, and the ceiling: what needs no name.

Rules of this file: parameters are frozen; a hypothesis that two names share is run once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hoopd.diagnose.curves.curve_fits import together
from hoopd.diagnose.curves.curve_screen import CurveScore
from hoopd.diagnose.curves.unknown_effects import Survey, Unknown, best_curves
from hoopd.diagnose.proof.held_out import HeldOut, on_heldout
from hoopd.diagnose.proof.unknown_proof import Proven
from hoopd.diagnose.search.candidates import UNSEEN_LOSS
from hoopd.diagnose.search.naming import Named
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.stretches import Stretch


def heldout_fits(named: Named, held: HeldOut, base: Survey, proof: Proven | None) -> Mapping[str, HypothesisFit]:
    """By name: nominal, base, named (all names), final (with what has no name), each finding taken out, the ceiling."""
    if not held.stretches:
        return {}
    wanted = {"nominal": named.nominal, "base": named.base, "named": named.final}
    wanted |= {f"without {name}": one for name, one in named.without.items()}
    found = {name: run for name, one in wanted.items() if (run := held.of(one)) is not None}
    found["final"] = found["named"]
    if proof is not None and proof.heldout is not None and (beside := held.of(proof.unknown.beside)) is not None:
        found |= {"final": proof.heldout, f"without {proof.unknown.name}": beside}
    found["ceiling"] = ceiling(base, held.stretches, proof, found["base"])
    return found


def ceiling(base: Survey, heldout: Sequence[Stretch], proof: Proven | None, nothing: HypothesisFit) -> HypothesisFit:
    """What curves reach that need no name: beside the re-fitted base the best curve of every slot that asks for one.

    Fitted together on the training stretches; `proof`: of the unknown effect, which may be that; `nothing`: the base's.
    """
    chosen = best_curves(base)
    if not chosen:
        return nothing
    if proof is not None and proof.heldout is not None and _is(proof.unknown, chosen, base.fit):
        return proof.heldout
    found, again = on_heldout(together(chosen, base.fit)[0], heldout, base.fit)
    # what the held-out data refuse is no ceiling
    return found if found.criterion + again / 2.0 < nothing.criterion + UNSEEN_LOSS else nothing


def _is(unknown: Unknown, chosen: Sequence[CurveScore], beside: HypothesisFit) -> bool:
    return unknown.beside is beside and len(chosen) == 1 and chosen[0] is unknown.score
