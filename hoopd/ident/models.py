"""What the methods of this room give: polynomial models and state-space models in innovation form.

Both hand out python-control's systems; beside them they hold what those have no place for: the noise, its variance,
the parameters' covariance, the report of their estimation.

Rules of this file: polynomials are in q^-1, the first coefficient belongs to q^0, leading zeros of B are the delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.estimation_report import EstimationReport
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.statespace.change_of_states import in_states
from hoopd.ident.statespace.structure_choice import StructureChoice

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]

ONE = np.ones(1)


@dataclass(frozen=True, repr=False)
class Polynomials(IdentifiedModel):
    """A polynomial model of one output, A(q) y = sum_i B_i(q)/F_i(q) u_i + C(q)/D(q) e.

    Attributes
    ----------
    dt : float
        Step in s.
    a, c, d : ndarray
        Coefficients in q^-1, that of q^0 first, which is 1.
    b : tuple of ndarray
        Coefficients by input; leading zeros are the delay.
    f : tuple of ndarray
        Denominators by input; empty where all of them are 1.
    variance : float
        Variance of the white e.
    names : tuple of str
        Names of the estimated coefficients, such as a1, b1, b2(3) for the third input's.
    values : ndarray, shape (m,)
        The estimated coefficients, in the order of `names`.
    covariance : ndarray, shape (m, m), or None
        Their covariance.
    inputs : tuple of str
        Names of the inputs.
    output : str
        Name of the output.
    report : EstimationReport or None
        Method, data, choices and warnings of the estimation.

    Notes
    -----
    Source: Ljung, System Identification, 1999, 4.33.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials
    >>> model = Polynomials(0.1, a=np.array([1.0, -0.8]), b=(np.array([0.0, 2.0]),))
    >>> model.system.poles().real
    array([0.8])
    >>> round(float(model.system.dcgain()), 6)
    10.0
    """

    dt: float
    a: Array = field(default_factory=lambda: ONE)
    b: tuple[Array, ...] = ()
    c: Array = field(default_factory=lambda: ONE)
    d: Array = field(default_factory=lambda: ONE)
    f: tuple[Array, ...] = ()
    variance: float = 0.0  # of e
    names: tuple[str, ...] = ()
    values: Array = field(default_factory=lambda: np.zeros(0))
    covariance: Array | None = None
    inputs: tuple[str, ...] = ()
    output: str = "y"
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def nu(self) -> int:
        """Inputs."""
        return len(self.b)

    def dynamics(self, i: int) -> tuple[Array, Array]:
        """Numerator and denominator in q^-1 from input i to y: B_i / (A F_i)."""
        return self.b[i], np.convolve(self.a, self.f[i] if self.f else ONE)

    def noise_dynamics(self) -> tuple[Array, Array]:
        """Numerator and denominator in q^-1 from e to y: C / (A D)."""
        return self.c, np.convolve(self.a, self.d)

    @property
    def system(self) -> ct.TransferFunction:
        """From u to y, 1 x nu."""
        import control as ct

        pairs = [in_z(*self.dynamics(i)) for i in range(self.nu)]
        if not pairs:
            raise ValueError("a model without inputs has no system from u to y")
        return ct.TransferFunction(
            [[num for num, _ in pairs]], [[den for _, den in pairs]], self.dt,
            inputs=list(self.inputs) or None, outputs=[self.output],
        )  # fmt: skip

    @property
    def noise(self) -> ct.TransferFunction:
        """From e to y; e has the variance `variance`."""
        import control as ct

        return ct.TransferFunction(*in_z(*self.noise_dynamics()), self.dt)

    @property
    def state_space(self) -> Innovations:
        """The innovation form."""
        return state_space(self)

    def deviations(self) -> dict[str, float]:
        """Standard errors of the coefficients by name; empty without a covariance."""
        return standard_errors(self.names, self.covariance)


@dataclass(frozen=True, repr=False)
class Innovations(IdentifiedModel):
    """A state-space model in innovation form, x+ = a x + b u + k e, y = c x + d u + e with white e.

    Attributes
    ----------
    a : ndarray, shape (nx, nx)
        Dynamics.
    b : ndarray, shape (nx, nu)
        From the inputs.
    c : ndarray, shape (ny, nx)
        To the outputs.
    d : ndarray, shape (ny, nu)
        Direct term.
    k : ndarray, shape (nx, ny)
        Gain of the predictor; 0 is an output-error model.
    dt : float
        Step in s, 0 for continuous time.
    r : ndarray, shape (ny, ny), or None
        Covariance of e.
    q : ndarray, shape (nx, nx), or None
        Covariance of the process noise, where a method knows it.
    s : ndarray, shape (nx, ny), or None
        Covariance of the process noise with that of the outputs.
    x0 : ndarray, shape (nx,), or None
        Initial state of the first experiment.
    singular_values : ndarray or None
        Those by which the order was chosen.
    names, values, covariance : tuple of str, ndarray (m,), ndarray (m, m) or None
        The estimated parameters with their covariance.
    inputs, outputs : tuple of str
        Names of the channels.
    choice : StructureChoice or None
        What the data chose of the structure, where they did.
    report : EstimationReport or None
        Method, data, choices and warnings of the estimation.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Innovations
    >>> a, b, c, k = np.array([[0.8]]), np.array([[2.0]]), np.array([[1.0]]), np.array([[0.3]])
    >>> model = Innovations(a, b, c, np.zeros((1, 1)), k, dt=0.1)
    >>> round(float(model.system.dcgain()), 6)
    10.0
    >>> model.predictor.poles().real
    array([0.5])
    """

    a: Array
    b: Array
    c: Array
    d: Array
    k: Array
    dt: float
    r: Array | None = None
    q: Array | None = None
    s: Array | None = None
    x0: Array | None = None
    singular_values: Array | None = None  # of the order's choice, where there was one
    names: tuple[str, ...] = ()
    values: Array = field(default_factory=lambda: np.zeros(0))
    covariance: Array | None = None
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    choice: StructureChoice | None = None
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def nx(self) -> int:
        """States."""
        return len(self.a)

    @property
    def ny(self) -> int:
        """Outputs."""
        return len(self.c)

    @property
    def nu(self) -> int:
        """Inputs."""
        return int(self.b.shape[1])

    @property
    def state_space(self) -> Innovations:
        """The innovation form, which this is."""
        return self

    def deviations(self) -> dict[str, float]:
        """Standard errors of the coordinates by name; empty without a covariance."""
        return standard_errors(self.names, self.covariance)

    @property
    def system(self) -> ct.StateSpace:
        """From u to y."""
        import control as ct

        return ct.StateSpace(
            self.a, self.b, self.c, self.d, self.dt,
            inputs=list(self.inputs) or None, outputs=list(self.outputs) or None,
        )  # fmt: skip

    @property
    def noise(self) -> ct.StateSpace:
        """From e to y."""
        import control as ct

        return ct.StateSpace(self.a, self.k, self.c, np.eye(self.ny), self.dt)

    @property
    def predictor(self) -> ct.StateSpace:
        """From [u; y] to the one-step prediction: x+ = (a - k c) x + (b - k d) u + k y."""
        import control as ct

        return ct.StateSpace(
            self.a - self.k @ self.c,
            np.hstack([self.b - self.k @ self.d, self.k]),
            self.c,
            np.hstack([self.d, np.zeros((self.ny, self.ny))]),
            self.dt,
        )

    def transformed(self, t: Array) -> Innovations:
        """In the states T^-1 x; the covariance of the matrices goes along."""
        return in_states(self, t, np.asarray(np.linalg.inv(t)))


def matrices_alone(model: Innovations) -> Innovations:
    """Without what belongs to the estimate of these very matrices: the numbers of others are others."""
    return replace(
        model, names=(), values=np.zeros(0), covariance=None, singular_values=None, choice=None, report=None
    )  # fmt: skip


def response_at(model: Innovations, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Response (k, ny, nu) from u at points z (k,) of the plane of the model; for code of this room."""
    minus = z[:, None, None] * np.eye(model.nx) - model.a
    return np.asarray(model.c @ np.linalg.solve(minus, np.broadcast_to(model.b, (len(z), *model.b.shape))) + model.d)


