"""How a mechanism follows its variable: straight, bent, from a threshold on, up to a limit, in waves, at one place.

A shape is a function of the variable v and its constants; it takes a module of functions (`casadi` or `numpy`), so that
symbols and arrays get the same formula. What multiplies the whole is an amplitude; constants are in the unit of v.

Rules of this file: one entry a shape, its formula in words beside its code; no plant.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.effects.grammar.axes import FORCE, INPUT, POSITION, POWER, RATE, STATE, TIME, Axis

Array = NDArray[np.float64]
Constants = Mapping[str, Any]

# Constants that are places or levels are tried where these shares of the samples lie.
LEVELS = (0.15, 0.35, 0.55, 0.75, 0.9)
PLACES = (0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95)
PLACES_A_TURN = 16
# Where the axis of a lens may be: directions, and distances in radii of the circle that it looks at.
PLACES_OF_LENS, LENSES = 12, (0.4, 0.65, 1.0)
# A well is so wide, as a share of the range that the variable has (of a turn: of a radian).
WIDTHS, WIDTHS_RAD = (0.05, 0.15), (0.12, 0.3)
# Times of what settles with time, as shares of the longest.
SETTLING = (0.05, 0.15, 0.4)
# Choices to each side of one wave a turn, where the scale of the angle is not known.
MOST_SCALES = 150
# Moments of what begins once in a recording, and how long it takes then, as a share of their distance.
MOMENTS, SUDDEN = 24, 0.5
# Of a pull that changes its sign at its place, widths and how many places of each: half a width off it is another one.
DETENT_PLACES = ((0.15, 42), (0.35, 28), (0.6, 16))
WAVES = tuple(float(n) for n in range(1, 37))
# s, longer than any recording; and the time of what lasts that is added to a recording's.
ALWAYS, BEGAN = 1e9, "began"
# Below, a root is a straight line: its slope has no end.
LEAST = 1e-12
# Over what does not turn a wave is coherent: one of half a wave more in the range is another one. So many waves over a
# length (the pitch of a screw, of a rail), what flows into a store (hum) and beats over the time.
WAVES_IN_RANGE = tuple(0.5 * k for k in range(2, 49))
HUMS_IN_TIME = tuple(0.5 * k for k in range(2, 33))
BEATS_IN_TIME = tuple(0.5 * k for k in range(2, 41))
# Forces in waves over the time are asked for at few frequencies: a disturbance of another colour than is believed shows
# at some frequency or other.
WAVES_IN_TIME = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)
# A beat drops within a few samples: of its harmonics the k-th is this to the power k of a saw-tooth's.
DROP = 0.9


@dataclass(frozen=True)
class ShapeLaw:
    """A function of one variable.

    Attributes
    ----------
    name : str
        As it stands in a name.
    of : callable
        (ops, v, constants) -> value.
    text : str
        The formula; {v} stands for the variable.
    words : str
        As a sentence says it.
    constants : tuple of str
        Names; `n` of a wave has no unit on a turning axis.
    kinds : tuple of str
        Axes that it may follow.
    power : float
        Of the unit of v in the amplitude's: the amplitude is the site's unit over unit^power.
    grid : callable
        (axis, samples) -> values of the constants that a search tries.
    odd : bool
        It changes sign with its variable.
    phased : bool
        A wave: it has a phase.
    first : float
        Of what has a phase, its first harmonic, the sine that a screen takes for it: its amplitude.
    mean : float
        Of what has a phase, its mean, which a screen takes beside the sine.
    lasts : bool
        It begins once, in one of several recordings, and stays in those after it: `began` is ALWAYS in these, less than
        any time in those before, and 0 in its own.
    """

    name: str
    of: Callable[[Any, Any, Constants], Any]
    text: str
    words: str
    kinds: tuple[str, ...]
    power: float = 0
    constants: tuple[str, ...] = ()
    grid: Callable[[Axis, Array], Sequence[Constants]] = lambda axis, v: ({},)
    odd: bool = False
    phased: bool = False
    first: float = 1.0
    mean: float = 0.0
    lasts: bool = False


def _levels(axis: Axis, v: Array) -> list[Constants]:
    size = np.abs(v)
    return [{"v0": float(one)} for one in np.unique(np.quantile(size, LEVELS)) if 0.0 < one < size.max()]


def _places(axis: Axis, v: Array) -> list[Constants]:
    return [{"v0": float(one)} for one in np.unique(np.quantile(v, PLACES))]


def _wells(axis: Axis, v: Array) -> list[Constants]:
    if axis.turning:
        places = np.linspace(-np.pi, np.pi, PLACES_A_TURN, endpoint=False)
        return [{"v0": float(p), "w": w} for w in WIDTHS_RAD for p in places]
    low, high = np.quantile(v, (0.02, 0.98))
    places = np.linspace(low, high, PLACES_A_TURN // 2)
    return [{"v0": float(p), "w": float(w * (high - low))} for w in WIDTHS for p in places if high > low]


def _waves(axis: Axis, v: Array) -> list[Constants]:
    if axis.scale_share:
        return [{"n": float(n)} for n in _scales(axis.scale_share, float(np.ptp(v)))]
    if axis.turning:
        return [{"n": n} for n in WAVES]
    return _periods(v, WAVES_IN_TIME if axis.kind == TIME else WAVES_IN_RANGE)


def _beats(axis: Axis, v: Array) -> list[Constants]:
    return _periods(v, BEATS_IN_TIME)


def _periods(v: Array, counts: Sequence[float]) -> list[Constants]:
    """So many over the whole range."""
    reach = float(np.ptp(v))
    return [{"n": float(2 * np.pi * n / reach)} for n in counts] if reach > 0.0 else []


def _detents(axis: Axis, v: Array) -> list[Constants]:
    if not axis.turning:
        return _wells(axis, v)
    turn = 2 * np.pi
    return [{"v0": float(p), "w": w} for w, n in DETENT_PLACES for p in turn * (np.arange(n) / n - 0.5)]


def _scales(share: float, reach: float) -> Array:
    """About one wave a turn, so near to each other that none is missed over the whole reach."""
    count = min(int(np.ceil(share * reach / np.pi)), MOST_SCALES)
    return np.linspace(1.0 - share, 1.0 + share, 2 * count + 1)


def _times(axis: Axis, v: Array) -> list[Constants]:
    return [{"v0": float(one * np.max(v))} for one in SETTLING if np.max(v) > 0.0]


def _moments(axis: Axis, v: Array) -> list[Constants]:
    reach = float(np.max(v))
    w = SUDDEN * reach / MOMENTS
    return [{"v0": reach * (k + 0.5) / MOMENTS, "w": w} for k in range(MOMENTS)] if reach > 0.0 else []


def _squared(ops: Any, v: Any, v0: Any, turning: bool) -> Any:
    """(v - v0)^2, on a turn 2 - 2 cos(v - v0): the same near v0, and again after every turn."""
    return 2.0 * (1.0 - ops.cos(v - v0)) if turning else (v - v0) ** 2


def _apart(ops: Any, v: Any, v0: Any, turning: bool) -> Any:
    """v - v0, on a turn the sine of it: half of the derivative of the square."""
    return ops.sin(v - v0) if turning else v - v0


SIGNED, ANY = (RATE, INPUT, STATE, POSITION, POWER), (POSITION, RATE, INPUT, STATE, POWER, FORCE)

SHAPES: tuple[ShapeLaw, ...] = (
    ShapeLaw("linear", lambda ops, v, c: v, "{v}", "grows with", (*ANY, TIME), 1, odd=True),
    ShapeLaw("quadratic", lambda ops, v, c: v * ops.fabs(v), "{v} |{v}|", "grows with the square, and the sign, of",
             (RATE, INPUT, STATE), 2, odd=True),
    ShapeLaw("root", lambda ops, v, c: v / ops.sqrt(ops.fmax(ops.fabs(v), LEAST)), "sign({v}) sqrt(|{v}|)",
             "grows with the root of", (STATE,), 0.5, odd=True),
    ShapeLaw("square", lambda ops, v, c: v**2, "{v}^2", "grows with the square of", (*ANY, TIME), 2),
    ShapeLaw("cubic", lambda ops, v, c: v**3, "{v}^3", "grows with the cube of", (RATE, INPUT, POSITION, STATE), 3,
             odd=True),
    ShapeLaw("magnitude", lambda ops, v, c: ops.fabs(v), "|{v}|", "grows with the size of", SIGNED, 1),
    ShapeLaw("threshold", lambda ops, v, c: v - ops.fmin(ops.fmax(v, -c["v0"]), c["v0"]),
             "sign({v}) max(|{v}| - v0, 0)", "begins where its size passes a threshold: it follows", SIGNED, 1, ("v0",),
             _levels, odd=True),
    ShapeLaw("saturation", lambda ops, v, c: ops.fmin(ops.fmax(v / c["v0"], -1.0), 1.0),
             "min(max({v}/v0, -1), 1)", "grows up to a limit with", SIGNED, 0, ("v0",), _levels, odd=True),
    ShapeLaw("peak", lambda ops, v, c: 2.0 * (v / c["v0"]) / (1.0 + (v / c["v0"]) ** 2),
             "2 ({v}/v0) / (1 + ({v}/v0)^2)", "rises to a peak and falls again with", (RATE, INPUT, STATE), 0, ("v0",),
             _levels, odd=True),
    ShapeLaw("above", lambda ops, v, c: ops.fmax(v - c["v0"], 0.0), "max({v} - v0, 0)",
             "begins above a value of", (*ANY, TIME), 1, ("v0",), _places),
    ShapeLaw("below", lambda ops, v, c: ops.fmax(c["v0"] - v, 0.0), "max(v0 - {v}, 0)",
             "begins below a value of", ANY, 1, ("v0",), _places),
    ShapeLaw("settling", lambda ops, v, c: 1.0 - ops.exp(-v / c["v0"]), "(1 - exp(-{v}/v0))", "settles with",
             (TIME,), 0, ("v0",), _times),
    ShapeLaw("fading", lambda ops, v, c: ops.exp(-v / c["v0"]), "exp(-{v}/v0)", "dies out with", (TIME,), 0, ("v0",),
             _times),
)  # fmt: skip


def _well_of(turning: bool) -> ShapeLaw:
    return ShapeLaw(
        "well",
        lambda ops, v, c: ops.exp(-_squared(ops, v, c["v0"], turning) / c["w"] ** 2 / 2.0),
        "exp(-(({v} - v0)/w)^2/2)", "sits at one value of", (POSITION, RATE, STATE, INPUT), 0, ("v0", "w"), _wells,
    )  # fmt: skip


def _detent_of(turning: bool) -> ShapeLaw:
    """The force of a well in the potential: it pulls from both sides."""

    def force(ops: Any, v: Any, c: Constants) -> Any:
        x, square = _apart(ops, v, c["v0"], turning) / c["w"], _squared(ops, v, c["v0"], turning) / c["w"] ** 2
        return -x * ops.exp((1.0 - square) / 2.0)

    return ShapeLaw("detent", force, "x exp((1 - x^2)/2), x = (v0 - {v})/w", "pulls to one value of", (POSITION,), 0,
                 ("v0", "w"), _detents)  # fmt: skip


def _bent_of(turning: bool) -> ShapeLaw:
    """The least odd power after the first one, about any centre: how a lens bends what it shows."""

    def cube(ops: Any, v: Any, c: Constants) -> Any:
        return _apart(ops, v, c["v0"], turning) * _squared(ops, v, c["v0"], turning)

    return ShapeLaw("bent", cube, "({v} - v0)^3",
                    "grows with the cube of the distance from one value of", (POSITION,), 3, ("v0",),
                    _places)  # fmt: skip


def _lens(ops: Any, v: Any, c: Constants) -> Any:
    # of a point on a circle, seen from its middle: what a lens whose axis is e radii off adds to the angle
    return ops.sin(v - c["v0"]) * (1.0 + c["e"] ** 2 - 2.0 * c["e"] * ops.cos(v - c["v0"]))


def _lenses(axis: Axis, v: Array) -> list[Constants]:
    places = np.linspace(-np.pi, np.pi, PLACES_OF_LENS, endpoint=False)
    return [{"v0": float(p), "e": e} for e in LENSES for p in places]


LENS = ShapeLaw("lens", _lens, "sin({v} - v0) (1 + e^2 - 2 e cos({v} - v0))",
             "is that of a lens whose axis is beside the middle of", (POSITION,), 0, ("v0", "e"), _lenses)  # fmt: skip
BENTS = {turning: _bent_of(turning) for turning in (False, True)}
WELLS = {turning: _well_of(turning) for turning in (False, True)}
DETENTS = {turning: _detent_of(turning) for turning in (False, True)}
WAVE = ShapeLaw("wave", lambda ops, v, c: ops.sin(c["n"] * v + c["phi"]), "sin(n {v} + phi)", "comes back in waves of",
             (POSITION, TIME), 0, ("n",), _waves, phased=True)  # fmt: skip


# The same over the time, of what flows into a store: so many more frequencies.
HUM = replace(WAVE, grid=lambda axis, v: _periods(v, HUMS_IN_TIME))


def _saw(ops: Any, v: Any, c: Constants) -> Any:
    # frac(x) = 1/2 - sum over k of sin(2 pi k x)/(pi k), and that sum, damped by DROP^k, in closed form
    x = c["n"] * v + c["phi"]
    return 0.5 - ops.arctan2(DROP * ops.sin(x), 1.0 - DROP * ops.cos(x)) / np.pi


BEAT = ShapeLaw("beat", _saw, "frac((n {v} + phi)/2 pi)", "grows and falls back in a saw-tooth of", (TIME,), 0, ("n",),
             _beats, phased=True, first=-DROP / np.pi, mean=0.5)  # fmt: skip


STEP = ShapeLaw("step", lambda ops, v, c: (1.0 + ops.tanh((v - c["v0"]) / c["w"])) / 2.0,
                "(1 + tanh(({v} - v0)/w))/2", "steps to another level at one moment of", (TIME,), 0, ("v0", "w"),
                _moments)  # fmt: skip
CHANGE = ShapeLaw("change", lambda ops, v, c: (1.0 + ops.tanh((v + c.get(BEGAN, 0.0) - c["v0"]) / c["w"])) / 2.0,
                  "(1 + tanh(({v} - v0)/w))/2, and 1 in the recordings after it", "changes for good at one moment of",
                  (TIME,), 0, ("v0", "w"), _moments, lasts=True)  # fmt: skip
# What is not as it was from one moment on: of each recording, or once for all.
STEPS = (STEP, CHANGE)


def shapes_of(axis: Axis) -> list[ShapeLaw]:
    """Those that may follow an axis."""
    own = (*SHAPES, WELLS[axis.turning], DETENTS[axis.turning], WAVE)
    # a turning angle has no size and no direction: what follows it comes back after a turn
    plain = [one for one in own if axis.kind in one.kinds]
    return [one for one in plain if one.name in ("well", "detent", "wave")] if axis.turning else plain
