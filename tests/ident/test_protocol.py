"""Every result speaks one protocol; systems of python-control and their responses stand wherever a model does."""

from __future__ import annotations

import ast
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import control as ct
import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd import ident
from hoopd.ident import IdentificationWarning, arx, compare, iddata, oe, predict, residuals, simulate
from hoopd.ident.data import Data

DT = 0.1
TRUE = ct.tf([1.0, 0.5], [1.0, -1.5, 0.7], DT)


@pytest.fixture(scope="module")
def data() -> Data:
    u, e = np.random.default_rng(0).standard_normal((2, 400))
    return iddata(lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.2 * e, u, DT)


def oscillator(p: np.ndarray) -> Any:
    return ct.ss([[p[0], p[1]], [1.0, 0.0]], [[1.0], [0.0]], [[1.0, 0.5]], [[0.0]], DT)


def step(x: np.ndarray, u: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
    return np.stack([p[0] * x[0] - 0.7 * x[1] + u[0], x[0]])


RESULTS: dict[str, Callable[[Data], Any]] = {
    "ARX": lambda d: arx(d, 2, 2),
    "ARX of several outputs": lambda d: ident.varx(d, 2, 2),
    "ARMAX": lambda d: ident.armax(d, 2, 2, 1),
    "output error": lambda d: oe(d, 2, 2),
    "Box-Jenkins": lambda d: ident.bj(d, 2, 1, 1, 2),
    "subspace": lambda d: ident.subspaceid(d, 2),
    "prediction errors (PEM)": lambda d: ident.pem(d, 2),
    "grey box": lambda d: ident.structured_pem(d, oscillator, [1.4, -0.6]),
    "nonlinear grey box": lambda d: ident.nonlinear_pem(
        d, step, lambda x, u, p, t: x[:1] + 0.5 * x[1:], [1.4], [0.0, 0.0], process=1e-3, measurement=0.04
    ),
    "Hammerstein-Wiener": lambda d: ident.hammerstein_wiener(
        d, 2, [0.0], output_map=lambda z, p: z + p[0], starts=1
    ),
    "impulse response": lambda d: ident.impulseest(d, 40),
    "frequency response": lambda d: ident.tfest(d, segment=100),
    "basis functions": lambda d: ident.fit_basis(d, ident.kautz([0.75 + 0.37j], DT)),
    "rational fit": lambda d: ident.rational(ident.between(ident.tfest(d).system, 0.5, 20.0), 2),
}  # fmt: skip


@pytest.fixture(scope="module")
def results(data: Data) -> dict[str, Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IdentificationWarning)
        return {name: make(data) for name, make in RESULTS.items()}


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_speaks_the_protocol(results: dict[str, Any], data: Data, name: str) -> None:
    model = results[name]
    assert isinstance(model.system, ct.InputOutputSystem)
    from_data, from_rest = model.simulate(data), model.simulate(np.ones(30)) if name != "rational fit" else None
    assert from_data.shape == (400, 1) and (from_rest is None or from_rest.shape == (30, 1))
    assert np.array_equal(simulate(model, data), from_data)
    for horizon in (1, 5, np.inf):
        said = model.predict(data, horizon)
        assert said.shape == (400, 1) and np.array_equal(said, predict(model, data, horizon))
    assert model.residuals(data).errors.shape == (400, 1)
    assert isinstance(model.residuals(data).warnings, list)
    (compared,) = compare({"it": model}, data)
    assert float(compared.percent[np.inf][0]) > 75.0


@pytest.mark.parametrize("name", RESULTS)
def test_a_summary_reads_as_a_table_and_is_plain_data(results: dict[str, Any], data: Data, name: str) -> None:
    told = results[name].summary(data)
    assert told["method"] == name and isinstance(told["warnings"], list)
    assert name in str(told) and str(told) == repr(told)
    assert repr(results[name]).splitlines()[0] == str(told).splitlines()[0]
    assert told["fit_percent"]["validation"]["simulation"]["y"] > 75.0
    for one in told["estimates"].values():
        assert np.isfinite(one["value"])
    known = [one["standard_error"] for one in told["estimates"].values()]
    if name not in {"subspace", "frequency response", "rational fit"}:
        assert known and all(sd is not None and sd >= 0.0 for sd in known)


def test_a_report_holds_what_was_warned_of_and_warns_all_the_same(data: Data) -> None:
    with pytest.warns(IdentificationWarning, match="order too high") as caught:
        model = oe(data, 5, 5)
    assert model.report is not None and model.report.method == "output error" and model.report.data == (data,)
    assert any("order too high" in one for one in model.report.warnings)
    assert all(one.filename == __file__ for one in caught)
    assert "warning: order too high" in str(model.summary())


def systems() -> list[Any]:
    w = np.linspace(0.0, np.pi / DT, 400)
    return [TRUE, ct.ss(TRUE), ct.frd(TRUE, w)]


@pytest.mark.parametrize("system", systems(), ids=["tf", "ss", "frd"])
def test_python_control_stands_wherever_a_model_does(system: Any, data: Data) -> None:
    rest = simulate(system, data, "zero")[:, 0]
    assert np.allclose(rest, lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], data.u[:, 0]), atol=2e-2)
    assert predict(system, data, 10).shape == (400, 1)
    report = residuals(system, data, x0="zero")
    assert report.errors.std() < 0.25 and all(one.passed for one in report.white)
    assert compare([system, arx(data, 2, 2)], data)[0].percent[1][0] > 90.0


