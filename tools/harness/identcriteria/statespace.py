"""Criteria of the state-space methods: what each must reach on data of any seed.

Rules of this file: `criterion_NN(seed)` gives measured figures and verdicts (bool); nothing is tuned to a seed.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from harness.identcriteria.statespacesets import fit_percent, made, mimo_set, resonant, responses
from hoopd.ident.data import Data
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import predict
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.projection import WEIGHTINGS
from hoopd.ident.statespace.subspace import subspaceid

Array = NDArray[np.float64]
Verdicts = dict[str, float | bool]


def distance(one: Innovations, other: Innovations) -> float:
    """Most difference of log10 squared gain over 30 frequencies from 1e-3 to pi."""
    w = np.geomspace(1e-3, np.pi, 30)
    a, b = responses(one, w), responses(other, w)
    gains = [np.linalg.norm(g.reshape(len(w), -1), axis=1) for g in (a, b)]
    return float(np.abs(2.0 * np.log10(gains[0]) - 2.0 * np.log10(gains[1])).max())


def _shape(rng: np.random.Generator) -> tuple[int, int, int]:
    return int(rng.integers(1, 6)), int(rng.integers(1, 3)), int(rng.integers(1, 3))


def _output_error(a: Array, rng: np.random.Generator, nu: int, ny: int) -> Innovations:
    nx = len(a)
    b, c = rng.standard_normal((nx, nu)), rng.standard_normal((ny, nx))
    return Innovations(a, b, c, np.zeros((ny, nu)), np.zeros((nx, ny)), 1.0)


def integrators(seed: int) -> tuple[Data, int]:
    """nx 1 to 5 integrators, one with a pole of 1.01, 500 samples, noise 0.1; and nx."""
    rng = np.random.default_rng(seed)
    nx, nu, ny = _shape(rng)
    a = np.eye(nx)
    a[0, 0] = 1.01
    model = _output_error(a, rng, nu, ny)
    return made(model, rng.standard_normal((500, nu)), 0.1 * rng.standard_normal((500, ny))), nx


def small_systems(seed: int, noise: float = 1e-3) -> tuple[Data, Innovations]:
    """A = 0.2 randn, nx 1 to 5, 1 or 2 inputs and outputs, 500 samples."""
    rng = np.random.default_rng(seed)
    nx, nu, ny = _shape(rng)
    model = _output_error(0.2 * rng.standard_normal((nx, nx)), rng, nu, ny)
    return made(model, rng.standard_normal((500, nu)), noise * rng.standard_normal((500, ny))), model


def criterion_15(seed: int) -> Verdicts:
    """Integrators and a pole outside: poles held to 0.99, one-step errors below 1 % of the output's power.

    By all weightings, at the order that the channels can tell and at the full one. Poles 1e-5 above it are let pass, as
    in the source; at the full order 1e-4, ours: states that nothing tells apart give several poles that meet at the
    limit, and rounding moves those by more.
    """
    data, nx = integrators(seed)
    worst, poles = 0.0, {}
    for name, order in (("pole", min(nx, 1 + min(data.nu, data.ny))), ("pole at nx", nx)):
        models = [_quiet(data, order, weighting, stable=0.99) for weighting in WEIGHTINGS]
        worst = max(worst, *(_share(model, data) for model in models))
        poles[name] = max(radius(model.a) for model in models)
    held = poles["pole"] <= 0.99 * (1.0 + 1e-5) and poles["pole at nx"] <= 0.99 * (1.0 + 1e-4)
    return {**poles, "error": worst, "poles held": bool(held), "predicts": worst < 0.01}


def _quiet(data: Data, order: int, weighting: str, **options: float) -> Innovations:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return subspaceid(data, order, weighting=weighting, **options)  # type: ignore[arg-type]


def _share(model: Innovations, data: Data) -> float:
    """Mean squared one-step error over the mean square of the outputs."""
    return float(np.mean((data.y - predict(model, data)) ** 2) / np.mean(data.y**2))


def criterion_16(seed: int) -> Verdicts:
    """Small systems with next to no noise: order, noise level, S, frequency response, automatic order."""
    return _small(seed, ("N4SID",), 1.0)


def criterion_18(seed: int) -> Verdicts:
    """The same by all weightings; automatic order at most two above; S below twice the noise by each (the source allows
    five times by CVA and IVM). Errors below 12 % on integrators with a pole outside that is left where it is."""
    data, nx = integrators(seed)
    worst = max(_share(_quiet(data, nx, weighting), data) for weighting in WEIGHTINGS)
    return _small(seed, WEIGHTINGS, 2.0) | {"integrators": worst, "predicts integrators": worst < 0.12}


def _small(seed: int, weightings: tuple[str, ...], share: float) -> Verdicts:
    data, truth = small_systems(seed)
    worst, far, auto, level = 0.0, 0.0, 0, []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for weighting in weightings:
            model = subspaceid(data, truth.nx, weighting=weighting)  # type: ignore[arg-type]
            assert model.s is not None and model.r is not None
            worst = max(worst, float(np.linalg.norm(model.s)))
            far = max(far, distance(model, truth) / (0.2 * data.nu * data.ny))
            level += np.sqrt(np.diag(model.r)).tolist()
            auto = max(auto, subspaceid(data, weighting=weighting).nx)  # type: ignore[arg-type]
    return {
        "S": worst, "FRT of bound": far, "order above": auto - truth.nx,
        "S small": worst < share * 1e-3, "response": far < 1.0, "automatic order": auto <= truth.nx + 2 * (share > 1),
        "noise within 50 %": bool(np.all(np.abs(np.array(level) - 1e-3) < 0.5e-3)),
    }  # fmt: skip


def criterion_17(seed: int) -> Verdicts:
    """First order, b/(z - a): both within 0.01, frequency response within 0.01; one of the source's hundred cells."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-0.99, 0.99), rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 5.0)
    one = np.ones((1, 1))
    truth = Innovations(a * one, b * one, one, 0 * one, 0 * one, 1.0)
    data = made(truth, rng.standard_normal((500, 1)), 0.01 * rng.standard_normal((500, 1)))
    pole, gain, far = 0.0, 0.0, 0.0
    for weighting in ("N4SID", "MOESP"):
        model = subspaceid(data, 1, weighting=weighting, horizon=20)  # type: ignore[arg-type]
        pole = max(pole, abs(float(model.a[0, 0]) - a))
        gain = max(gain, abs(float(model.c[0, 0] * model.b[0, 0]) - b))
        far = max(far, distance(model, truth))
    return {"a": pole, "b": gain, "FRT": far, "within": max(pole, gain, far) < 0.01}


