"""A rational matrix of several inputs and outputs with common poles, from a measured frequency response.

    H(s) = D + sum_k R_k / (s - p_k)
With poles p of the last turn, sigma(s) H(s) = Phi(s) r and sigma = 1 + Phi(s) c are linear in r and c; the zeros of
sigma are the next poles (vector fitting: Gustavsen & Semlyen, IEEE Trans. Power Delivery 14, 1999; entry by entry
eliminated as in Deschrijver et al., IEEE Microwave and Wireless Components Letters 18, 2008).

Rules of this file: continuous responses at rad/s; pairs of poles stand together; every entry counts by its own size.
"""

from __future__ import annotations

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from hoopd.ident.estimation_report import estimated
from hoopd.ident.rationalproblem import RationalFit

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SETTLED = 1e-10
# Damping of the first poles, which stand over the band evenly in its logarithm.
LIGHT = 0.01


@estimated("rational matrix")
def rational_matrix(
    response: ct.FRD, poles: int, *, direct: bool = False, stable: bool = True, iterations: int = 40
) -> RationalFit:  # fmt: skip
    """Fit a rational matrix with common poles to a frequency response of several inputs and outputs.

    Parameters
    ----------
    response : control.FRD
        The response at w rad/s; continuous (of a sampled one `from_response` gives a state space).
    poles : int
        Their number, which all entries share.
    direct : bool
        Whether there is a matrix D.
    stable : bool
        Poles are kept in the left half plane.
    iterations : int
        Turns.

    Returns
    -------
    RationalFit
        The `system` as a state space of `poles` states an input, the relative `error` (nw,) of the worst entry at `w`
        rad/s, and the root mean square `rms` of the errors relative to each entry's size.

    Raises
    ------
    ValueError
        A sampled response, one that is not finite or zero somewhere altogether, more unknowns than data.

    Notes
    -----
    Sources: Gustavsen & Semlyen, IEEE Trans. Power Delivery 14, 1999; Deschrijver et al., IEEE Microwave and Wireless
    Components Letters 18, 2008.

    Examples
    --------
    >>> import control
    >>> import numpy as np
    >>> from hoopd.ident import frequency_response, rational_matrix
    >>> truth = control.ss([[-0.2, 2.0], [-2.0, -0.2]], np.eye(2), [[1.0, 0.5], [0.0, 2.0]], np.zeros((2, 2)))
    >>> found = rational_matrix(frequency_response(truth, np.geomspace(0.1, 50.0, 60)), poles=2)
    >>> np.unique(found.system.poles().round(3)).size, bool(found.rms < 1e-8)
    (2, True)
    """
    if response.dt:
        raise ValueError("a continuous response is wanted: from_response fits a state space to a sampled one")
    kept = np.asarray(response.omega) > 0.0
    w, h = np.asarray(response.omega, float)[kept], np.asarray(response.frdata, complex)[:, :, kept]
    sizes = np.sqrt(np.mean(np.square(np.abs(h)), axis=2)) if h.size else np.zeros(1)
    if not np.isfinite(h).all() or not (sizes > 0.0).all():
        raise ValueError("the response must be finite, and no entry zero everywhere")
    if poles < 1 or 2 * len(w) <= 2 * poles + direct:
        raise ValueError(f"{len(w)} frequencies for {poles} poles: take fewer, at least one")
    unit = float(np.exp(np.mean(np.log(w[[0, -1]]))))
    s, entries = 1j * w / unit, np.asarray(h / sizes[:, :, None], complex).reshape(-1, len(w))
    p = _first(w / unit, poles)
    for _ in range(iterations):
        new = _next(s, entries, p, direct, stable)
        done = np.abs(np.sort_complex(new) - np.sort_complex(p)).max() < SETTLED * np.abs(p).max()
        p = new
        if done:
            break
    columns = _columns(s, p, direct)
    r = np.array([_real(columns, one) for one in entries]) * sizes.reshape(-1, 1)
    said = (columns @ r.T).T.reshape(h.shape)
    error = np.abs(said - h) / sizes[:, :, None]
    system = _realised(p * unit, r.reshape(*h.shape[:2], -1), unit, direct)
    return RationalFit(system, w, error.max(axis=(0, 1)).astype(complex), float(np.sqrt(np.mean(np.square(error)))))


