"""`hoopd identify`: recordings to a linear model by any of the methods, compared on data it was not fitted to.

Rules of this file: files in, files out; the mathematics is in `hoopd.ident`. Nothing is written before all is known.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from hoopd.bench.inputs import read_recording
from hoopd.bench.targets import check_targets
from hoopd.design.arxlaw import arriving
from hoopd.design.laws import Spec
from hoopd.files import InputError
from hoopd.ident.checks import CONSTANT, IdentificationWarning
from hoopd.ident.confidence import Estimated, pole_spread, response_spread, zero_spread, zeros_of
from hoopd.ident.data import Data, iddata
from hoopd.ident.frequencydata import response
from hoopd.ident.measures import fit_percent
from hoopd.ident.models import Innovations, Polynomials, state_space
from hoopd.ident.polynomial.arx import varx
from hoopd.ident.polynomial.pem import armax, bj, oe
from hoopd.ident.prediction import predict
from hoopd.ident.residualtests import ResidualReport, residuals
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.subspace import subspaceid
from hoopd.identifiedfile import IdentifiedFile, identified_text
from hoopd.plots import style
from hoopd.plots.identification import Response, Roots, draw_residuals, draw_responses, draw_roots, draw_said
from hoopd.recording.bytesof import replace_file
from hoopd.recording.recording import Recording
from hoopd.spans import spans

Array = NDArray[np.float64]
Progress = Callable[[str], None]

METHODS = ("arx", "armax", "oe", "bj", "subspace", "pem")
STATE_SPACE = ("subspace", "pem")
OUTPUTS = ("dtheta", "psi")
UNITS = {"theta": "rad", "dtheta": "rad/s", "psi": "rad"}
HORIZONS = {"1": 1.0, "10": 10.0, "simulation": np.inf}
# Of a recording without another one to compare with, the last part is held out.
LAST_SHARE = 1.0 / 3.0
# The part that is compared must be longer than the slowest mode of the device once or twice.
SHORTEST = 50
# Readings of an output that a fit in percent and the tests of residuals ask for.
FEWEST_READINGS = 20
# Lowest frequency that is drawn, of half of the sampling frequency.
LOWEST_SHARE, POINTS = 1e-3, 600
# Steps that differ by less are rounding of the time stamps.
SAME_STEP = 1e-6


@dataclass(frozen=True)
class Wish:
    """What is asked for: `orders` na, nb (and nc) of polynomials; `order`, states of a state space, None: chosen."""

    method: str = "arx"
    orders: tuple[int, ...] = (4, 6)
    order: int | None = None
    outputs: tuple[str, ...] = OUTPUTS
    delay_s: float | None = None  # age of a picture in a file whose rows were taken at once; None: rows as they are
    detrend: bool = False


def run(
    recordings: Sequence[str],
    holdout: Sequence[str],
    wish: Wish,
    *,
    columns: str | None = None,
    out: Path | None = None,
    figure: Path | None = None,
    progress: Progress = lambda text: None,
) -> dict[str, Any]:
    """Identify, compare, write and draw; the result as plain data. InputError: nothing that can be used."""
    _check(wish)
    check_targets([*recordings, *holdout], {"--out": out, "--figure": figure})
    if figure is not None:
        style.check_path(figure)
    progress("reading the recordings")
    train, said = _read(recordings, columns, wish)
    held, more = _read(holdout, columns, wish)
    how = ", ".join(holdout) or "the last third of every recording"
    if not held:
        train, held = _split(train)
    _check_held(train, held, ", ".join(holdout) or f"{', '.join(recordings)}, last third")
    progress(f"fitting {wish.method}")
    model, parts, doubts = _identified(train, wish, recordings)
    progress("comparing")
    percent, lost = _percents(model, held)
    try:
        report = residuals(model, held)
    except ValueError as error:
        raise InputError("--method", wish.method, str(error)) from None
    notes = [*said, *more, *doubts, *lost, *report.warnings]
    file = _file(model, wish, recordings, percent, notes, out)
    if figure is not None:
        _draw(model, parts, wish.method, max(held, key=lambda one: one.n), how, report, figure)
    if out is not None:
        replace_file(out, identified_text(file).encode())
    return {
        "method": wish.method,
        "states": model.nx,
        "outputs": list(wish.outputs),
        "held_out": how,
        "fit_percent": percent,
        "poles": [{"re": float(z.real), "im": float(z.imag)} for z in _poles(model)],
        "residual_tests": {one.name: {"p": one.chance, "passed": one.passed}
                           for one in (*report.white, *report.independent, *report.feedback)},
        "warnings": notes,
    }  # fmt: skip


# ---------------------------------------------------------------------------------------------- data


def _read(names: Sequence[str], columns: str | None, wish: Wish) -> tuple[list[Data], list[str]]:
    """The stretches of recordings, and what has to be said of them."""
    found, said = [], []
    for name in names:
        parts, notes = stretches(read_recording(name, columns), name, wish)
        found += parts
        said += notes
    return found, said


def stretches(recording: Recording, name: str, wish: Wish) -> tuple[list[Data], list[str]]:
    """Torque and outputs of a recording, row by row, cut where the torque is not known; what was cut, in words.

    An output that was not read is missing. A stretch begins where every output was read, and has 50 rows at least.
    """
    y, u = _outputs(recording, wish), np.asarray(recording.u, dtype=float)
    known = np.isfinite(u)
    whole = np.asarray(np.isfinite(y).all(axis=1))
    if not whole.any():
        raise InputError(name, "", "no row holds all of the outputs that are asked for")
    found, step, parts = [], round(recording.sample_time_s, 9), spans(known)
    for start, end in parts:
        first = start + int(np.argmax(whole[start:end]))
        if whole[first] and end - first >= (SHORTEST if len(parts) > 1 else 1):
            found.append(_data(y[first:end], u[first:end], step, name, wish))
    if not found:
        raise InputError(name, "u", f"no {SHORTEST} rows follow each other of which the torque is known")
    return found, _cut(known, found, name)


def _cut(known: NDArray[np.bool_], found: Sequence[Data], name: str) -> list[str]:
    missing = int((~known).sum())
    if not missing:
        return []
    rows = sum(one.n for one in found)
    return [
        f"{name}: the torque of {missing} rows is not known: {rows} of {len(known)} rows used, in {len(found)} parts"
    ]


def _outputs(recording: Recording, wish: Wish) -> Array:
    columns = {one: np.asarray(getattr(recording, one), dtype=float) for one in wish.outputs}
    if wish.delay_s is not None:
        try:
            spec = Spec(delay_s=wish.delay_s, sample_time_s=recording.sample_time_s)
            columns |= dict(zip(OUTPUTS, arriving(recording, spec)[1].T, strict=True))
        except ValueError as error:
            raise InputError("--delay", "", getattr(error, "reason", str(error))) from None
    return np.stack([columns[one] for one in wish.outputs], axis=1)


def _data(y: Array, u: Array, step: float, name: str, wish: Wish) -> Data:
    try:
        made = iddata(y, u, step, outputs=wish.outputs, inputs=["torque"])
    except ValueError as error:
        raise InputError(name, "", str(error)) from None
    return _without_mean(made) if wish.detrend else made


def _without_mean(data: Data) -> Data:
    return replace(data, y=data.y - np.nanmean(data.y, axis=0), u=data.u - data.u.mean(axis=0))


def _split(train: Sequence[Data]) -> tuple[list[Data], list[Data]]:
    cuts = [round(one.n * (1.0 - LAST_SHARE)) for one in train]
    held = [one[cut:] for one, cut in zip(train, cuts, strict=True)]
    kept = [one for one in held if one.n >= SHORTEST]
    if not kept:
        raise InputError("REC", "", f"a recording of {3 * SHORTEST} samples at least, or --holdout, is needed")
    return [one[:cut] for one, cut in zip(train, cuts, strict=True)], kept


def _check_held(train: Sequence[Data], held: Sequence[Data], name: str) -> None:
    """InputError unless the data can show how good a model of the others is."""
    for one in held:
        if abs(one.dt / train[0].dt - 1.0) > SAME_STEP:
            reason = f"rows are {one.dt:g} s apart, those of the fit {train[0].dt:g} s: hoopd convert --step"
            raise InputError(name, "", reason)
        if one.n < SHORTEST:
            raise InputError(name, "", f"{one.n} rows tell nothing about a model, {SHORTEST} at least do")
    y = np.concatenate([one.y for one in held])
    for output, column in zip(held[0].outputs, y.T, strict=True):
        known = column[np.isfinite(column)]
        if len(known) < FEWEST_READINGS:
            raise InputError(name, output, f"{len(known)} readings to compare with, {FEWEST_READINGS} are wanted")
        if np.ptp(known) <= CONSTANT * np.abs(known).max():
            raise InputError(name, output, "is constant: it does not show how good a model is, take another --holdout")


# ---------------------------------------------------------------------------------------------- models


def _check(wish: Wish) -> None:
    if wish.method not in METHODS:
        raise InputError("--method", "", f"unknown method {wish.method!r}; known: {', '.join(METHODS)}")
    known = ("theta", "dtheta", "psi")
    if not wish.outputs or set(wish.outputs) - set(known) or len(set(wish.outputs)) != len(wish.outputs):
        raise InputError("--outputs", "", f"different ones of {', '.join(known)}, not {','.join(wish.outputs)}")
    if wish.delay_s is not None and set(wish.outputs) - set(OUTPUTS):
        raise InputError("--delay", "", f"is known of {', '.join(OUTPUTS)} only")
    if not 2 <= len(wish.orders) <= 3 or min(wish.orders) < 1:
        raise InputError("--orders", "", "two or three whole numbers from 1 on: na,nb or na,nb,nc")
    if wish.order is not None and wish.order < 1:
        raise InputError("--order", "", f"at least 1, not {wish.order}")


def _identified(
    train: Sequence[Data], wish: Wish, recordings: Sequence[str]
) -> tuple[Innovations, list[Estimated], list[str]]:
    """The model in innovation form, as its method gave it (a part an output, or one), and what that warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", IdentificationWarning)
        try:
            model, parts = _by_method(train, wish)
        except (ValueError, ArithmeticError) as error:
            raise InputError(", ".join(recordings), "", str(error)) from None
    notes = [str(one.message) for one in caught if issubclass(one.category, IdentificationWarning)]
    return model, parts, list(dict.fromkeys(notes))


