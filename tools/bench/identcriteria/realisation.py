"""Criteria of realisations: impulse and frequency responses, initial states, transforms, sampling.

Rules of this file: `criterion_NN(seed)` gives measured figures and verdicts (bool); nothing is tuned to a seed.
"""

from __future__ import annotations

from dataclasses import replace

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy import integrate, linalg

from hoopd.ident.models import Innovations
from hoopd.ident.prediction import estimate_x0, prediction_error, simulate
from hoopd.ident.statespace import sampling, similarity
from hoopd.ident.statespace.era import era, era_of_data
from hoopd.ident.statespace.frequencysubspace import Known, frequency_subspace
from hoopd.ident.statespace.okid import okid
from hoopd.ident.statespace.stabilise import stabilise
from hoopd.ident.statespace.subspace import subspaceid
from identcriteria.statespace import Verdicts, distance, small_systems
from identcriteria.statespacesets import made, random_model, responses

Array = NDArray[np.float64]


def markov(model: Innovations, count: int) -> Array:
    """D, C B, C A B, ... (count + 1, ny, nu)."""
    blocks, power = [model.d], model.b
    for _ in range(count):
        blocks.append(model.c @ power)
        power = model.a @ power
    return np.array(blocks)


def criterion_20(seed: int) -> Verdicts:
    """OKID without noise, from rest: impulse response to 2e-2 with one row dropped, 1e-10 with all; ERA to 1e-4."""
    data, truth = small_systems(seed, noise=0.0)
    wanted = markov(truth, 20)
    one, whole = (float(np.linalg.norm(okid(data, 20, drop=p) - wanted)) for p in (1, 20))
    far = distance(era_of_data(data, truth.nx), truth)
    return {
        "drop 1": one,
        "drop 20": whole,
        "ERA": far,
        "impulse": one < 2e-2 and whole < 1e-10,
        "response": far < 1e-4,
    }


def criterion_21(seed: int) -> Verdicts:
    """ERA of five noisy sets is ERA of the averaged impulse responses, and is near the system."""
    rng = np.random.default_rng(seed)
    system = ct.sample_system(ct.ss(ct.tf([1.0], [1.0, 1.0, 1.0])), 0.1)
    truth = Innovations(system.A, system.B, system.C, system.D, np.zeros((2, 1)), 0.1)
    sets = [made(truth, rng.standard_normal((1000, 1)), 0.2 * rng.standard_normal((1000, 1))) for _ in range(5)]
    one = era_of_data(sets, 2, lags=100, rows=50, columns=50, ridge=1.0, curvature=1.0)
    mean = np.mean([okid(d, 100, ridge=1.0, curvature=1.0) for d in sets], axis=0)
    other = era(mean, 2, dt=0.1, rows=50, columns=50)
    w = np.geomspace(0.01, np.pi, 50)
    same = float(np.abs(responses(one, w) - responses(other, w)).max())
    far = float(np.linalg.norm(responses(one, w) - responses(truth, w)) / np.linalg.norm(responses(truth, w)))
    return {"difference": same, "off": far, "equal": same < 1e-10, "near": far < 0.3}


def criterion_22(seed: int) -> Verdicts:
    """Frequency subspace on exact data: response, spectra with a transient, and parts of the model given."""
    rng = np.random.default_rng(seed)
    dt, w = 0.1, np.linspace(0.01, np.pi, 200)
    truth = random_model(rng, 4, 2, 3, dt=dt)
    worst, norm = 0.0, 0.0
    for model, direct in ((truth, True), (replace(truth, d=0.0 * truth.d), False)):
        g = responses(model, w)
        norm = max(norm, float(np.abs(g).max()))
        found = frequency_subspace(w / dt, g, dt=dt, order=4, direct=direct)
        u = rng.standard_normal((200, 3))
        data = made(model, u, np.zeros((200, 2)), rng.standard_normal(4))
        spectra = [np.fft.rfft(one, axis=0) / np.sqrt(200) for one in (data.y, u)]
        of_spectra = frequency_subspace(
            2.0 * np.pi * np.fft.rfftfreq(200, dt), *spectra, dt=dt, order=4, direct=direct
        )  # fmt: skip
        worst = max([worst, *(float(np.abs(responses(m, w) - g).max()) for m in (found, of_spectra))])
    g = responses(truth, w)
    rest = frequency_subspace(w / dt, g, dt=dt, known=Known(a=truth.a, c=truth.c))
    seen = frequency_subspace(w / dt, g, dt=dt, known=Known(a=truth.a, b=truth.b))
    given = max(float(np.abs(rest.b - truth.b).max()), float(np.abs(seen.c - truth.c).max()))
    return {"response": worst / norm, "given": given, "exact": worst < 1e-11 * norm, "rest exact": given < 1e-12}


