"""Criteria of prediction error methods: black-box state space, linear and nonlinear grey boxes, static nonlinearities.

Rules of this file: `criterion_NN(seed)` gives measured figures and verdicts (bool); nothing is tuned to a seed.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from harness.identcriteria.statespace import Verdicts, distance
from harness.identcriteria.statespacesets import (
    PITCH,
    TANK,
    TANK_START,
    doyle,
    fit_percent,
    made,
    output_error,
    pair,
    pitch,
    random_model,
    resonant3,
    responses,
    tank_data,
    tank_levels,
    tank_step,
)  # fmt: skip
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import predict, prediction_error, simulate
from hoopd.ident.statespace.hammersteinwiener import hammerstein_wiener
from hoopd.ident.statespace.linear import states
from hoopd.ident.statespace.nonlinear import nonlinear_pem
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.similarity import similarity_transform
from hoopd.ident.statespace.structured import structured_pem
from hoopd.ident.statespace.subspace import subspaceid
from hoopd.ident.statespace.uncertainty import pole_covariance, response_covariance

Array = NDArray[np.float64]


def _third(
    seed: int, into: float, out: float, *, size: float = 1.0, coloured: bool = False
) -> tuple[Data, Innovations]:
    """The third-order resonance, 1,000 samples, noise at the input and at the output; the model holds its x0."""
    rng = np.random.default_rng(seed)
    truth = resonant3()
    u = size * rng.standard_normal((1000, 1))
    noise = out * rng.standard_normal((1, 1000))
    noise = states(np.array([[0.6]]), 0.8 * noise) if coloured else noise
    driven, x0 = u + into * rng.standard_normal((1000, 1)), rng.standard_normal(3)
    clean = made(truth, driven, np.zeros((1000, 1)), x0)
    return iddata(clean.y + noise.T, u), replace(truth, x0=x0)


def _cost(model: Innovations, data: Data, horizon: int = 1) -> float:
    return float(np.nansum(prediction_error(model, data, horizon) ** 2))


def _quiet(data: Data, order: int, **options: object) -> Innovations:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pem(data, order, **options)  # type: ignore[arg-type]


def criterion_23(seed: int) -> Verdicts:
    """Next to no noise: response and cost, one and two steps ahead."""
    data, truth = _third(seed, 0.0, 1e-6)
    one, two = _quiet(data, 3), _quiet(data, 3, horizon=2)
    far, far2 = distance(one, truth), distance(two, truth)
    cost = max(_cost(one, data), _cost(two, data, 2))
    return {"FRT": far, "FRT h 2": far2, "cost": cost, "near": far < 1e-2 and far2 < 1.0, "cheap": cost < 0.1}


def criterion_24(seed: int) -> Verdicts:
    """Coloured measurement noise of 0.1: cost below 2 s^2 T = 20."""
    data, _ = _third(seed, 0.0, 0.1, coloured=True)
    cost = _cost(_quiet(data, 3), data)
    return {"cost": cost, "cheap": cost < 20.0}


def criterion_25(seed: int) -> Verdicts:
    """Input noise of 0.1."""
    data, truth = _third(seed, 0.1, 0.0)
    model = _quiet(data, 3)
    cost, far = _cost(model, data), distance(model, truth)
    return {"cost": cost, "FRT": far, "cheap": cost < 1.0, "near": far < 0.5}


def criterion_26(seed: int) -> Verdicts:
    """Simulation focus, an order too many, input times ten: fit, response; without K prediction is simulation."""
    data, truth = _third(seed, 0.02, 0.02, size=10.0)
    model = _quiet(data, 4, focus="simulation")
    e = data.y - simulate(model, data, model.x0)
    fit = 100.0 * (1.0 - float(np.linalg.norm(e) / np.linalg.norm(data.y - data.y.mean())))
    w = np.geomspace(1e-3, np.pi, 50)
    far = float(np.abs(responses(model, w) - responses(truth, w)).max())
    same = float(np.abs(predict(model, data, 10, model.x0) - simulate(model, data, model.x0)).max())
    cost = float(np.sum(e**2))
    return {
        "fit": fit,
        "model error": far,
        "cost": cost,
        "good": fit > 50.0 and far < 0.1 and cost < 0.8,
        "no gain": same < 1e-9,
    }


def criterion_27(seed: int) -> Verdicts:
    """Simulation focus: the initial output within 0.3 of the true one."""
    data, truth = _third(seed, 0.01, 0.01)
    model = _quiet(data, 3, focus="simulation")
    assert model.x0 is not None and truth.x0 is not None
    off = float(np.abs(model.c @ model.x0 - truth.c @ truth.x0).max())
    cost = float(np.sum((data.y - simulate(model, data, model.x0)) ** 2))
    return {"C x0": off, "cost": cost, "near": off < 0.3 and cost < 10.0}


def criterion_28(seed: int) -> Verdicts:
    """Poles on the circle, 2 x 2, noise 0.1: cost, response, fit to the output without noise; D or not, h 1 and 3.

    Errors below half of the noise beside the fit of 97 % (96 % with D), ours: the level of this output differs by seed.
    """
    rng = np.random.default_rng(seed)
    truth = doyle()
    u = rng.standard_normal((1000, 2))
    clean = made(truth, u, np.zeros((1000, 2)))
    data = iddata(clean.y + 0.1 * rng.standard_normal((1000, 2)), u, 0.01)
    worst, far, off, spare = 0.0, 0.0, 0.0, 100.0
    for direct, horizon in ((False, 1), (False, 3), (True, 1)):
        model = _quiet(data, 2, direct=direct, horizon=horizon)
        said = predict(model, data)
        worst = max(worst, _cost(model, data, horizon))
        far = max(far, distance(model, truth))
        off = max(off, float(np.sqrt(np.mean((said - clean.y) ** 2))))
        spare = min(spare, float(np.mean(fit_percent(clean.y, said))) - (96.0 if direct else 97.0))
    return {
        "cost": worst, "FRT": far, "error over noise": off / 0.1, "fit above the bound": spare,
        "cheap": worst < 30.0, "near": far < 0.4, "within": off < 0.05, "fits": spare > 0.0,
    }  # fmt: skip


def criterion_29(seed: int) -> Verdicts:
    """Innovation model 2 x 2 of order 3, 10,000 samples: A and K after a transform, by subspace and PEM."""
    rng = np.random.default_rng(seed)
    base = random_model(rng, 3, 2, 2)
    k = 0.3 * rng.standard_normal((3, 2))
    while np.abs(np.linalg.eigvals(base.a - k @ base.c)).max() > 0.95:
        k *= 0.7
    truth = replace(base, d=0.0 * base.d, k=k)
    data = made(truth, rng.standard_normal((10_000, 2)), 0.1 * rng.standard_normal((10_000, 2)))
    out: Verdicts = {}
    for name, model in (("subspace", subspaceid(data, 3)), ("PEM", pem(data, 3))):
        own = model.transformed(similarity_transform(model, truth))
        far = [float((np.abs(a - b) / (0.2 + 0.2 * np.abs(b))).max()) for a, b in ((own.a, truth.a), (own.k, truth.k))]
        out |= {f"A {name}": far[0], f"K {name}": far[1], f"{name} within": max(far) < 1.0}
    return out


def criterion_30(seed: int) -> Verdicts:
    """Offset at the input, absolute value and offset at the output, from 200 samples and at most 50 starts.

    By simulation and, the gain too, by prediction from there (the source tries two optimisers, we have one): what the
    search with that focus does as well, without its 50 starts again.
    """
    rng = np.random.default_rng(seed)
    truth = resonant3()
    u = rng.standard_normal((200, 1))

    def into(signal: Array, p: Array) -> Array:
        return signal + p[0]

    def out(signal: Array, p: Array) -> Array:
        return np.abs(signal) + p[1]

    x = states(truth.a, truth.b @ into(u.T, np.ones(2)))
    data = iddata(out(truth.c @ x, np.ones(2)).T, u)
    w, figures = np.geomspace(1e-3, np.pi, 50), {}
    found = hammerstein_wiener(data, 3, [0.9, 0.9], input_map=into, output_map=out, starts=50, seed=seed)
    predicted = hammerstein_wiener(
        data, 3, found.p, input_map=into, output_map=out, start=found.linear, starts=1, focus="prediction"
    )  # fmt: skip
    for focus, model in (("simulation", found), ("prediction", predicted)):
        mine, theirs = responses(model.linear, w), responses(truth, w)
        far = float(min(np.abs(mine - theirs).max(), np.abs(mine + theirs).max()))
        off, cost = float(np.abs(model.p - 1.0).max()), model.cost * 200
        figures |= {f"response {focus}": far, f"p {focus}": off, f"cost {focus}": cost}
        figures[f"{focus} found"] = far < 1.0 and off < 0.1 and cost < 1.0
    return figures


def criterion_31(seed: int) -> Verdicts:
    """Aircraft pitch, 6 parameters 20 % off either way, no noise: exact by both focuses within 300 iterations."""
    rng = np.random.default_rng(seed)
    truth = output_error(pitch(PITCH), 0.05)
    u = np.repeat(rng.standard_normal((101, 1)), 10, axis=0)[:1001]
    data = made(truth, u, np.zeros((1001, 2)))
    start = PITCH * (1.0 + 0.2 * rng.choice([-1.0, 1.0], 6))
    off, most = 0.0, 0
    for focus in ("prediction", "simulation"):
        found = structured_pem(data, pitch, start, focus=focus)  # type: ignore[arg-type]
        off = max(off, float(np.linalg.norm(np.array(list(found.parameters.values())) - PITCH)))
        most = max(most, found.evaluations)
    return {"off": off, "evaluations": most, "exact": off < 1e-6, "soon": most <= 300}


def criterion_32(seed: int) -> Verdicts:
    """Four tanks, 1,101 samples, x0 halved, measurement covariance 100 times: nearer the truth; a restart is no worse.

    Each parameter within 2 %, ours: to be nearer than the guess says little. A prior of weight 1e4 beside the
    errors keeps the parameters within 1 % of the way to the truth. Infinite initial states, and initial states of
    infinite covariance, are refused with their names.
    """
    data = tank_data(seed)
    guess, truth = np.array([1.4, 1.4, 5.1, 0.25]), TANK
    options = {"process": 1e-4, "measurement": 1e-2, "spread": 1.0, "bounds": (0.01, 10.0)}
    one = nonlinear_pem(data, tank_step, tank_levels, guess, TANK_START / 2.0, **options)  # type: ignore[arg-type]
    again = nonlinear_pem(
        data, tank_step, tank_levels, one.p, one.starts[0], process=1e-6, measurement=1e-4, spread=1e-2
    )  # fmt: skip
    off = [float(np.abs(m.p / truth - 1.0).max()) for m in (one, again)]
    nearer = float(np.linalg.norm(one.p - truth) / np.linalg.norm(guess - truth))
    start = float(np.linalg.norm(one.starts[0] - TANK_START) / np.linalg.norm(TANK_START / 2.0))
    z = (again.p - truth) / np.sqrt(np.diag(again.covariance))[:4]
    way = _way(data, guess, options)
    return {
        "off": off[0], "off again": off[1], "p of the guess": nearer, "x0 of the guess": start, "way": way,
        "z": float(np.abs(z).max()), "within 2 %": max(off) < 0.02, "p nearer": nearer < 1.0, "x0 nearer": start < 1.0,
        "no worse": again.cost <= one.cost * 1.001, "interval": bool(np.abs(z).max() < 4.0), "prior holds": way < 0.01,
        "infinite start": _refused(data, np.full(4, np.inf), {}, "finite"),
        "infinite spread": _refused(data, TANK_START / 2.0, {"spread": np.inf}, "spread"),
    }  # fmt: skip


def _way(data: Data, guess: Array, options: dict[str, Any]) -> float:
    """How far a prior lets the parameters go, of the way from the guess to the truth.

    1e4 (p - p0) beside errors not divided by their deviations: a prior of 1e-4 of the measurement's. With 1e4 as the
    weight of the squares they go 0.0102 of the way.
    """
    held = np.sqrt(options["measurement"]) / 1e4
    model = nonlinear_pem(data, tank_step, tank_levels, guess, TANK_START / 2.0, prior=held, **options)
    return float(np.linalg.norm(model.p - guess) / np.linalg.norm(TANK - guess))


def _refused(data: Data, x0: Array, more: dict[str, float], word: str) -> bool:
    try:
        nonlinear_pem(data, tank_step, tank_levels, TANK, x0, process=1e-4, measurement=1e-2, **more)  # type: ignore[arg-type]
    except ValueError as error:
        return word in str(error)
    return False


def criterion_51(seed: int) -> Verdicts:
    """Intervals of the frequency response and of the poles by PEM hold the truth as often as they say."""
    rng = np.random.default_rng(seed)
    truth = Innovations(
        pair(0.9, 0.5), np.eye(2)[:, :1], np.array([[1.0, 0.5]]), np.zeros((1, 1)), np.array([[0.4], [0.1]]), 1.0
    )
    data = made(truth, rng.standard_normal((1000, 1)), 0.5 * rng.standard_normal((1000, 1)))
    model = pem(data, 2)
    w = np.array([0.1, 0.5, 1.5])
    off = (responses(model, w) - responses(truth, w))[:, 0, 0]
    parts = np.stack([off.real, off.imag], axis=1)
    square = np.einsum("wi,wij,wj->w", parts, np.linalg.inv(response_covariance(model, w)[:, 0, 0]), parts)
    poles, spread = pole_covariance(model)
    upper = int(np.argmax(poles.imag))
    step = poles[upper] - 0.9 * np.exp(0.5j)
    pole = np.array([step.real, step.imag])
    distance_square = float(pole @ linalg.solve(spread[upper], pole))
    return {
        "response": float(square.mean()), "pole": distance_square,
        "response inside 95 %": bool(square[1] < 5.99), "pole inside 95 %": distance_square < 5.99,
    }  # fmt: skip
