"""What held-out data say about each named effect: confirmed, weak, untested or not confirmed; and which are kept.

A name by which blocks of the training data are simulated worse is weak, and in no model that is written; nor is a law
with a phase that moves the plant and does not surely improve them. A name beside the others that lowers the held-out
simulation of any channel beyond noise, or by which the held-out data lose likelihood, is not confirmed, and is in no
model that is written. Where several are denied, each of them beside the others, or the rest together is still worse
than the re-fitted base, all are taken up again one after the other, the one with the most evidence first, the denied
ones once more beside what is kept by then; those that still lower a channel are not confirmed. A denied name that
leaves evidence stays among the findings, for something is there; one that leaves none is refused. Whatever stands in a
place gains in held-out data: a law that is hardly the one in its place is confirmed by none of it.

Rules of this file: the search is over; nothing is named here, and nothing is refused but by held-out data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hoopd.diagnose.proof.denial import STRONG, Denial, denial
from hoopd.diagnose.proof.fit_tables import Played, nrmse, with_and_without
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.separation import own_columns
from hoopd.diagnose.proof.training_windows import fitted_with, is_wave, reason_of, simulated_worse
from hoopd.diagnose.proof.unknown_proof import Proven
from hoopd.diagnose.proof.worse_channels import LEAST_POINTS, lowered
from hoopd.diagnose.record import Placebo, Status
from hoopd.diagnose.search.candidates import UNSEEN_LOSS, Tried, needed_of, surprise_of
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import whitened_changes
from hoopd.ident.normal import Z95
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

# A name whose surprise is less than this above the threshold barely passes, nats.
WEAK_NATS = 3.0
# A name less likely than this is hardly the law in its place.
LEAST_LIKELY = 0.01
HARDLY = "other laws are far likelier in its place: it is less than 1 % likely"
# Added to the squares of columns of unit length: of two equal ones nothing else is each one's own.
LEAST_OWN = 1e-9
UNSIZED = "nobody knows how much there is of it: the 95 % intervals of all its sizes hold none"
# Of an effect that changes the held-out data by less, they say nothing, nats.
LEAST_REACH = UNSEEN_LOSS

Denials = Mapping[str, Denial]


@dataclass(frozen=True)
class Confirmation:
    """Names by what held-out data say about them."""

    kept: HypothesisFit  # of the training data, with the names that are not denied
    # the same without names that do harm, and without weak ones of little evidence that simulate nothing better: what a
    # model is written from
    written: HypothesisFit
    final: HypothesisFit  # the same with what has no name, where that is not denied
    fits: Mapping[str, Played]  # on the held-out data, `final` among them; none without any
    statuses: Mapping[str, Status]  # what has no name among them
    denials: Denials = field(default_factory=dict)  # of what is not confirmed
    refused: frozenset[str] = frozenset()  # names that leave no evidence either
    # names that blocks of the training data speak against: points of fit that channels lose by them; no points where
    # they are not surely better with a name that needs it
    harmful: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    unlikely: frozenset[str] = frozenset()  # names that are hardly the law in their place
    whole: str = ""  # why none of all names together is confirmed
    unsized: frozenset[str] = frozenset()  # names of which nobody knows how much there is
    barely: frozenset[str] = frozenset()  # names that are no more than some way beyond chance

    def reason(self, name: str) -> str:
        """Why a finding is not confirmed, weak, or in no model; empty where nothing more is to be said."""
        if name in self.denials:
            return self.denials[name].reason
        if name in self.unsized and self.statuses.get(name) == "weak":
            return UNSIZED
        lost = self.harmful.get(name)
        if name in self.unlikely and not lost:
            return HARDLY
        if self.whole and not lost and self.statuses.get(name) == "weak":
            return self.whole
        return "" if lost is None else reason_of(lost)


def confirmation(
    named: Named,
    held: HeldOut,
    fits: Mapping[str, Played],
    proof: Proven | None,
    threshold: float,
    seed: int = 0,
    shuffled: Mapping[str, Placebo] | None = None,
) -> Confirmation:
    """Of every accepted effect; `fits`: as of `heldout_fits`; `proof`: of what has no name; `shuffled`: by name."""
    names = _of_names(named, held, fits, seed)
    fits = _beside_kept(named, held, fits, names)
    own = {one.effect.name: _doubted(named, one, fits, threshold, shuffled or {}) for one in named.accepted}
    harmful = simulated_worse(named, names.kept.names, seed)
    own |= {name: "weak" for name, lost in harmful.items() if lost}
    denials = dict(names.denials)
    own |= dict.fromkeys(denials, "not_confirmed")
    final = names.kept
    if proof is not None:
        own[proof.unknown.name], by_curve = _of_curve(proof, fits, seed)
        denials |= {proof.unknown.name: by_curve} if by_curve else {}
        if proof.joint is not None and not by_curve and names.kept is named.final:
            final = proof.joint
    shown = fits if final is not names.kept or not fits else {**fits, "final": names.heldout or fits["named"]}
    if whole := of_all(fits, names.heldout, seed):
        own |= {name: "weak" for name, status in own.items() if status == "confirmed"}
    unsized = frozenset(one.effect.name for one in named.accepted if is_unsized(one.effect, names.kept))
    own |= {name: "weak" for name in unsized if own[name] == "confirmed"}
    refused = frozenset(
        one.effect.name for one in named.accepted
        if (why := names.denials.get(one.effect.name)) is not None
        and not why.leaves_evidence(surprise_in(named, one), threshold)
    )  # fmt: skip
    barely = frozenset(one.effect.name for one in named.accepted if surprise_in(named, one) < STRONG * threshold)
    left_out = [
        name for name in names.kept.names
        if name in {*harmful, *unsized}
        or (name in barely and own[name] == "weak" and not _simulates_better(name, fits, seed))
    ]  # fmt: skip
    written = _fitted_without(names.kept, left_out)
    return Confirmation(
        names.kept, written, final, shown, own, denials, refused, harmful, whole=whole, unsized=unsized, barely=barely
    )


def of_all(fits: Mapping[str, Played], together: Played | None, seed: int) -> str:
    """Why held-out data confirm none of the names, whatever each of them gains: all together simulate them worse than
    the user's own model, or worse than their mean. Empty where they do not."""
    if together is None or "nominal" not in fits:
        return ""
    if lost := lowered(fits["nominal"], together, seed):
        name, points = max(lost.items(), key=lambda one: one[1])
        return f"with all that is named, held-out {name} is simulated {points:.1f} points worse than by your own model"
    percents = [value for runs in together.by_recording().values() for value in nrmse(runs).values()]
    if percents and np.nanmax(percents) <= 0.0:
        return "with all that is named, held-out data are simulated no better than by their mean"
    return ""


