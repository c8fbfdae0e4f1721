"""Criteria of realisations: impulse and frequency responses, initial states, transforms, sampling.

Rules of this file: `criterion_NN(seed)` gives measured figures and verdicts (bool); nothing is tuned to a seed.
"""

from __future__ import annotations

from dataclasses import replace

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy import integrate, linalg

from harness.identcriteria.statespace import Verdicts, distance, small_systems
from harness.identcriteria.statespacesets import made, output_error, random_model, responses
from hoopd.ident.conditioning import predictor_data
from hoopd.ident.data import Data
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import estimate_x0, free_response, prediction_error, simulate
from hoopd.ident.predictor_systems import error_system
from hoopd.ident.statespace import sampling, similarity
from hoopd.ident.statespace.era import era, era_of_data
from hoopd.ident.statespace.frequencysubspace import GivenMatrices, frequency_subspace
from hoopd.ident.statespace.okid import okid
from hoopd.ident.statespace.stabilise import stabilize
from hoopd.ident.statespace.subspace import subspaceid

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
    rest = frequency_subspace(w / dt, g, dt=dt, known=GivenMatrices(a=truth.a, c=truth.c))
    seen = frequency_subspace(w / dt, g, dt=dt, known=GivenMatrices(a=truth.a, b=truth.b))
    given = max(float(np.abs(rest.b - truth.b).max()), float(np.abs(seen.c - truth.c).max()))
    left = max(float(np.sum(np.abs(responses(m, w) - g) ** 2)) for m in (rest, seen))
    return {
        "response": worst, "of the peak": worst / norm, "given": given, "residual": left,
        "exact": worst < 1e-11, "rest exact": given < 1e-12 and left < 2.2e-16,
    }  # fmt: skip


def criterion_33(seed: int) -> Verdicts:
    """Initial state from 8 of 100 samples, exact, by prediction and by simulation, of a model with a gain and without.

    A state that is given comes back as it is and the others are still exact; simulations from all of them too.
    """
    rng = np.random.default_rng(seed)
    plain, x0 = random_model(rng, 4, 2, 3), rng.standard_normal(4)
    data = made(plain, rng.standard_normal((100, 3)), np.zeros((100, 2)), x0)
    known = int(rng.integers(4))
    off, run, kept = 0.0, 0.0, True
    for model in (plain, replace(plain, k=_gain(plain, np.eye(4), np.eye(2), np.zeros((4, 2))))):
        for simulation in (False, True):
            for given in (False, True):
                fixed = np.where(np.arange(4) == known, x0, np.nan) if given else None
                found = estimate_x0(model, data, samples=8, simulation=simulation, fixed=fixed)
                off = max(off, float(np.linalg.norm(found - x0) / np.linalg.norm(x0)))
                run = max(run, float(np.linalg.norm(simulate(model, data, found) - data.y) / np.linalg.norm(data.y)))
                kept = kept and (not given or bool(found[known] == x0[known]))
    return {"x0": off, "simulation": run, "exact": off < 1e-10 and run < 1e-10, "pinned": kept}


def criterion_34(seed: int) -> Verdicts:
    """Two routes to the prediction errors agree: sample by sample, and the filter of the errors from [u; y].

    2 x 3, order 6, 300 samples, with noise and without. To 1e-10 of the outputs at every sample, both from one initial
    state and, the filter from rest, once the predictor's free response to that state is taken off. The source's filter
    is always at rest, hence its bounds of 0.01, and of 1e-5 past the first nx samples: how fast the start is forgotten
    depends on the system and not on the routes, so nothing is left to it here.
    """
    rng = np.random.default_rng(seed)
    truth = random_model(rng, 6, 2, 3)
    u, e, x0 = rng.standard_normal((300, 3)), rng.standard_normal((300, 2)), rng.standard_normal(6)
    same, rest = 0.0, 0.0
    for share in (0.1, 0.0):
        data = made(truth, u, share * e, x0)
        model = subspaceid(data, 6, horizon=8)
        start, level = estimate_x0(model, data), float(np.sqrt(np.mean(data.y**2)))
        one = prediction_error(model, data, x0=start)
        free = free_response(model.c, model.a - model.k @ model.c, data.n) @ start
        same = max(same, float(np.abs(_filtered(model, data, start) - one).max()) / level)
        rest = max(rest, float(np.abs(_filtered(model, data, np.zeros(6)) - free - one).max()) / level)
    return {"same start": same, "from rest": rest, "equal": same < 1e-10, "equal from rest": rest < 1e-10}


def _filtered(model: Innovations, data: Data, start: Array) -> Array:
    """Errors (n, ny) of the model's filter from a state."""
    said = ct.forced_response(error_system(model), U=predictor_data(data).u.T, X0=start).outputs
    return np.asarray(said.reshape(model.ny, -1).T)


def _gain(model: Innovations, q: Array, r: Array, s: Array) -> Array:
    """The Kalman gain (nx, ny) of noises with these covariances."""
    p = linalg.solve_discrete_are(model.a.T, model.c.T, q, r, s=s)
    return np.asarray(np.linalg.solve(model.c @ p @ model.c.T + r, (model.a @ p @ model.c.T + s).T).T)


