"""Data and responses over frequency: transforms, slices and the algebra that python-control lacks."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

from hoopd.ident import etfe, frequencydata as fd
from hoopd.ident.data import iddata

W = np.geomspace(0.1, 20.0, 40)


def random_system(seed: int, ny: int = 2, nu: int = 2, dt: float = 0.1) -> ct.StateSpace:
    rng = np.random.default_rng(seed)
    a = 0.85 * np.linalg.qr(rng.standard_normal((4, 4)))[0]
    return ct.ss(a, rng.standard_normal((4, nu)), rng.standard_normal((ny, 4)), rng.standard_normal((ny, nu)), dt)


def test_the_transform_keeps_power_and_knows_its_step() -> None:
    rng = np.random.default_rng(0)
    data = fd.fft(iddata(rng.standard_normal((4000, 2)), rng.standard_normal(4000), 0.02, outputs=["a", "b"]))
    assert data.w[-1] == pytest.approx(np.pi / 0.02) and data.hz[1] == pytest.approx(1.0 / 80.0)
    assert np.mean(np.abs(data.y) ** 2) == pytest.approx(1.0, abs=0.06)
    part = data.between_hz(2.0, 3.0)
    assert (part.hz[0], part.hz[-1]) == pytest.approx((2.0, 3.0)) and part.between(0.0, 15.0).w[-1] <= 15.0
    assert fd.frequency_axis(0.02, 5)[-1] == pytest.approx(np.pi / 0.02)


def test_a_periodic_record_gives_the_response_exactly() -> None:
    system, n = random_system(1), 64
    each = []
    for seed in range(3):
        u = np.tile(np.random.default_rng(seed).standard_normal((n, 2)), (8, 1))
        y = ct.forced_response(system, U=u.T).outputs.T
        each.append(iddata(y, u, 0.1)[-n:])
    found = etfe(each)
    assert np.allclose(found.frdata, fd.frequency_response(system, found.omega).frdata, atol=1e-10) and found.dt == 0.1
    with pytest.raises(ValueError, match="2 inputs want"):
        etfe(each[0])


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_algebra_is_that_of_the_systems(sign: int) -> None:
    one, two = random_system(2), random_system(3)
    g, h = fd.frequency_response(one, W), fd.frequency_response(two, W)
    assert np.allclose(fd.feedback(g, two, sign).frdata, fd.frequency_response(ct.feedback(one, two, sign), W).frdata)
    assert np.allclose((fd.inverse(g) * g).frdata, np.eye(2)[:, :, None])
    row = ct.ss(one.A, one.B, one.C[:1], one.D[:1], 0.1)
    assert np.allclose(fd.stacked(fd.frequency_response(row, W), g).frdata[0], g.frdata[0])
    assert fd.beside(g, h).frdata.shape == (2, 4, len(W)) and fd.beside(g, h).dt == 0.1
    assert np.allclose(fd.root(g).frdata ** 2, g.frdata)
    assert fd.between_hz(g, 1.0, 2.0).omega.min() >= 2 * np.pi and fd.between(g, 1.0, 2.0).dt == 0.1
    assert fd.sampled(g + h, 0.1).dt == 0.1


def test_what_does_not_fit_is_refused() -> None:
    g = fd.frequency_response(random_system(2), W)
    with pytest.raises(ValueError, match="different frequencies"):
        fd.beside(g, fd.frequency_response(random_system(3), W[:-1]))
    with pytest.raises(ValueError, match="own frequencies"):
        fd.frequency_response(g, [0.15])
    with pytest.raises(ValueError, match="rising"):
        fd.frequencydata([1.0, 2.0], None, [2.0, 1.0])
    with pytest.raises(ValueError, match="half of the sampling"):
        fd.frequencydata([1.0, 2.0], None, [1.0, 40.0], 0.1)
    with pytest.raises(ValueError, match="missing"):
        fd.fft(iddata([1.0, np.nan, 2.0]))