def is_unsized(effect: Effect, found: HypothesisFit) -> bool:
    """Whether no size of an effect is told from none (95 %), were the base known: where recordings tell only the ratios
    of an inertia, a friction and a motor's constant, a force is known as well as they are. What an effect shares with
    the base is left to its evidence, and what is believed beforehand does not count."""
    sizes = [(effect.key(p.name), p.neutral) for p in effect.parameters if p.role == "amplitude"]
    known = [(key, neutral) for key, neutral in sizes if key in found.free]
    if not known:
        return False
    base = {name for track in found.tracks for name in track.stretch.plant.free}
    own = [i for i, name in enumerate(found.free) if name not in base]
    columns = found.stacked()[:, 1:][:, own]
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    inverse = np.linalg.inv((columns / size).T @ (columns / size) + LEAST_OWN * np.eye(len(own)))
    deviations = dict(zip([found.free[i] for i in own], np.sqrt(np.diag(inverse)) / size, strict=True))
    return all(abs(found.values[key] - neutral) < Z95 * deviations[key] for key, neutral in known)


def less_sure(said: Confirmation, likely: Mapping[str, float | None], seed: int = 0) -> Confirmation:
    """What is hardly the law in its place (`likely`, by name) is weak, whatever held-out data gain by it, and stays
    untested where they never test it; and in no model where it barely passes and they are not surely simulated better
    with it: what is far beyond chance is nearer to the law in its place than nothing is."""
    unlikely = frozenset(
        name for name, share in likely.items()
        if share is not None and share < LEAST_LIKELY and said.statuses.get(name) in ("confirmed", "weak", "untested")
    )  # fmt: skip
    left_out = [
        name for name in unlikely & said.barely
        if name in said.written.names and not _simulates_better(name, said.fits, seed)
    ]  # fmt: skip
    return replace(
        said,
        written=_fitted_without(said.written, left_out),
        statuses={**said.statuses, **{name: "weak" for name in unlikely if said.statuses[name] != "untested"}},
        unlikely=unlikely,
    )