def _first(w: Array, count: int) -> Complex:
    """Lightly damped pairs over the band, and a real pole of an odd number."""
    at = np.geomspace(w[0], w[-1], count // 2 + 2)[1:-1] if count > 1 else np.zeros(0)
    pairs = np.concatenate([[-LIGHT * one + 1j * one, -LIGHT * one - 1j * one] for one in at]) if len(at) else at
    return np.concatenate([np.asarray(pairs, complex), np.full(count % 2, -1.0 + 0j)])


def _columns(s: Complex, p: Complex, direct: bool) -> Complex:
    """1/(s - p) of real poles; the sum and j times the difference of both of a pair; 1 for D."""
    out, i = [], 0
    while i < len(p):
        one = 1.0 / (s - p[i])
        if p[i].imag == 0.0:
            out.append(one)
            i += 1
        else:
            other = 1.0 / (s - p[i].conj())
            out += [one + other, 1j * (one - other)]
            i += 2
    return np.stack([*out, *[np.ones_like(s)] * direct], axis=1)


def _real(columns: Complex, target: Complex) -> Array:
    rows = np.vstack([columns.real, columns.imag])
    return np.asarray(np.linalg.lstsq(rows, np.concatenate([target.real, target.imag]), rcond=None)[0])


def _next(s: Complex, entries: Complex, p: Complex, direct: bool, stable: bool) -> Complex:
    """The zeros of sigma."""
    own, shared = _columns(s, p, direct), _columns(s, p, False)
    rows, right = [], []
    for h in entries:
        both = np.hstack([own, -h[:, None] * shared, h[:, None]])
        r = np.asarray(np.linalg.qr(np.vstack([both.real, both.imag]), mode="r"))
        r = r[own.shape[1] :, own.shape[1] :]
        rows.append(r[:, :-1])
        right.append(r[:, -1])
    c = np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]
    blocks, force = _blocks(p)
    found = np.linalg.eigvals(block_diag(*blocks) - np.outer(np.concatenate(force), c))
    found = np.where(found.real > 0.0, -found.conj(), found) if stable else found
    return _paired(found)


def _blocks(p: Complex) -> tuple[list[Array], list[Array]]:
    """A and b of each pole or pair, whose output c reads the columns of `_columns`."""
    blocks, force, i = [], [], 0
    while i < len(p):
        if p[i].imag == 0.0:
            blocks.append(np.array([[p[i].real]]))
            force.append(np.ones(1))
            i += 1
        else:
            blocks.append(np.array([[p[i].real, p[i].imag], [-p[i].imag, p[i].real]]))
            force.append(np.array([2.0, 0.0]))
            i += 2
    return blocks, force


def _paired(found: Complex) -> Complex:
    """Real poles first, then both of each pair, that of positive imaginary part before the other."""
    found = np.where(np.abs(found.imag) < 1e-12 * np.abs(found), found.real, found)
    pairs = [[one, one.conj()] for one in found[found.imag > 0.0]]
    return np.concatenate([found[found.imag == 0.0], np.asarray(pairs, complex).reshape(-1)])


def _realised(p: Complex, r: Array, unit: float, direct: bool) -> ct.StateSpace:
    """Every input drives states of its own; r (ny, nu, columns) in s/unit."""
    blocks, force = _blocks(p)
    ny, nu = r.shape[:2]
    residues = unit * (r[:, :, :-1] if direct else r)
    a = block_diag(*[block_diag(*blocks)] * nu)
    b = block_diag(*[np.concatenate(force)[:, None]] * nu)
    c = np.hstack([residues[:, i] for i in range(nu)])
    return ct.ss(a, b, c, r[:, :, -1] if direct else np.zeros((ny, nu)))