def _noisy(rng: np.random.Generator) -> Innovations:
    """A model with Q, R, S and their gain."""
    base = random_model(rng, 4, 2, 2, radius=0.9, dt=0.1)
    base = replace(base, a=linalg.expm(0.1 * (base.a - 1.2 * np.eye(4))))
    root = rng.standard_normal((6, 6))
    whole = root @ root.T
    q, s, r = whole[:4, :4], whole[:4, 4:], whole[4:, 4:]
    return replace(base, k=_gain(base, q, r, s), q=q, r=r, s=s)


def criterion_35(seed: int) -> Verdicts:
    """K, Q, R, S through balancing, a transform, truncation and sampling: observer poles, noise model, there and back.

    The gain of the carried Q, R, S is the carried gain. Truncation of a state that nobody sees changes nothing; of the
    last state it changes the response by no more than twice its Hankel singular value (Enns, 1984), and K goes along.
    """
    rng = np.random.default_rng(seed)
    model = _noisy(rng)
    turned = model.transformed(rng.standard_normal((4, 4)))
    whole, _ = similarity.balance(model)
    wide = similarity.reduce(_with_idle_state(model, rng), 4)
    poles = max(_pole_distance(model, other) for other in (turned, whole, wide))
    w = np.linspace(0.1, 3.0, 20)
    noise = max(float(np.abs(_noise(model, w) - _noise(other, w)).max()) for other in (turned, whole, wide))
    again = max(_relative(_gain(one, one.q, one.r, one.s), one.k) for one in (turned, whole))  # type: ignore[arg-type]
    t = similarity.similarity_transform(model, turned)
    back = max(_relative(model.transformed(t).k, turned.k), again)
    trip = _round_trip(model)
    return {
        "poles": poles, "noise model": noise, "K": back, "round trip": trip, "balanced": bool(poles < 1e-6),
        "noise model kept": bool(noise < 1e-6), "gain kept": back < 1e-5, "Q back": trip < 1e-6,
        "truncated": _truncated(model, w),
    }  # fmt: skip


def _round_trip(model: Innovations) -> float:
    again = sampling.sampled_form(sampling.continuous_form(model), model.dt)
    assert again.q is not None and model.q is not None
    return max(float(np.abs(again.k - model.k).max()), float(np.abs(again.q - model.q).max()))


def _with_idle_state(model: Innovations, rng: np.random.Generator) -> Innovations:
    """A fifth state, driven by inputs and noise, that nobody sees, in a basis that mixes it with the others."""
    a, q = linalg.block_diag(model.a, 0.5), linalg.block_diag(model.q, 1.0)
    b, k = np.vstack([model.b, rng.standard_normal((1, 2))]), np.vstack([model.k, rng.standard_normal((1, 2))])
    s = np.vstack([model.s, np.zeros((1, 2))])
    wide = replace(model, a=a, b=b, c=np.hstack([model.c, np.zeros((2, 1))]), k=k, q=q, s=s)
    return wide.transformed(linalg.qr(rng.standard_normal((5, 5)))[0])


def _truncated(model: Innovations, w: Array) -> bool:
    small, (_, hankel) = similarity.reduce(model, 3), similarity.balance(model)
    off = np.linalg.norm(responses(small, w) - responses(model, w), ord=2, axis=(1, 2)).max()
    return bool(small.k.shape == (3, 2) and off <= 2.0 * hankel[3] * (1.0 + 1e-9))


def _relative(one: Array, other: Array) -> float:
    return float(np.abs(one - other).max() / (1.0 + np.abs(other).max()))


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
    poles = np.sort(np.linalg.eigvals(stabilize(a)).real)
    off = float(np.abs(poles - [0.0, 0.5, 0.9, 0.99]).max())
    return {"off": off, "exact": off < 1e-8}


def criterion_41(seed: int) -> Verdicts:
    """Two resonances, 10 and 20 rad/s (damping 0.02), 2000 samples without noise, seen through a band about each.

    Poles within 5 % in continuous time, relative to their own distance from 0; log10 squared gain below 1 in 0.9 of a
    tenth to either side.
    """
    dt, n = 0.05, 2000
    parts = [ct.tf([w * w], [1.0, 0.04 * w, w * w]) for w in (10.0, 20.0)]
    truth = output_error(ct.ss(parts[0] + parts[1]), dt)
    data = made(truth, np.random.default_rng(seed).standard_normal((n, 1)), np.zeros((n, 1)))
    w = 2.0 * np.pi * np.fft.rfftfreq(n, dt)
    pole, worst = 0.0, 0.0
    for own, band in ((10.0, (5.0, 14.0)), (20.0, (16.0, 30.0))):
        seen = (w > band[0]) & (w < band[1])
        y, u = (np.fft.rfft(one, axis=0)[seen] / np.sqrt(n) for one in (data.y, data.u))
        model = frequency_subspace(w[seen], y, u, dt=dt, order=2, horizon=20)
        rate = np.log(np.linalg.eigvals(model.a).astype(complex)) / dt
        pole = max(pole, float(np.abs(rate / (own * complex(-0.02, np.sqrt(1.0 - 0.02**2))) - 1.0).min()))
        inside = np.linspace(0.9 * own, 1.1 * own, 40) * dt
        gain = 2.0 * np.abs(np.log10(np.abs(responses(model, inside)) / np.abs(responses(truth, inside))))
        worst = max(worst, float(np.quantile(gain, 0.9)))
    return {"pole": pole, "log gain": worst, "within": pole < 0.05, "gain": worst < 1.0}