def test_a_continuous_system_is_sampled_with_held_inputs(data: Data) -> None:
    lag = ct.tf([1.0], [1.0, 1.0])
    assert np.allclose(simulate(lag, data, "zero"), simulate(ct.c2d(lag, DT), data, "zero"))
    with pytest.raises(ValueError, match="an array has no step"):
        simulate(lag, np.ones(5))


def test_a_transfer_matrix_needs_no_slycot() -> None:
    matrix = ct.tf([[[1.0], [2.0]], [[0.5], [3.0]]], [[[1.0, -0.5], [1.0, -0.2]], [[1.0], [1.0, 0.3]]], DT)
    u = np.random.default_rng(1).standard_normal((50, 2))
    parts = [[lfilter(n, d, np.r_[0.0, v][: len(v)] if len(d) > 1 else v) for n, d, v in row] for row in (
        [([1.0], [1.0, -0.5], u[:, 0]), ([2.0], [1.0, -0.2], u[:, 1])],
        [([0.5], [1.0], u[:, 0]), ([3.0], [1.0, 0.3], u[:, 1])],
    )]  # fmt: skip
    assert np.allclose(simulate(matrix, u), np.array([np.sum(row, axis=0) for row in parts]).T)


def test_a_response_says_where_it_knows_nothing(data: Data) -> None:
    with pytest.warns(IdentificationWarning, match="known from 1 to 5 rad/s"):
        simulate(ct.frd(TRUE, np.linspace(1.0, 5.0, 50)), data)


@pytest.mark.parametrize("wrong", ["arx", None, 3, [1.0]], ids=repr)
@pytest.mark.parametrize("call", [simulate, predict, residuals])
def test_what_is_no_model_is_one_clear_line(call: Callable[..., Any], wrong: Any, data: Data) -> None:
    with pytest.raises(TypeError, match=r"a model is wanted .* not an? ") as error:
        call(wrong, data)
    assert "\n" not in str(error.value)
    strange = [wrong] if isinstance(wrong, str) else "rubbish"
    with pytest.raises(TypeError, match=r"data .*wanted") as error:
        call(TRUE, strange)
    assert "\n" not in str(error.value)


def test_models_without_names_are_called_as_their_estimators(data: Data) -> None:
    found = compare([arx(data, 2, 2), oe(data, 2, 2), oe(data, 1, 1)], data)
    assert [one.name for one in found] == ["ARX", "output error 1", "output error 2"]
    assert str(found).splitlines()[1].startswith("ARX") and found[0].criteria is not None
    assert compare(arx(data, 2, 2), data)[0].name == "ARX"


def test_arrays_of_either_layout_are_taken_and_the_turned_one_is_told() -> None:
    y, u = np.random.default_rng(0).standard_normal((2, 100)), np.arange(100.0)
    with pytest.warns(IdentificationWarning, match=r"y \(2, 100\) taken as \(channels, n\); time_axis=1 says so"):
        turned = iddata(y, u, DT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        straight, told = iddata(y.T, u, DT), iddata(y, u[None], DT, time_axis=1)
    for one in (turned, told):
        assert np.array_equal(one.y, straight.y) and np.array_equal(one.u, straight.u)
    assert repr(straight) == "Data(100 samples, step 0.1 s from 0 s; outputs y1, y2; inputs u)"
    square = iddata(np.eye(3), np.ones((3, 5)).T[:3, :1], DT)
    assert square.n == 3 and square.ny == 3


def test_type_checkers_see_the_names_that_are_looked_up() -> None:
    tree = ast.parse(Path(ident.__file__).read_text(encoding="utf-8"))
    (block,) = [one for one in tree.body if isinstance(one, ast.If)]
    seen = {
        name.name: one.module.removeprefix("hoopd.ident.")
        for one in block.body
        if isinstance(one, ast.ImportFrom) and one.module
        for name in one.names
    }
    assert seen == ident._MODULES and sorted(seen) == sorted(ident.__all__)


def test_an_old_name_says_the_new_one() -> None:
    with pytest.raises(AttributeError, match=r"hoopd.ident.scaled is called hoopd.ident.scale now"):
        _ = ident.scaled


def test_a_first_arx_loads_neither_control_nor_matplotlib() -> None:
    program = (
        "import sys; import numpy as np; from hoopd.ident import arx, iddata\n"
        "u = np.random.default_rng(0).standard_normal(200); arx(iddata(np.cumsum(u) * 0.1, u), 1, 1)\n"
        "print(sorted({'control', 'matplotlib', 'scipy.signal', 'scipy.stats', 'casadi'} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"
