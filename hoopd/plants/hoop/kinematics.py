"""Which kinematics recordings support: rolling without slipping, or the papers' w = phi' + theta'.

Free runs alone cannot tell. With the same mb, Ro-Rb, Ib, Ih, bh and bb (Ro/Rb)^2 the two give the same eight entries
when Ro/Rb differs by one (`entries.equivalent`). So the radii must be known, better than one in Ro/Rb, and one
of mb, Ro-Rb, Ib, Ih beside them. Evidence is twice the difference of log-likelihood between the kinematics, with what
is known as a prior:

    chi2_k = min over p  (e_k(p) - e)' C^-1 (e_k(p) - e) + sum (log p_i/p_i0)^2 / s_i^2,

e the entries fitted to the recordings and C their covariance under coloured residuals. Fits of both kinematics to the
recordings themselves must agree; their deviances are divided by c = tr(A^-1 B)/m, the mean growth of variance by
coloured residuals (A information, B its coloured counterpart; Varin, Reid, Firth 2011, composite likelihood).

Rules of this file: a verdict needs decisive evidence and a geometry that the recordings do not contradict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.output_error import Solution
from hoopd.plants.fits.runs import Run
from hoopd.plants.fits.uncertainty import Uncertainty, prior_information, uncertainty
from hoopd.plants.hoop.entries import ENTRIES, entries_of
from hoopd.plants.hoop.fitting.free_parameters import PHYSICAL, PRIOR
from hoopd.plants.hoop.fitting.hoop_output_error import fit_output_error
from hoopd.plants.hoop.fitting.physical_parameters import Known, physical_from_entries, quantity, quantity_sd
from hoopd.plants.hoop.fitting.separating_measurement import (
    DECISIVE,
    STARTS,
    Predicted,
    minimum_chi2,
    predicted_figures,
    predicted_words,
    separating,
    separating_words,
)
from hoopd.plants.hoop.parameters import KINEMATICS

Array = NDArray[np.float64]
Progress = Callable[[str], None]

# A known geometry is contradicted when its chi2 would come once in a thousand.
CONTRADICTED = 1e-3
# The fitted entries break the two constraints when their chi2 would come once in a hundred.
MISSING = 1e-2
# Relative standard deviations of what a laboratory weighs and measures. Three published values of Ro-Rb differ by 3 %;
# the inertia is that of a solid ball of measured mass and diameter.
MEASURED = {"mb": 0.01, "Ro": 0.02, "Rb": 0.02, "Ib": 0.02}


class DirectFit(NamedTuple):
    """One output-error fit, judged with residuals counted as the effective samples that they are."""

    structure: str
    geometry: str  # free, known, or - for entries
    deviance: float  # -2 log likelihood less a constant, over c, plus the prior's part
    bic: float
    converged: bool
    parameters: dict[str, float]


@dataclass(frozen=True)
class KinematicsVerdict:
    """What the recordings say about the kinematics."""

    supported: str | None  # rolling, published, or None: cannot be said
    chi2: dict[str, float]  # by kinematics with the known geometry
    chi2_free: float  # any geometry: the same for both
    evidence: float  # chi2 of published less rolling: above 0 for rolling
    contradicted: bool  # the known geometry does not hold on these recordings
    ratio: dict[str, tuple[float, float]]  # Ro/Rb that data, mb, Ib and Ro-Rb demand, and its standard deviation
    predicted: dict[str, Predicted]  # L2/L1 and K2
    separating: dict[str, float]  # expected evidence by measurement
    fits: list[DirectFit]
    growth: float  # c: mean growth of variance by coloured residuals
    effective_samples: float
    words: list[str] = field(default_factory=list)


def known_from(device: Mapping[str, float], relative_sd: Mapping[str, float] = MEASURED) -> tuple[Known, ...]:
    """The device's measured values as known quantities."""
    return tuple(Known(name, device[name], sd) for name, sd in relative_sd.items() if name in device)


def fit_entries(runs: Sequence[Run], device: Mapping[str, float]) -> Solution:
    """The eight entries from runs in which hoop and ball move, the better of two searches.

    They start from the device's entries under each kinematics: from the wrong one a long free run may end elsewhere.
    """
    geometry = {name: device[name] for name in ("mb", "Ro", "Rb", "g")}
    found = [
        fit_output_error("entries", geometry | entries_of(kind, device), ENTRIES, runs, priors={})
        for kind in KINEMATICS
    ]
    return min(found, key=_likelihood)


def _likelihood(solution: Solution) -> float:
    """-2 log L = sum_c n_c log sigma_c^2, less a constant."""
    count = {name: sum(len(run[name]) for run in solution.residuals if name in run) for name in solution.sigma}
    return sum(n * 2 * float(np.log(solution.sigma[name])) for name, n in count.items())


