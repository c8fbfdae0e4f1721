"""What others would do with the same recordings: nothing, a re-fit, i.i.d.-BIC selection, sparse regression.

Rules of this file: each rival gets the files of a case and says a verdict and names, like a diagnosis; small on
purpose, and honest: no threshold is turned so that it looks bad. u, theta, dtheta, psi in N m, rad, rad/s, rad.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from concealed.library import FORCES, SENSORS, Sample, forces_of
from concealed.plant import SAMPLE_S, Array
from concealed.windows import Columns, candidates, fit_base, score_candidates

Said = dict[str, Any]
TRAINING = ("train_1.csv", "train_2.csv")
MOST = 3  # names of one case
SMOOTH_ROWS, SMOOTH_ORDER = 11, 3  # of the Savitzky-Golay filter
SHARES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # of the acceleration's rms: thresholds that the hold-out chooses from
Part = tuple[Sample, Array]


def read(data: bytes) -> dict[str, Array]:
    """Columns of a recording by name."""
    lines = data.decode().splitlines()
    table = np.array([[float(cell) if cell else np.nan for cell in line.split(",")] for line in lines[1:]])
    return dict(zip(lines[0].split(","), table.T, strict=True))


def nominal(files: Mapping[str, bytes]) -> Said:
    """The nominal model is always right."""
    return {"verdict": "consistent", "effects": []}


def refit(files: Mapping[str, bytes]) -> Said:
    """It is always the parameters."""
    return {"verdict": "parameters", "effects": []}


def bic(files: Mapping[str, bytes]) -> Said:
    """Forward selection on simulation error by BIC, residuals taken as independent."""
    fit = fit_base([read(files[name]) for name in TRAINING])
    given, chosen = candidates(fit), list[str]()
    while len(chosen) < MOST and (best := _best_by_bic(given, fit.count, chosen)):
        chosen.append(best)
    return _said(chosen)


def _best_by_bic(given: Columns, n: int, chosen: list[str]) -> str | None:
    """The candidate that lowers BIC most beside those chosen; None when none lowers it."""
    scores = score_candidates(given, chosen)
    before = scores.pop("")
    # BIC = n log(RSS/n) + k log n
    gains = {
        name: n * np.log(before.rss / one.rss) - (one.columns - before.columns) * np.log(n)
        for name, one in scores.items()
    }
    best = max(gains, key=lambda name: gains[name])
    return best if gains[best] > 0 else None


def sparse(files: Mapping[str, bytes]) -> Said:
    """Sequentially thresholded least squares on accelerations of smoothed states, threshold by the hold-out."""
    parts, test = [_smoothed(read(files[name])) for name in TRAINING], [_smoothed(read(files["holdout.csv"]))]
    found: dict[str, float] = {}
    for axis in (0, 1):
        tried = [_stlsq(parts, axis, share) for share in SHARES]
        best = min(tried, key=lambda model: _miss(model, test, axis))
        for name, share in best.shares.items():
            found[name] = max(found.get(name, 0.0), share)
    return _said(sorted(found, key=lambda name: -found[name])[:MOST])


def _smoothed(table: Mapping[str, Array]) -> Part:
    """States and accelerations (2, rows) from a local cubic; missing psi is interpolated."""
    index, there = np.arange(len(table["t"])), np.isfinite(table["psi"])
    psi = np.interp(index, index[there], table["psi"][there])

    def local(x: Array, order: int) -> Array:
        return savgol_filter(x, SMOOTH_ROWS, SMOOTH_ORDER, deriv=order, delta=SAMPLE_S)

    theta = table["theta"]
    # a held torque acts on the smoothed middle like the mean of its two neighbours
    u = (table["u"] + np.roll(table["u"], 1)) / 2
    sample = Sample(local(theta, 0), local(theta, 1), local(psi, 0), local(psi, 1), u, np.gradient(u))
    return sample, np.stack((local(theta, 2), local(psi, 2)))


@dataclass(frozen=True)
class Sparse:
    """One equation: weights of base and surviving candidates, whose share of the acceleration's rms is told."""

    weights: Array
    shares: Mapping[str, float]


def _stlsq(parts: Sequence[Part], axis: int, least: float) -> Sparse:
    """Drops candidates below `least` of the acceleration's rms until none is; the base terms always stay."""
    y, alive = np.concatenate([a[axis] for _, a in parts]), list(FORCES)
    while True:
        matrix, places = _matrix(parts, alive)
        weights = np.linalg.lstsq(matrix, y, rcond=1e-10)[0]
        shares = {name: float((matrix[:, at] @ weights[at]).std() / y.std()) for name, at in places.items()}
        small = [name for name in alive if shares[name] < least]
        if not small:
            return Sparse(weights, shares)
        alive = [name for name in alive if name not in small]


def _matrix(parts: Sequence[Part], names: Sequence[str]) -> tuple[Array, dict[str, slice]]:
    """Regressors of base and candidates, and the columns of each candidate."""
    blocks = [np.concatenate([np.column_stack((s.dtheta, s.dpsi, np.sin(s.psi), s.u)) for s, _ in parts])]
    blocks += [np.concatenate([_columns(name, s) for s, _ in parts]) for name in names]
    ends = np.cumsum([block.shape[1] for block in blocks])
    return np.hstack(blocks), {name: slice(ends[i], ends[i + 1]) for i, name in enumerate(names)}


def _miss(model: Sparse, test: Sequence[Part], axis: int) -> float:
    """Sum of squares of the acceleration on the hold-out."""
    matrix, _ = _matrix(test, list(model.shares))
    return float(((np.concatenate([a[axis] for _, a in test]) - matrix @ model.weights) ** 2).sum())


def _columns(name: str, sample: Sample) -> Array:
    """Regressors of a candidate, whichever axis it acts on."""
    return np.column_stack([on_theta if np.any(on_theta) else on_psi for on_theta, on_psi in forces_of(name, sample)])


def _said(names: list[str]) -> Said:
    return {"verdict": "missing_physics" if names else "parameters", "effects": [{"name": name} for name in names]}


RIVALS: Mapping[str, Callable[[Mapping[str, bytes]], Said]] = {
    "nominal": nominal,
    "re-fit": refit,
    "iid BIC": bic,
    "sparse": sparse,
}
# The names that each can say at all.
KNOWN: Mapping[str, tuple[str, ...]] = {"nominal": (), "re-fit": (), "iid BIC": (*FORCES, *SENSORS), "sparse": FORCES}