Model = Polynomials | Innovations


def innovations(system: ct.StateSpace, k: Array | None = None, r: Array | None = None) -> Innovations:
    """Take a discrete python-control system as an innovation form.

    Parameters
    ----------
    system : control.StateSpace
        From u to y, discrete.
    k : ndarray, shape (nx, ny), optional
        Gain of the predictor; without it 0, an output-error model.
    r : ndarray, shape (ny, ny), optional
        Covariance of the innovations.

    Returns
    -------
    Innovations
        The model.

    Raises
    ------
    ValueError
        The system is continuous.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import innovations
    >>> model = innovations(control.ss([[0.8]], [[2.0]], [[1.0]], [[0.0]], 0.1))
    >>> model.nx, model.dt, model.k
    (1, 0.1, array([[0.]]))
    """
    if not system.dt:
        raise ValueError("a continuous system predicts no samples: sample it first (control.sample_system)")
    gain = np.zeros((system.nstates, system.noutputs)) if k is None else np.asarray(k, dtype=float)
    return Innovations(system.A, system.B, system.C, system.D, gain, float(system.dt), r)


def state_space(model: Polynomials) -> Innovations:
    """Give the innovation form of a polynomial model, in observer form over the common denominator A D F_1 ... F_nu.

    Its predictor has the poles of C F_1 ... F_nu: an unstable A does no harm, an unstable F does.

    Parameters
    ----------
    model : Polynomials
        The model.

    Returns
    -------
    Innovations
        The same model, nx the order of the common denominator.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, state_space
    >>> model = Polynomials(0.1, a=np.array([1.0, -0.8]), b=(np.array([0.0, 2.0]),), c=np.array([1.0, -0.5]))
    >>> form = state_space(model)
    >>> form.a, form.b, np.round(form.k, 9)
    (array([[0.8]]), array([[2.]]), array([[0.3]]))
    """
    fractions = [model.dynamics(i) for i in range(model.nu)]
    factors = [model.d, *model.f]
    common = _product([model.a, *factors])
    own = [_product([num, model.d, *_without(model.f, i)]) for i, (num, _) in enumerate(fractions)]
    noise = _product([model.c, *model.f])
    size = max(len(one) for one in (common, noise, *own))
    den, e = _padded(common, size), _padded(noise, size)
    a = np.eye(size - 1, k=1)
    c = np.zeros((1, size - 1))
    if size > 1:
        a[:, 0], c[0, 0] = -den[1:], 1.0
    rows = [_padded(one, size) for one in own]
    b = np.array([one[1:] - den[1:] * one[0] for one in rows]).reshape(model.nu, size - 1).T
    d = np.array([[one[0] for one in rows]]).reshape(1, model.nu)
    return Innovations(
        a, b, c, d, (e - den)[1:, None], model.dt, r=np.array([[model.variance]]),
        inputs=model.inputs, outputs=(model.output,),
    )  # fmt: skip


def standard_errors(names: Sequence[str], covariance: Array | None) -> dict[str, float]:
    """Roots of the variances by name; empty without a covariance."""
    if covariance is None:
        return {}
    return dict(zip(names, np.sqrt(np.maximum(np.diag(covariance), 0.0)).tolist(), strict=True))


def in_z(numerator: Array, denominator: Array) -> tuple[Array, Array]:
    """Polynomials in q^-1 as polynomials in z of one length, without common zeros at z = 0."""
    size = max(len(numerator), len(denominator))
    num, den = np.zeros(size), np.zeros(size)
    num[: len(numerator)], den[: len(denominator)] = numerator, denominator
    while len(den) > 1 and num[-1] == 0.0 and den[-1] == 0.0:
        num, den = num[:-1], den[:-1]
    return num, den


def _product(factors: Sequence[Array]) -> Array:
    return reduce(np.convolve, factors, ONE)


def _without(factors: Sequence[Array], i: int) -> list[Array]:
    return [one for j, one in enumerate(factors) if j != i]


def _padded(values: Array, size: int) -> Array:
    return np.concatenate([values, np.zeros(size - len(values))])
