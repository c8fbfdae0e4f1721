"""Continuous models whose inputs act after a dead time: a state space of finite order and a delay beside it.

Rules of this file: inputs are held between samples, as everywhere in this package; what has no dead time is an
innovation form and none of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from hoopd import ident
from hoopd.ident.estimation_report import EstimationReport
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.models import Innovations, Polynomials, response_at
from hoopd.ident.statespace.sampling import held, sampled_form

if TYPE_CHECKING:
    import control as ct

    from hoopd.ident.data import Data

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A dead time that is a whole number of steps but for so much of one.
WHOLE = 1e-9


@dataclass(frozen=True, repr=False)
class DelayedModel(FreeModel):
    """A continuous model whose inputs act after dead times, which no finite state space has.

    Attributes
    ----------
    undelayed : Innovations
        The model without its dead times (dt = 0).
    delays : tuple of float
        How late each input is, in s.
    report : EstimationReport or None
        None: it was not estimated in this form.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, d2c
    >>> late = d2c(Polynomials(0.1, a=np.array([1.0, -0.8]), b=(np.array([0.0, 0.0, 0.0, 2.0]),)))
    >>> late.delays, late.undelayed.a.round(3)  # ln(0.8)/0.1
    ((0.2,), array([[-2.231]]))
    >>> late.sampled(0.1).a.shape  # with the two inputs before as states
    (3, 3)
    """

    undelayed: Innovations
    delays: tuple[float, ...]
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def state_space(self) -> Innovations:
        """Refused: a dead time has infinitely many states."""
        raise TypeError("a continuous model with a dead time has no finite state space: c2d(model, dt) samples it")

    @property
    def system(self) -> ct.StateSpace:
        """From u to y without the dead times, which python-control has no place for; they are `delays`."""
        return self.undelayed.system

    def sampled(self, dt: float) -> Innovations:
        """Every dt s, inputs held; a dead time between two samples is split between them."""
        if not 0.0 < dt < np.inf:
            raise ValueError(f"a step is a positive time in s, not {dt:g}")
        whole = sampled_form(self.undelayed, dt)
        return _with_past_inputs(whole, self.undelayed, self.delays, dt)

    def response(self, w: ArrayLike) -> Complex:
        """(nw, ny, nu) at w in rad/s, dead times included."""
        s = 1j * np.asarray(w, dtype=float).reshape(-1)
        return np.asarray(response_at(self.undelayed, s) * np.exp(-s[:, None, None] * np.array(self.delays)))

    def simulate(self, data: Data | ArrayLike, x0: Any = "estimate", *, seed: int | None = None) -> Array:
        """Outputs (n, ny) from the inputs of data alone."""
        return ident.simulate(self.sampled(_step(data)), data, x0, seed=seed)

    def predict(self, data: Data, horizon: float = 1, x0: Any = "estimate") -> Array:
        """Outputs (n, ny) from the inputs and from the outputs up to `horizon` samples before."""
        return ident.predict(self.sampled(_step(data)), data, horizon, x0)

    def __repr__(self) -> str:
        names = self.undelayed.inputs or [f"u{k + 1}" for k in range(len(self.delays))]
        late = ", ".join(f"{name} {delay:g} s" for name, delay in zip(names, self.delays, strict=True))
        return f"{self.undelayed}\ndead time: {late}"


def undelayed(model: Any) -> tuple[Any, tuple[float, ...]]:
    """A sampled polynomial model or transfer function without whole steps of dead time beyond the one of a hold, and
    these dead times in s by input; of others the model itself and none."""
    own = _as_polynomials(model)
    if own is None:
        return model, ()
    # b0 = 0 is the hold's; an input that never acts is not late
    late = [max(int(np.argmax(b != 0.0)) - 1, 0) if b.any() else 0 for b in own.b]
    if not any(late):
        return model, ()
    bare = replace(
        own, b=tuple(b[k:] for b, k in zip(own.b, late, strict=True)), names=(), values=np.zeros(0), covariance=None,
        report=None,
    )  # fmt: skip
    return bare, tuple(k * own.dt for k in late)


def _as_polynomials(model: Any) -> Polynomials | None:
    if isinstance(model, Polynomials):
        return model
    from hoopd.ident.model_forms import is_system

    if (
        not is_system(model)
        or not hasattr(model, "num_list")
        or model.noutputs != 1
        or not model.dt
        or model.dt is True
    ):
        return None
    b, f = [], []
    for above, below in zip(model.num_list[0], model.den_list[0], strict=True):
        num, den = np.trim_zeros(np.atleast_1d(above), "f"), np.atleast_1d(below)
        if len(num) > len(den):
            return None
        # in q^-1; poles at zero are the relative degree's
        b.append(np.concatenate([np.zeros(len(den) - len(num)), num]) / den[0])
        f.append(np.trim_zeros(den, "b") / den[0])
    return Polynomials(
        float(model.dt), b=tuple(b), f=tuple(f), inputs=tuple(model.input_labels), output=model.output_labels[0]
    )


def _step(data: Any) -> float:
    if not hasattr(data, "dt"):
        raise TypeError("a continuous model with a dead time runs on data (iddata), whose step it takes")
    return float(data.dt)


def _with_past_inputs(whole: Innovations, free: Innovations, delays: Sequence[float], dt: float) -> Innovations:
    """The sampled model with the inputs of the steps before as states.

    With tau = m dt + f, 0 <= f < dt, what was put in m + 1 steps before still acts for f, and what was put in m steps
    before for the rest.
    """
    parts = [_split(delay, dt) for delay in delays]
    past = [m + (f > 0.0) for m, f in parts]
    starts = whole.nx + np.concatenate([[0], np.cumsum(past)]).astype(int)
    n, size = whole.nx, int(starts[-1])
    a, b = np.zeros((size, size)), np.zeros((size, whole.nu))
    c, d = np.zeros((whole.ny, size)), np.zeros((whole.ny, whole.nu))
    a[:n, :n], c[:, :n] = whole.a, whole.c
    for j, (m, f) in enumerate(parts):
        old = held(free.a, f) @ free.b[:, j] if f > 0.0 else np.zeros(n)
        before = linalg.expm(free.a * (dt - f)) @ old
        recent = held(free.a, dt - f) @ free.b[:, j]
        for late, force in ((m + 1, before), (m, recent)):
            if late == 0:
                b[:n, j] += force
            elif late <= past[j]:
                a[:n, starts[j] + late - 1] += force
        # y(t_k) sees what acts then: u of m steps before, or where that comes between two samples of m + 1 before
        if past[j] == 0:
            d[:, j] = free.d[:, j]
        else:
            c[:, starts[j] + past[j] - 1] = free.d[:, j]
            b[starts[j], j] = 1.0
            chain = np.arange(starts[j] + 1, starts[j + 1])
            a[chain, chain - 1] = 1.0
    more = size - n
    return replace(
        whole, a=a, b=b, c=c, d=d, k=np.vstack([whole.k, np.zeros((more, whole.ny))]),
        q=None if whole.q is None else np.pad(whole.q, (0, more)),
        s=None if whole.s is None else np.pad(whole.s, ((0, more), (0, 0))),
        x0=None if whole.x0 is None else np.pad(whole.x0, (0, more)),
    )  # fmt: skip


def _split(delay: float, dt: float) -> tuple[int, float]:
    m = int(np.floor(delay / dt + WHOLE))
    rest = delay - m * dt
    return m, rest if rest > WHOLE * dt else 0.0