def compare_kinematics(
    runs: Sequence[Run],
    device: Mapping[str, float],
    *,
    known: Sequence[Known] | None = None,
    entries: Solution | None = None,
    direct: bool = True,
    progress: Progress = lambda text: None,
) -> KinematicsVerdict:
    """Verdict from recordings; `device`: physical parameters as measured or guessed, `known`: which of them, how well.

    `known`=() when nothing is measured; `direct`=False leaves the direct fits out. ValueError without a run in which
    both move.
    """
    runs = [run for run in runs if run.moving == "both"]
    if not runs:
        raise ValueError("kinematics need a recording in which both hoop and ball move")
    known = known_from(device) if known is None else tuple(known)
    solution = entries or fit_entries(runs, device)
    found = uncertainty(solution)
    verdict = judge(solution, found, device, known)
    if not direct:
        return verdict
    fits = _direct_fits(runs, device, known, solution, found, progress)
    return _with_fits(verdict, fits, known)


def judge(
    solution: Solution, found: Uncertainty, device: Mapping[str, float], known: Sequence[Known]
) -> KinematicsVerdict:
    """Verdict from fitted entries and their covariance alone."""
    e = {name: solution.values[name] for name in ENTRIES}
    c = entries_covariance(solution, found)
    wide = tuple(Known(name, device[name], sd) for name, sd in PRIOR.items())
    free = minimum_chi2("rolling", e, c, device, ())
    chi2 = {kind: minimum_chi2(kind, e, c, device, known) for kind in KINEMATICS}
    evidence = chi2["published"] - chi2["rolling"]
    contradicted = bool(chdtrc(max(len(known), 1), max(min(chi2.values()) - free, 0.0)) < CONTRADICTED)
    best = min(chi2, key=lambda kind: chi2[kind])
    supported = best if known and abs(evidence) > DECISIVE and not contradicted else None
    truth = physical_from_entries("rolling", e, device, covariance=c, known=wide, starts=STARTS).parameters
    growth = float(np.trace(found.covariance @ found.information)) / len(solution.names)
    samples = sum(len(one) for run in solution.residuals for one in run.values())
    verdict = KinematicsVerdict(
        supported=supported,
        chi2=chi2,
        chi2_free=free,
        evidence=evidence,
        contradicted=contradicted,
        ratio=_ratios(e, c, device, known),
        predicted=predicted_figures(e, c, truth),
        separating=separating(c, truth),
        fits=[],
        growth=growth,
        effective_samples=samples / max(growth, 1.0),
    )
    verdict.words.extend(_words(verdict, known))
    return verdict


def entries_covariance(solution: Solution, found: Uncertainty) -> Array:
    """(8, 8) of the entries in SI units in the order of `ENTRIES`."""
    order = [solution.names.index(name) for name in ENTRIES]
    slope = solution.scale.derivative(solution.z)
    return np.asarray((found.covariance * np.outer(slope, slope))[np.ix_(order, order)])


# ---------------------------------------------------------------------------------------------- parts


def _ratios(
    e: Mapping[str, float], c: Array, device: Mapping[str, float], known: Sequence[Known]
) -> dict[str, tuple[float, float]]:
    """Ro/Rb by kinematics when only mb, Ib and Ro-Rb are taken as known."""
    by_name = {one.name: one for one in known}
    some = [by_name[name] for name in ("mb", "Ib", "Ih") if name in by_name]
    if "Ro" in by_name and "Rb" in by_name:
        some.append(Known("Ro-Rb", by_name["Ro"].value - by_name["Rb"].value, by_name["Ro"].relative_sd))
    if not some:
        return {}
    out = {}
    for kind in KINEMATICS:
        fit = physical_from_entries(kind, e, device, covariance=c, known=some, starts=STARTS)
        ratio = quantity(kind, "Ro/Rb", fit.parameters)
        out[kind] = (ratio, ratio * quantity_sd(fit, "Ro/Rb"))
    return out


def _direct_fits(
    runs: Sequence[Run],
    device: Mapping[str, float],
    known: Sequence[Known],
    solution: Solution,
    found: Uncertainty,
    progress: Progress,
) -> list[DirectFit]:
    growth = max(float(np.trace(found.covariance @ found.information)) / len(solution.names), 1.0)
    e, c = {name: solution.values[name] for name in ENTRIES}, entries_covariance(solution, found)
    wide = tuple(Known(name, device[name], sd) for name, sd in PRIOR.items())
    narrow = {one.name: one for one in known if one.name in PRIOR}
    tight = tuple(narrow.get(one.name, one) for one in wide)
    fits = [_scored(solution, "entries", "-", growth)]
    for kind in KINEMATICS:
        for geometry, beliefs in (("free", wide), ("known", tight)) if narrow else (("free", wide),):
            progress(f"{kind}, geometry {geometry}")
            start = physical_from_entries(kind, e, device, covariance=c, known=beliefs, starts=STARTS).parameters
            priors = {one.name: Prior(one.value, one.relative_sd) for one in beliefs}
            fits.append(
                _scored(fit_output_error(kind, start, PHYSICAL["both"], runs, priors=priors), kind, geometry, growth)
            )
    return fits