def _by_method(train: Sequence[Data], wish: Wish) -> tuple[Innovations, list[Estimated]]:
    if wish.method == "arx":
        joint = varx(train, *wish.orders[:2])
        return joint.state_space, [joint]
    if wish.method in STATE_SPACE:
        model = subspaceid(train, wish.order) if wish.method == "subspace" else pem(train, wish.order)
        return model, [model]
    na, nb, nc = (*wish.orders, wish.orders[0])[:3]
    fits: Mapping[str, Callable[[Sequence[Data]], Polynomials]] = {
        "armax": lambda each: armax(each, na, nb, nc),
        "oe": lambda each: oe(each, nb, na),
        "bj": lambda each: bj(each, nb, nc, nc, na),
    }
    rows = [fits[wish.method]([one.channels([i]) for one in train]) for i in range(train[0].ny)]
    return beside([state_space(one) for one in rows]), [*rows]


def beside(models: Sequence[Innovations]) -> Innovations:
    """Models of one output each as one of all outputs, their states under each other."""
    first = models[0]
    r = block_diag(*(np.zeros((1, 1)) if one.r is None else one.r for one in models))
    return Innovations(
        block_diag(*(one.a for one in models)), np.vstack([one.b for one in models]),
        block_diag(*(one.c for one in models)), np.vstack([one.d for one in models]),
        block_diag(*(one.k for one in models)), first.dt, r=r, inputs=first.inputs,
        outputs=tuple(one.outputs[0] for one in models),
    )  # fmt: skip