def criterion_19(seed: int) -> Verdicts:
    """A direct term of 1 beside a slow resonance, no noise: D and static gain to 1e-8."""
    rng = np.random.default_rng(seed)
    base = resonant(0.02)
    truth = Innovations(base.a, base.b, base.c, base.d + 1.0, base.k, base.dt)
    data = made(truth, rng.standard_normal((1000, 1)), np.zeros((1000, 1)))
    model = subspaceid(data, 2, direct=True, scale=True)
    static = [float(np.real(responses(m, np.zeros(1)))[0, 0, 0]) for m in (model, truth)]
    d, g = abs(float(model.d[0, 0]) - 1.0), abs(static[0] / static[1] - 1.0)
    return {"D": d, "static gain": g, "exact": max(d, g) < 1e-8}


def criterion_50(seed: int) -> Verdicts:
    """2 in, 3 out, order 4, 5,000 samples: one-step fit within 0.06 points of the true model."""
    out: Verdicts = {}
    for name, gain in (("mimo4", False), ("mimo4k", True)):
        own, both, truth = mimo_set(seed, gain=gain)
        model = subspaceid(own, 4)
        best, found = (fit_percent(both.y[own.n :], predict(m, both)[own.n :]) for m in (truth, model))
        out |= {f"{name} below the oracle": best - found, f"{name} within 0.06": best - found < 0.06}
    return out
