"""Six short identifications with figures: `python docs/ident_examples.py FOLDER`.

Each example makes its own data with a known truth, identifies it, prints what was found beside the truth and leaves a
figure: temperature with noise, a delay, a static nonlinearity, an unstable system, a closed loop, four tanks.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete, lfilter

from hoopd.ident import (
    Innovations,
    arx,
    delay,
    fit_percent,
    hammerstein_wiener,
    iddata,
    impulseest,
    nonlinear_pem,
    oe,
    plr,
    predict,
    residuals,
    subspaceid,
)
from hoopd.plots import impulse, style
from hoopd.plots.identification import (
    Response,
    draw_residuals,
    draw_responses,
    draw_said,
)

FIGURES: dict[str, Callable[[Path], str]] = {}


def example(make: Callable[[Path], str]) -> Callable[[Path], str]:
    FIGURES[make.__name__] = make
    return make


def discrete(numerator: list[float], denominator: list[float], dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator in q^-1 behind a hold."""
    num, den, _ = cont2discrete((numerator, denominator), dt)
    return num.ravel(), den


def response(num: np.ndarray, den: np.ndarray, w: np.ndarray, dt: float) -> np.ndarray:
    z = np.exp(-1j * w * dt)
    return np.asarray(np.polyval(num[::-1], z) / np.polyval(den[::-1], z))


@example
def temperature(figure: Path) -> str:
    """1/(10 s + 1) under a chirp, measured with noise of 0.2: least squares is biased, output error is not."""
    rng, t = np.random.default_rng(1), np.arange(2001.0)
    u = np.sign(np.sin(2e-4 * t**2))
    num, den = discrete([1.0], [10.0, 1.0], 1.0)
    data = iddata(lfilter(num, den, u) + 0.2 * rng.standard_normal(len(t)), u)
    models = {
        "least squares (arx)": arx(data, 1, 1),
        "pseudo-linear (plr)": plr(data, 1, 1, 1),
        "output error": oe(data, 1, 1),
    }
    w = np.geomspace(1e-3, np.pi, 200)
    curves = [Response(name, w, response(*model.dynamics(0), w, 1.0)) for name, model in models.items()]
    style.save(draw_responses([Response("truth", w, response(num, den, w, 1.0)), *curves]), figure)
    poles = {name: float(np.abs(np.roots(model.dynamics(0)[1])).max()) for name, model in models.items()}
    return f"pole {-den[1]:.4f}; " + ", ".join(f"{name} {pole:.4f}" for name, pole in poles.items())


@example
def dead_time(figure: Path) -> str:
    """1/(s^2 + 0.5 s + 1), 2 s late, sampled at 0.1 s: 21 samples with the hold's own, with an interval."""
    rng = np.random.default_rng(2)
    u = rng.standard_normal(1000)
    num, den = discrete([1.0], [1.0, 0.5, 1.0], 0.1)
    clean = lfilter(num, den, np.concatenate([np.zeros(20), u[:-20]]))
    data = iddata(clean + 0.02 * rng.standard_normal(1000), u, 0.1)
    found = delay(data)
    taps = impulseest(data, n=80, prior="tc")
    style.save(impulse({"impulse response (TC prior)": taps}), figure)
    return f"delay 21 samples; found {found.samples}, 95 % interval {found.interval[0]} to {found.interval[1]}"


@example
def static_nonlinearity(figure: Path) -> str:
    """A resonance whose output is seen as an absolute value with an offset, from 300 samples and 30 starts."""
    rng = np.random.default_rng(3)
    num, den = discrete([1.0], [1.0, 0.4, 1.0], 0.5)
    u = 1.0 + rng.standard_normal(300)
    data = iddata(np.abs(lfilter(num, den, u)) + 0.5 + 0.01 * rng.standard_normal(300), u, 0.5)
    model = hammerstein_wiener(data, 2, [0.0], output_map=lambda z, p: np.abs(z) + p[0], starts=30, seed=0)
    said = model.simulate(data)
    style.save(draw_said([data], {"Wiener model": [said]}, "simulated"), figure)
    return f"offset 0.5; found {model.p[0]:.4f}, simulation fits {fit_percent(data.y, said)[0]:.1f} %"


