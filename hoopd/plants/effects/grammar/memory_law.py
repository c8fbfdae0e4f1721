"""The form of every memory: rates for the model, a recursion over samples for the screen, and what a search tries.

Rules of this file: no plant and no law; the form, and recursions that several laws share.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.effects.grammar.axes import Axis

Array = NDArray[np.float64]
Constants = Mapping[str, Any]

# A damping that is tried where a law has one and says nothing else.
DAMPING = 0.1
# What is late by a part of a sample is so by this one: as many substeps as a memory has.
PARTS = 5


@dataclass(frozen=True)
class MemoryLaw:
    """One law of this file.

    Attributes
    ----------
    name : str
        As it stands in a name.
    kinds : tuple of str
        Axes that it may remember.
    rates : callable
        (ops, z, v, dv, constants, shortest_s) -> rates of the states z; dv is the rate of the way.
    value : callable
        (ops, z, v, constants) -> what the mechanism follows.
    along : callable
        (v (n,), way (n,), t (n,), constants) -> that value (n,) at samples.
    constant : str
        Its first constant.
    unit : callable
        Of an axis, the constant's.
    grid : callable
        (way (n,), t (n,)) -> values of the constant that a search tries.
    held : bool
        Of an input that is held between samples: its value at a sample is its mean until the next one.
    text, words : str
        As a formula and a sentence say it.
    states : int
        How many states it has.
    second : str
        Its other constant, where it has one.
    seconds : callable
        Of the usual sample time, values of it that a search tries, each with how far on the next of the first
        constant's values is that it tries beside it.
    is_body : bool
        Its states are the angle of a body against what it goes with, and its rate: it begins to move along.
    is_led : bool
        An estimator leads its states along the others and does not correct them; its constants are chosen, not fitted.
    dissipates : bool
        As a force on what moves, it takes energy away: its amplitude has a sign.
    """

    name: str
    kinds: tuple[str, ...]
    rates: Callable[[Any, Sequence[Any], Any, Any, Constants, float], Sequence[Any]]
    value: Callable[[Any, Sequence[Any], Any, Constants], Any]
    along: Callable[[Array, Array, Array, Constants], Array]
    constant: str
    unit: Callable[[Axis], str]
    grid: Callable[[Array, Array], Sequence[float]]
    text: str
    words: str
    states: int = 1
    is_body: bool = False
    is_led: bool = False
    dissipates: bool = False
    scaled: bool = False  # its value has the unit of the variable; else it is a number
    is_rate: bool = False  # or of its rate: the amplitude has a time in it
    is_chosen: bool = False  # its constant is the best that was tried: no fit moves it
    held: bool = False
    second: str = ""
    seconds: Callable[[float], Sequence[tuple[float, int]]] = lambda h: ((DAMPING, 1),)


def steps_of(x: Array) -> Array:
    """Changes from sample to sample, the first one zero."""
    return np.diff(x, prepend=x[:1])


def carried(left: Array, added: Array) -> Array:
    """z_k = left_k z_k-1 + added_k from z_0 = 0: a triangular matrix of two bands."""
    from scipy.linalg.lapack import dtbtrs  # the daemon, which never asks for it, starts without scipy

    bands, right = np.ones((2, len(left))), added.copy()
    bands[1, :-1], right[0] = -left[1:], 0.0
    found, _ = dtbtrs(bands, right, uplo="L", diag="U")
    return np.asarray(found)


def turned(left: complex, added: NDArray[np.complex128], begin: complex) -> NDArray[np.complex128]:
    """z_k = left z_k-1 + added_k-1 from z_0 = begin, the beginning with it."""
    from scipy.linalg.lapack import ztbtrs  # the daemon, which never asks for it, starts without scipy

    bands, right = np.ones((2, len(added) + 1), dtype=complex), np.append(begin, added)
    bands[1, :-1] = -left
    found, _ = ztbtrs(bands, right, uplo="L", diag="U")
    return np.asarray(found)