def _scored(solution: Solution, structure: str, geometry: str, growth: float) -> DirectFit:
    """-2 log L over c, plus the prior; penalty k log(n/c)."""
    samples = sum(len(one) for run in solution.residuals for one in run.values())
    deviance = _likelihood(solution) / growth + _prior_part(solution)
    # six combinations whatever the geometry
    size = 8 if structure == "entries" else 6
    bic = deviance + size * float(np.log(samples / growth))
    return DirectFit(structure, geometry, deviance, bic, solution.converged, dict(solution.values))


def _prior_part(solution: Solution) -> float:
    at = solution.scale.coordinates(
        np.array([solution.priors[n].value if n in solution.priors else solution.values[n] for n in solution.names])
    )
    return float((solution.z - at) @ prior_information(solution) @ (solution.z - at))


def _with_fits(verdict: KinematicsVerdict, fits: list[DirectFit], known: Sequence[Known]) -> KinematicsVerdict:
    """The verdict with the direct fits; they must not point the other way."""
    by = {(one.structure, one.geometry): one for one in fits}
    words, supported = list(verdict.words), verdict.supported
    if ("rolling", "known") in by:
        direct = by["published", "known"].deviance - by["rolling", "known"].deviance
        words.append(f"Fitted to the recordings directly with that geometry: evidence {_for(direct)}.")
        # where entries and runs disagree about which is nearer, neither kinematics fits
        if (direct > 0) != (verdict.evidence > 0) and min(abs(direct), abs(verdict.evidence)) > 1.0:
            supported = None
            words.append("That points the other way than the entries: geometry or model is wrong, so no verdict.")
    loose = by["published", "free"].deviance - by["rolling", "free"].deviance
    words.append(f"With geometry free (wide priors): {_for(loose)}.")
    return KinematicsVerdict(**{**vars(verdict), "fits": fits, "words": words, "supported": supported})


# ---------------------------------------------------------------------------------------------- words


def _words(v: KinematicsVerdict, known: Sequence[Known]) -> list[str]:
    said = ", ".join(f"{one.name} = {one.value:.5g} +-{100 * one.relative_sd:.2g} %" for one in known)
    words = []
    if v.supported:
        words.append(f"The recordings support the {v.supported} kinematics, given {said}: evidence {_for(v.evidence)}.")
    else:
        words.append("Geometry and kinematics cannot be separated on these recordings.")
        words.append(_why_not(v, said))
    words += _missing_words(v)
    words += _ratio_words(v, known)
    words += [predicted_words(name, one) for name, one in v.predicted.items()]
    if not v.supported:
        words.append(separating_words(v.separating))
    return words


def _why_not(v: KinematicsVerdict, said: str) -> str:
    if not said:
        return "Nothing of the geometry is known, and Ro/Rb larger by one under rolling gives the same runs."
    if v.contradicted:
        return (
            f"They contradict {said} under both kinematics (chi2 {min(v.chi2.values()):.1f}, free {v.chi2_free:.1f})."
        )
    return f"Given {said} the evidence is {_for(v.evidence)}, below {DECISIVE:g}."


def _missing_words(v: KinematicsVerdict) -> list[str]:
    # eight entries carry six combinations
    if chdtrc(2, v.chi2_free) > MISSING:
        return []
    return [
        f"Whatever the geometry, no parameters give the fitted entries (chi2 {v.chi2_free:.1f} for two constraints): "
        "a force is missing from the model, and the comparison stands on weak ground."
    ]


def _for(evidence: float) -> str:
    side = "rolling" if evidence > 0 else "published"
    return f"{abs(evidence):.1f} for {side} (twice the log-likelihood ratio, coloured residuals counted)"


def _ratio_words(v: KinematicsVerdict, known: Sequence[Known]) -> list[str]:
    if not v.ratio:
        return []
    by = {one.name: one.value for one in known}
    demanded = " and ".join(f"{value:.2f} +-{sd:.2f} under {kind}" for kind, (value, sd) in v.ratio.items())
    end = f"; measured {by['Ro'] / by['Rb']:.2f}" if {"Ro", "Rb"} <= set(by) else ""
    return [f"Without the ball's radius they demand Ro/Rb = {demanded}{end}."]
