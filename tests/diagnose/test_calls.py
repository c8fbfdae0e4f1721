"""Functions at many nodes: numpy's way gives what CasADi's does, and a recursion is a triangular solve."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hoopd.plants.likelihood.batch_calls import MANY, Mapped, _Buffered
from hoopd.plants.likelihood.linear_recursion import backward, bands_of, forward
from hoopd.plants.likelihood.vectorised import Vectorised, takes


def everything() -> ca.Function:
    """Each operation once, a constant, a matrix, and parts that depend on the shared argument alone."""
    x, p = ca.SX.sym("x", 4), ca.SX.sym("p", 2)
    a, b, c, d = (x[i] for i in range(4))
    shared = ca.sin(p[0]) + p[1] ** 2.5
    terms = [
        a + b, a - b, a * b, a / b, -a, ca.exp(a), ca.log(ca.fabs(b)), ca.sqrt(ca.fabs(a)), a**2, 2 * a, ca.sin(a),
        ca.cos(b), ca.tan(a), ca.asin(a / 4), ca.acos(b / 4), ca.atan(c), ca.atan2(a, b), ca.hypot(c, d), ca.floor(a),
        ca.ceil(b), ca.fmod(a, b), ca.fabs(c), ca.sign(d), ca.fmin(a, b), ca.fmax(c, d), ca.if_else(a > b, c, d),
        ca.logic_and(a > 0, b > 0), ca.logic_or(a > 0, b > 0), ca.logic_not(a > 0), a <= b, ca.tanh(a), ca.sinh(a),
        ca.cosh(b), ca.log1p(ca.fabs(a)), ca.expm1(a), 1 / c, ca.fabs(a) ** 1.7, ca.copysign(a, b), a == a, a != b,
        shared * a, shared, ca.SX(3.0),
    ]  # fmt: skip
    matrix = ca.SX(3, 2)
    matrix[0, 0], matrix[2, 1] = a * shared, b
    return ca.Function("everything", [x, p], [ca.vertcat(*terms), ca.densify(matrix)])


def test_numpy_s_way_is_casadi_s() -> None:
    function, n = everything(), 200
    rng = np.random.default_rng(0)
    x, p = rng.uniform(-2.0, 2.0, (n, 4)), np.array([[0.3, 1.2]])
    assert takes(function)
    fast, slow = Vectorised(function, n, (1,))(x, p), _Buffered(function, n, (1,))(x, p)
    for one, other in zip(fast, slow, strict=True):
        assert one.shape == other.shape
        assert np.allclose(one, other, rtol=1e-13, atol=1e-14, equal_nan=True)
    # and with the second argument given at every node
    again = Vectorised(function, n)(x, np.repeat(p, n, axis=0))
    assert all(np.allclose(a, b, rtol=1e-13, atol=1e-14) for a, b in zip(fast, again, strict=True))


def test_calls_do_not_write_into_earlier_results() -> None:
    x = ca.SX.sym("x", 2)
    mapped = Mapped(ca.Function("f", [x], [ca.sin(x) * 2]), MANY)
    first = mapped(np.ones((MANY, 2)))[0]
    kept = first.copy()
    mapped(np.full((MANY, 2), 5.0))
    assert np.array_equal(first, kept)
    with pytest.raises(ValueError, match="expected"):
        mapped(np.ones((MANY, 3)))


def test_an_operation_that_is_not_in_the_tables_is_left_to_casadi() -> None:
    x = ca.SX.sym("x")
    unusual = ca.Function("unusual", [x], [ca.erf(x)])
    assert not takes(unusual)
    assert Mapped(unusual, MANY)(np.full(MANY, 0.5))[0][0, 0, 0] == pytest.approx(0.5204998778)
    with pytest.raises(ValueError, match="not in the tables"):
        Vectorised(unusual, 3)


def test_a_recursion_and_its_adjoint_are_triangular_solves() -> None:
    rng = np.random.default_rng(2)
    n, size, m = 40, 5, 3
    steps, right = 0.4 * rng.standard_normal((n - 1, size, size)), rng.standard_normal((n, size, m))
    d, r = right.copy(), right.copy()
    for k in range(n - 1):
        d[k + 1] += steps[k] @ d[k]
    for k in range(n - 2, -1, -1):
        r[k] += steps[k].T @ r[k + 1]
    kept, bands = right.copy(), bands_of(steps)
    assert np.allclose(forward(bands, right), d, rtol=1e-12) and np.allclose(backward(bands, right), r, rtol=1e-12)
    assert np.array_equal(right, kept)
