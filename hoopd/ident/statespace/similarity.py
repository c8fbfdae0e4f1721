"""Realisations of one model: the transform between two, balancing, truncation; the noise goes along.

Rules of this file: what is done to the states is done to K, Q, S and x0 too, so the noise model stays the same, and to
the covariance of the matrices, so what follows from them is as well known as before; what is a part is no estimate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.models import Innovations, matrices_alone
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.change_of_states import covariance_of_matrices, in_states, projected
from hoopd.ident.statespace.linear import radius

Array = NDArray[np.float64]


def similarity_transform(
    one: Innovations, other: Innovations, by: Literal["observability", "controllability"] = "observability"
) -> Array:
    """Give the transform between two realisations of one model.

    Parameters
    ----------
    one, other : Innovations
        Models with as many states.
    by : {"observability", "controllability"}
        O_other = O_one T of the observability, or C_one = T C_other of the controllability matrices.

    Returns
    -------
    ndarray, shape (nx, nx)
        T with one.transformed(T) nearest to `other`; exact where they are the same system.

    Raises
    ------
    ValueError
        Different numbers of states.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import innovations, similarity_transform
    >>> one = innovations(control.ss([[0.8, 0.1], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], 0.1))
    >>> t = np.array([[2.0, 1.0], [0.0, 4.0]])
    >>> np.allclose(similarity_transform(one, one.transformed(t)), t)
    True
    """
    if one.nx != other.nx:
        raise ValueError(f"{one.nx} and {other.nx} states: no transform leads from one to the other")
    if by == "observability":
        return np.asarray(np.linalg.lstsq(observability(one.a, one.c), observability(other.a, other.c), rcond=None)[0])
    mine, theirs = observability(one.a.T, one.b.T), observability(other.a.T, other.b.T)
    return np.asarray(np.linalg.lstsq(theirs, mine, rcond=None)[0].T)


def observability(a: Array, c: Array, rows: int | None = None) -> Array:
    """[c; c a; c a^2; ...], nx blocks when not told."""
    blocks = [c]
    for _ in range((rows or len(a)) - 1):
        blocks.append(blocks[-1] @ a)
    return np.vstack(blocks)


def balance(model: Innovations, *, noise: bool = False) -> tuple[Innovations, Array]:
    """Give the balanced realisation of a stable model and its Hankel singular values.

    Parameters
    ----------
    model : Innovations
        A stable, minimal model, sampled or continuous (dt = 0).
    noise : bool
        Whether the innovations count as inputs too, so that what only the noise moves is not called small.

    Returns
    -------
    model : Innovations
        The balanced realisation, the covariance of its matrices with it.
    singular_values : ndarray, shape (nx,)
        Largest first.

    Raises
    ------
    ValueError
        A model that is not stable or not minimal.

    Notes
    -----
    Source: square root algorithm (Laub et al., IEEE Trans. Automatic Control 32, 1987).

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import balance, innovations
    >>> model = innovations(control.ss([[0.9, 0.0], [0.0, 0.1]], [[1.0], [1.0]], [[1.0, 0.1]], [[0.0]], 0.1))
    >>> balance(model)[1].round(2)  # the second state does little
    array([5.29, 0.08])
    """
    reach, see = _gramian_roots(model, noise)
    u, s, vt = linalg.svd(see.T @ reach)
    if s[-1] <= 1e-14 * s[0]:
        raise ValueError("the model is not minimal: a state cannot be reached or seen; truncate it first (`reduce`)")
    half = 1.0 / np.sqrt(s)
    t, inverse = reach @ vt.T * half, (half[:, None] * u.T) @ see.T
    return in_states(model, t, inverse), s


def reduce(model: Innovations, order: int, *, noise: bool = False) -> Innovations:
    """Keep the states of the balanced realisation with the largest Hankel singular values (balanced truncation).

    Parameters
    ----------
    model : Innovations
        A stable model, sampled or continuous (dt = 0).
    order : int
        States that are kept.
    noise : bool
        Whether the innovations count as inputs too.

    Returns
    -------
    Innovations
        The smaller model, without a covariance: it is no estimate of the data.

    Raises
    ------
    ValueError
        An order that is none, or a model that is not stable.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import innovations, reduce
    >>> model = innovations(control.ss([[0.9, 0.0], [0.0, 0.1]], [[1.0], [1.0]], [[1.0, 0.1]], [[0.0]], 0.1))
    >>> reduce(model, 1).a.round(2)
    array([[0.9]])
    """
    if not 0 < order <= model.nx:
        raise ValueError(f"order {order} of a model with {model.nx} states")
    reach, see = _gramian_roots(model, noise)
    u, s, vt = linalg.svd(see.T @ reach)
    half = 1.0 / np.sqrt(s[:order])
    return projected(matrices_alone(model), reach @ vt[:order].T * half, (half[:, None] * u[:, :order].T) @ see.T)


def _gramian_roots(model: Innovations, noise: bool) -> tuple[Array, Array]:
    """Roots of the gramians of what reaches the states and of what is seen of them."""
    into = np.hstack([model.b, model.k @ _root(_covariance(model))]) if noise else model.b
    if model.dt:
        if radius(model.a) >= 1.0:
            raise ValueError(f"a pole of modulus {radius(model.a):.6g}: gramians are for stable models")
        reach = linalg.solve_discrete_lyapunov(model.a, into @ into.T)
        return _root(reach), _root(linalg.solve_discrete_lyapunov(model.a.T, model.c.T @ model.c))
    rate = float(np.linalg.eigvals(model.a).real.max(initial=-np.inf))
    if rate >= 0.0:
        raise ValueError(f"a pole of real part {rate:.6g} 1/s: gramians are for stable models")
    reach = linalg.solve_continuous_lyapunov(model.a, -into @ into.T)
    return _root(reach), _root(linalg.solve_continuous_lyapunov(model.a.T, -model.c.T @ model.c))


def channels(model: Innovations, outputs: list[int], inputs: list[int]) -> Innovations:
    """Give the model between some inputs and outputs.

    Parameters
    ----------
    model : Innovations
        The model.
    outputs, inputs : list of int
        Numbers of the channels.

    Returns
    -------
    Innovations
        The smaller model; its gain is kept where all outputs are, in any order (another needs a new one). The
        covariance of its matrices is that part of the model's (`pem`'s; `subspaceid`'s follows from all channels
        together, and a part has none); it has no report of the fit.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import channels, innovations
    >>> model = innovations(control.ss([[0.9]], [[1.0, 2.0]], [[1.0], [3.0]], [[0.0, 0.0], [0.0, 0.0]], 0.1))
    >>> part = channels(model, outputs=[1], inputs=[1])
    >>> part.b, part.c
    (array([[2.]]), array([[3.]]))
    """
    part = _picked(matrices_alone(model), list(outputs), list(inputs))
    covariance = covariance_of_matrices(model)
    if covariance is None:
        return part
    # each entry of the part as its number in the full vector, from 1 on; 0 is a gain that was left out
    count = len(coordinates.values(model))
    numbers = coordinates.with_values(model, np.arange(1.0, count + 1.0))
    place = coordinates.values(_picked(numbers, list(outputs), list(inputs))).astype(int)
    known = np.zeros((count + 1, count + 1))
    known[1:, 1:] = covariance
    return replace(
        part, names=coordinates.names(part), values=coordinates.values(part), covariance=known[np.ix_(place, place)]
    )  # fmt: skip


def _picked(model: Innovations, outputs: list[int], inputs: list[int]) -> Innovations:
    whole = sorted(outputs) == list(range(model.ny))
    return replace(
        model, b=model.b[:, inputs], c=model.c[outputs], d=model.d[np.ix_(outputs, inputs)],
        k=model.k[:, outputs] if whole else np.zeros((model.nx, len(outputs))),
        r=None if model.r is None else model.r[np.ix_(outputs, outputs)],
        s=None if model.s is None else model.s[:, outputs],
        inputs=tuple(model.inputs[i] for i in inputs) if model.inputs else (),
        outputs=tuple(model.outputs[i] for i in outputs) if model.outputs else (),
    )  # fmt: skip


def _covariance(model: Innovations) -> Array:
    return np.eye(model.ny) if model.r is None else model.r


def _root(matrix: Array) -> Array:
    """F with F F' = matrix, also where it is singular."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