def _simulates_better(name: str, fits: Mapping[str, Played], seed: int) -> bool:
    """Whether held-out windows are surely worse without it, whatever a filter makes of them."""
    return f"without {name}" in fits and bool(lowered(*with_and_without(fits, name), seed))


def _fitted_without(kept: HypothesisFit, left_out: Sequence[str]) -> HypothesisFit:
    """The other names fitted again."""
    if not left_out:
        return kept
    own = [effect for effect in kept.effects if effect.name not in left_out]
    stretches = [track.stretch for track in kept.tracks]
    return fit(stretches, own, kept.values, like=kept, noise=kept.noise)


def beside_the_others(named: Named, fits: Mapping[str, Played], seed: int) -> dict[str, Denial]:
    """Names that held-out data deny; `fits`: all together, and without each."""
    found: dict[str, Denial] = {}
    for one in named.accepted:
        name = one.effect.name
        why = denial(fits[f"without {name}"], fits["named"], named.losses[name], len(named.accepted), seed)
        found |= {name: why} if why is not None else {}
    return found


@dataclass(frozen=True)
class _Names:
    """Names that are kept, and why the others are not."""

    kept: HypothesisFit
    heldout: Played | None
    denials: dict[str, Denial]


def _of_names(named: Named, held: HeldOut, fits: Mapping[str, Played], seed: int) -> _Names:
    if not fits or not named.accepted:
        return _Names(named.final, fits.get("named"), {})
    denials = beside_the_others(named, fits, seed)
    if len(denials) > 1:  # each was denied beside the others that are
        return _taken_up(named, held, fits, seed)
    kept = _without(named, [*denials])
    on_held = held.played_of(kept) if denials else fits["named"]
    assert on_held is not None
    if lowered(fits["base"], on_held, seed):
        return _taken_up(named, held, fits, seed)
    return _Names(kept, on_held, denials)


def _beside_kept(named: Named, held: HeldOut, fits: Mapping[str, Played], names: _Names) -> Mapping[str, Played]:
    """What is proven beside names that were denied is none: each kept name beside the other kept ones, and each denied
    one beside all of them (`with NAME`)."""
    if not names.denials or names.heldout is None:
        return fits
    kept = [one.effect for one in named.accepted if one.effect.name in names.kept.names]
    found = {**fits, "named": names.heldout}
    for one in named.accepted:
        name, is_kept = one.effect.name, one.effect in kept
        beside = [effect for effect in kept if effect.name != name] if is_kept else [*kept, one.effect]
        other = held.played_of(fitted_with(named, beside))
        if other is not None and is_kept:
            found[f"without {name}"] = other
        elif other is not None:
            found |= {f"without {name}": names.heldout, f"with {name}": other}
    return found


def _without(named: Named, dropped: Sequence[str]) -> HypothesisFit:
    """The others fitted again; a fit that was made already is taken."""
    return fitted_with(named, [one.effect for one in named.accepted if one.effect.name not in dropped])


def _of_curve(proof: Proven, fits: Mapping[str, Played], seed: int) -> tuple[Status, Denial | None]:
    """What has no name: its values carry over to the held-out data, or they do not."""
    if proof.denial is not None:
        return "not_confirmed", proof.denial
    without = fits.get(f"without {proof.unknown.name}")
    lost = {} if without is None else lowered(without, fits["final"], seed)
    if lost or proof.unknown.carries_over is False:
        return "not_confirmed", Denial(lost) if lost else None
    if without is None:
        return "untested", None
    return status_of(proof.unknown.surprise, proof.unknown.threshold), None