def criterion_33(seed: int) -> Verdicts:
    """Initial state from 8 of 100 samples, exact; simulation from it too."""
    rng = np.random.default_rng(seed)
    truth = random_model(rng, 4, 2, 3)
    x0 = rng.standard_normal(4)
    data = made(truth, rng.standard_normal((100, 3)), np.zeros((100, 2)), x0)
    found = estimate_x0(truth, data, samples=8)
    off = float(np.linalg.norm(found - x0) / np.linalg.norm(x0))
    run = float(np.abs(simulate(truth, data, found) - data.y).max())
    return {"x0": off, "simulation": run, "exact": off < 1e-10 and run < 1e-8}


def criterion_34(seed: int) -> Verdicts:
    """Two routes to the prediction errors agree: the predictor, and the data less the prediction of its system."""
    rng = np.random.default_rng(seed)
    data = made(random_model(rng, 6, 2, 3), rng.standard_normal((300, 3)), 0.1 * rng.standard_normal((300, 2)))
    model = subspaceid(data, 6, horizon=8)
    e = prediction_error(model, data)
    driven = ct.forced_response(model.predictor, T=np.arange(300.0), U=np.vstack([data.u.T, data.y.T])).outputs.T
    other = data.y - driven
    early, late = float(np.mean((e - other) ** 2)), float(np.mean((e - other)[100:] ** 2))
    return {"all": early, "settled": late, "agree": late < 1e-5 * float(np.mean(data.y**2))}


def _noisy(rng: np.random.Generator) -> Innovations:
    """A model with Q, R, S and their gain."""
    base = random_model(rng, 4, 2, 2, radius=0.9, dt=0.1)
    a = linalg.expm(0.1 * (base.a - 1.2 * np.eye(4)))
    root = rng.standard_normal((6, 6))
    whole = root @ root.T
    q, s, r = whole[:4, :4], whole[:4, 4:], whole[4:, 4:]
    p = linalg.solve_discrete_are(a.T, base.c.T, q, r, s=s)
    k = np.linalg.solve(base.c @ p @ base.c.T + r, (a @ p @ base.c.T + s).T).T
    return replace(base, a=a, k=k, q=q, r=r, s=s)


def criterion_35(seed: int) -> Verdicts:
    """K, Q, R, S through balancing, a transform and sampling: observer poles, the noise model, there and back."""
    rng = np.random.default_rng(seed)
    model = _noisy(rng)
    turned = model.transformed(rng.standard_normal((4, 4)))
    balanced, _ = similarity.balanced(model)
    poles = max(_pole_distance(model, other) for other in (turned, balanced))
    w = np.linspace(0.1, 3.0, 20)
    noise = max(float(np.abs(_noise(model, w) - _noise(other, w)).max()) for other in (turned, balanced))
    t = similarity.similarity_transform(model, turned)
    back = float(np.abs(model.transformed(t).k - turned.k).max())
    again = sampling.sampled(sampling.unsampled(model), model.dt)
    assert again.q is not None and model.q is not None
    trip = max(float(np.abs(again.k - model.k).max()), float(np.abs(again.q - model.q).max()))
    scale = 1.0 + float(np.abs(turned.k).max())
    return {
        "poles": poles, "noise model": noise, "K": back / scale, "round trip": trip,
        "exact": poles < 1e-6 and noise < 1e-6 and back < 1e-5 * scale and trip < 1e-6,
    }  # fmt: skip