@example
def unstable(figure: Path) -> str:
    """1/(s - 1) held by a proportional law: its prediction is well behaved where its simulation explodes."""
    rng, n, dt = np.random.default_rng(4), 2000, 0.02
    a, b = np.exp(dt), np.exp(dt) - 1.0
    y, u = np.zeros(n), np.zeros(n)
    r = np.repeat(rng.standard_normal(n // 20), 20)
    for k in range(n - 1):
        u[k] = 3.0 * (r[k] - y[k])
        y[k + 1] = a * y[k] + b * u[k] + 0.01 * rng.standard_normal()
    data = iddata(y, u, dt)
    model = arx(data, 1, 1)
    style.save(draw_said([data], {"arx": [predict(model, data, 10)]}, "10 samples ahead"), figure)
    return f"pole {a:.4f}; found {-model.a[1]:.4f} +- {model.deviations()['a1']:.4f}"


@example
def closed_loop(figure: Path) -> str:
    """1/(z - 0.9) under feedback with coloured noise: the residuals name the loop."""
    rng, n = np.random.default_rng(5), 4000
    noise = 0.3 * lfilter([1.0], [1.0, -0.95], rng.standard_normal(n))
    x, y, u = 0.0, np.zeros(n), np.zeros(n)
    for k in range(n):
        y[k] = x + noise[k]
        u[k] = -0.5 * y[k] + 5.0 * np.sin(0.05 * k) + rng.standard_normal()
        x = 0.9 * x + u[k]
    data = iddata(y, u)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        models = {"arx 1,1": arx(data, 1, 1), "arx 4,4": arx(data, 4, 4), "subspace 2": subspaceid(data, 2)}
    style.save(draw_residuals(residuals(models["arx 1,1"], data)), figure)
    slow = {name: _pole_near(model, 0.9) for name, model in models.items()}
    return "pole 0.9; " + ", ".join(f"{name} {pole:.3f}" for name, pole in slow.items())


def _pole_near(model: object, wanted: float) -> float:
    roots = np.linalg.eigvals(model.a) if isinstance(model, Innovations) else np.roots(model.a)  # type: ignore[attr-defined]
    return float(roots[np.argmin(np.abs(roots - wanted))].real)


TANKS = np.array([1.6, 1.6, 4.9, 0.2])  # pumps' gains, outlet, share of the flow that goes up


def tank_step(x: np.ndarray, u: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
    """Levels a second later: two lower tanks under two upper ones, emptying by the root of their levels."""
    k1, k2, out, up = p
    flow = out * np.sqrt(np.maximum(x, 1e-3))
    change = (
        -flow[0] + flow[2] + (1.0 - up) * k1 * u[0], -flow[1] + flow[3] + (1.0 - up) * k2 * u[1],
        -flow[2] + up * k2 * u[1], -flow[3] + up * k1 * u[0],
    )  # fmt: skip
    return np.maximum(x + 0.05 * np.stack(change), 1e-3)


@example
def four_tanks(figure: Path) -> str:
    """Four coupled tanks, two levels measured: parameters and first levels by a sigma-point filter."""
    rng, n = np.random.default_rng(6), 600
    u = 3.0 + np.repeat(rng.uniform(-1.5, 1.5, (n // 30, 2)), 30, axis=0)
    x, y = np.array([2.5, 1.5, 3.2, 2.8]), np.zeros((n, 2))
    for k in range(n):
        y[k] = x[:2] + 0.02 * rng.standard_normal(2)
        x = tank_step(x, u[k], TANKS, 0.0)
    data = iddata(y, u, 1.0, outputs=["level 1", "level 2"], inputs=["pump 1", "pump 2"])
    model = nonlinear_pem(
        data, tank_step, lambda x, u, p, t: x[:2], [1.4, 1.4, 5.1, 0.25], [2.5, 1.5, 1.0, 2.0],
        process=1e-4, measurement=4e-4, spread=1.0, bounds=(0.01, 10.0), names=["k1", "k2", "outlet", "up"],
    )  # fmt: skip
    style.save(draw_said([data], {"four tanks": [data.y - model.errors]}, "one step ahead"), figure)
    sd = model.deviations()
    return "; ".join(
        f"{name} {true:g}: {model.parameters[name]:.4f} +- {sd[name]:.4f}"
        for name, true in zip(model.parameters, TANKS, strict=True)
    )


def main() -> None:
    """Every example, its figure into a folder."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("ident_examples")
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in FIGURES.items():
        print(f"{name}: {make(folder / f'{name}.png')}")


if __name__ == "__main__":
    main()