def _taken_up(named: Named, held: HeldOut, fits: Mapping[str, Played], seed: int) -> _Names:
    """Names one after the other; once more those that were denied beside fewer than are kept in the end."""
    kept, on_held, denials = named.base, fits["base"], dict[str, Denial]()
    order = sorted(named.accepted, key=lambda one: -named.losses[one.effect.name])
    beside: dict[str, HypothesisFit] = {}  # what was kept when a name was denied
    for one in [*order, *order]:
        name = one.effect.name
        if name in kept.names or beside.get(name) is kept:
            continue
        more = fitted_with(named, [*kept.effects[len(named.base.effects) :], one.effect])
        after = held.played_of(more)
        assert after is not None
        why = denial(on_held, after, named.losses[name], len(order), seed)
        if why is not None:
            denials[name], beside[name] = why, kept
        else:
            kept, on_held = more, after
            denials.pop(name, None)
    return _Names(kept, on_held, denials)


# ---------------------------------------------------------------------------------------------- one name


def _status(named: Named, one: Tried, fits: Mapping[str, Played], threshold: float) -> Status:
    """As long as nothing is lowered by it."""
    name = one.effect.name
    if not fits:
        return "untested"
    with_it, without = with_and_without(fits, name)
    # along a run without its states what has a memory does nothing: whether it is reached, its own run says
    if one.effect.plant is None and reach(one.effect, without.fit, with_it.fit) < LEAST_REACH:
        return "untested"
    # what held-out data are not more likely with, they do not bear out
    gained = without.fit.criterion - with_it.fit.criterion
    if gained <= 0.0 or (is_wave(one.effect) and _points_gained(without, with_it) < -LEAST_POINTS):
        return "weak"
    return status_of(surprise_in(named, one), threshold)


def _doubted(
    named: Named, one: Tried, fits: Mapping[str, Played], threshold: float, shuffled: Mapping[str, Placebo]
) -> Status:
    """The same when its shuffles were heard."""
    name, status = one.effect.name, _status(named, one, fits, threshold)
    if name not in shuffled:
        return status
    needed = needed_of(one.score, threshold, [track.stretch for track in named.base.tracks])
    return doubted(status, named.losses[name], needed, shuffled[name])


def doubted(status: Status, gain: float, needed: float, placebo: Placebo) -> Status:
    """A name is weak whose gain is not beyond what is needed times what its shuffles gain over what they may.

    Shuffles without a cause that gain more than chance gives say that the residual is no noise to an effect of this
    form: what it needs grows as they do.
    """
    if status != "confirmed" or placebo.held or not placebo.limit or placebo.most is None:
        return status
    return status if gain > needed * placebo.most / placebo.limit else "weak"


def _points_gained(without: Played, with_it: Played) -> float:
    """Points of fit, the mean over recordings of the sum over channels."""
    gained = []
    after = with_it.by_recording()
    for recording, runs in without.by_recording().items():
        one, other = nrmse(runs), nrmse(after[recording])
        gained.append(float(np.nansum([other[channel] - one[channel] for channel in one])))
    return float(np.mean(gained)) if gained else 0.0


def surprise_in(named: Named, one: Tried) -> float:
    """Of what a name explains beside the others."""
    return surprise_of(one.score, named.losses[one.effect.name], [track.stretch for track in named.base.tracks])


def status_of(surprise: float, threshold: float) -> Status:
    """Of what held-out data do not speak against."""
    return "weak" if surprise < threshold + WEAK_NATS else "confirmed"


def reach(effect: Effect, without: HypothesisFit, with_it: HypothesisFit) -> float:
    """Nats by which the held-out data would differ without the effect, parameters frozen: none, where they never reach
    what it acts on."""
    columns = own_columns(without, effect, with_it.values)
    change = whitened_changes(without, [(effect, column) for column in columns]).sum(axis=1)
    return float(np.nan_to_num(change @ change)) / 2.0