def _pole_distance(one: Innovations, other: Innovations) -> float:
    mine, theirs = (np.linalg.eigvals(m.a - m.k @ m.c) for m in (one, other))
    return float(max(np.abs(theirs - p).min() for p in mine))


def _noise(model: Innovations, w: Array) -> NDArray[np.complex128]:
    return responses(replace(model, b=model.k, d=np.eye(model.ny)), w)


def criterion_36(seed: int) -> Verdicts:
    """The cost of a held input and the covariance of a step, against quadrature."""
    rng = np.random.default_rng(seed)
    a, b, dt = rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), 0.3
    root = rng.standard_normal((5, 5))
    w = root @ root.T
    q, r, s = sampling.sampled_cost(a, b, w[:3, :3], w[3:, 3:], dt, w[:3, 3:])
    f = np.zeros((5, 5))
    f[:3, :3], f[:3, 3:] = a, b
    cost = integrate.quad_vec(lambda t: linalg.expm(f * t).T @ w @ linalg.expm(f * t), 0.0, dt, epsabs=1e-12)[0]
    noise = integrate.quad_vec(lambda t: linalg.expm(a * t) @ w[:3, :3] @ linalg.expm(a * t).T, 0.0, dt, epsabs=1e-12)[
        0
    ]
    off = float(np.abs(np.block([[q, s], [s.T, r]]) - cost).max())
    step = float(np.abs(sampling.sampled_noise(a, w[:3, :3], dt) - noise).max())
    return {"cost": off, "noise": step, "exact": max(off, step) < 1e-6}


def criterion_37(seed: int) -> Verdicts:
    """Poles 1.1, 0.999, 0.5, 0 become 0.9, 0.99, 0.5, 0 in any basis."""
    t = np.random.default_rng(seed).standard_normal((4, 4))
    a = t @ np.diag([1.1, 0.999, 0.5, 0.0]) @ np.linalg.inv(t)
    poles = np.sort(np.linalg.eigvals(stabilise(a)).real)
    off = float(np.abs(poles - [0.0, 0.5, 0.9, 0.99]).max())
    return {"off": off, "exact": off < 1e-7}


def criterion_41(seed: int) -> Verdicts:
    """Two resonances, 10 and 20 rad/s (damping 0.02), seen through a band about the first: its poles within 5 %."""
    rng = np.random.default_rng(seed)
    parts = [ct.tf([w * w], [1.0, 0.04 * w, w * w]) for w in (10.0, 20.0)]
    system = ct.sample_system(ct.ss(parts[0] + parts[1]), 0.05)
    truth = Innovations(system.A, system.B, system.C, system.D, np.zeros((system.nstates, 1)), 0.05)
    data = made(truth, rng.standard_normal((2000, 1)), np.zeros((2000, 1)))
    w = 2.0 * np.pi * np.fft.rfftfreq(2000, 0.05)
    band = (w > 5.0) & (w < 14.0)
    y, u = (np.fft.rfft(one, axis=0)[band] / np.sqrt(2000) for one in (data.y, data.u))
    model = frequency_subspace(w[band], y, u, dt=0.05, order=2, horizon=20)
    true = np.exp(0.05 * 10.0 * complex(-0.02, np.sqrt(1.0 - 0.02**2)))
    off = float(np.abs(np.linalg.eigvals(model.a) - true).min())
    inside = np.linspace(9.0, 11.0, 40) * 0.05
    gain = np.abs(np.log(np.abs(responses(model, inside)) / np.abs(responses(truth, inside))))
    return {
        "pole": off,
        "log gain": float(np.quantile(gain, 0.9)),
        "within": off < 0.05,
        "gain": bool(np.quantile(gain, 0.9) < 1.0),
    }