def _percents(model: Innovations, held: Sequence[Data]) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Fit of each output over all held-out data by horizon; none, in words, where a prediction diverges."""
    y, found, said = np.concatenate([one.y for one in held]), {}, []
    for name, horizon in HORIZONS.items():
        with np.errstate(over="ignore", invalid="ignore"):
            ahead = np.concatenate([predict(model, one, horizon) for one in held])
            fits = fit_percent(y, ahead)
        found[name] = {one: float(p) for one, p in zip(held[0].outputs, fits, strict=True) if np.isfinite(p)}
        if len(found[name]) < len(fits):
            what = "the simulation" if horizon == np.inf else f"the prediction {name} ahead"
            said.append(f"{what} diverges: the model is unstable, and there is no fit to tell")
    return found, said


def _poles(model: Innovations) -> NDArray[np.complex128]:
    return np.asarray(sorted(np.linalg.eigvals(model.a), key=lambda z: -abs(z)), dtype=complex)


# ---------------------------------------------------------------------------------------------- figures


def _draw(
    model: Innovations, parts: Sequence[Estimated], method: str, shown: Data, how: str, report: ResidualReport,
    figure: Path,
) -> None:  # fmt: skip
    """Predictions into the file that was asked for; residuals, responses and roots beside it."""
    said = {method: predict(model, shown, HORIZONS["10"])}
    drawn = {
        "": draw_said(shown, said, "10 samples ahead", title=f"{method}, {how}", units=UNITS),
        "_residuals": draw_residuals(report),
        "_bode": draw_responses(_responses(model, parts), title=f"From the torque, {method}{_known(parts)}"),
        "_roots": draw_roots(_root_sets(model, parts), title=f"Poles and zeros, {method}{_known(parts)}"),
    }
    for ending, one in drawn.items():
        style.save(one, figure.with_name(f"{figure.stem}{ending}{figure.suffix}"))


def _known(parts: Sequence[Estimated]) -> str:
    return ", with 95 % regions" if pole_spread(parts[0]) is not None else ""


def _responses(model: Innovations, parts: Sequence[Estimated]) -> list[Response]:
    """From the torque to each output, over three decades up to half of the sampling frequency."""
    w = np.geomspace(LOWEST_SHARE, 1.0, POINTS) * np.pi / model.dt
    h = response(model.system, w).frdata
    spreads = [response_spread(one, w) for one in parts]
    out = []
    for i, name in enumerate(model.outputs):
        spread, row = (spreads[0], i) if len(parts) == 1 else (spreads[i], 0)
        sd = () if spread is None else (spread.gain[:, row, 0], spread.phase[:, row, 0])
        out.append(Response(f"{name} ({UNITS[name]} per N m)", w, h[i, 0], *sd))
    return out


def _root_sets(model: Innovations, parts: Sequence[Estimated]) -> list[Roots]:
    """Poles once where all outputs have them in common, zeros by output."""
    none = np.zeros(0, dtype=complex)
    poles = [pole_spread(one) for one in parts]
    out = []
    if len(parts) == 1:
        shared = poles[0]
        own = Roots("poles", _poles(model), none) if shared is None else Roots(
            "poles", shared.roots, none, shared.covariances
        )  # fmt: skip
        out.append(own)
    for i, name in enumerate(model.outputs):
        part, row = (parts[0], i) if len(parts) == 1 else (parts[i], 0)
        spread, pole = zero_spread(part, row), poles[0 if len(parts) == 1 else i]
        zeros, sizes = (zeros_of(model, i), ()) if spread is None else (spread.roots, spread.covariances)
        if len(parts) == 1 or pole is None:
            out.append(Roots(f"zeros of {name}", none, zeros, (), sizes))
        else:
            out.append(Roots(f"poles and zeros of {name}", pole.roots, zeros, pole.covariances, sizes))
    return out


def _file(
    model: Innovations, wish: Wish, recordings: Sequence[str], percent: Mapping[str, dict[str, float]],
    notes: Sequence[str], out: Path | None,
) -> IdentifiedFile:  # fmt: skip
    r = np.zeros((model.ny, model.ny)) if model.r is None else model.r
    return IdentifiedFile(
        schema="hoopd.identified/1",
        name=wish.method if out is None else out.stem,
        method=wish.method,
        sample_time_s=model.dt,
        inputs=["torque"],
        outputs=list(wish.outputs),
        **{name: getattr(model, name).tolist() for name in ("a", "b", "c", "d", "k")},
        r=r.tolist(),
        recordings=[Path(one).name for one in recordings],
        fit_percent={name: dict(one) for name, one in percent.items()},
        notes=list(notes),
    )
