"""What tests of a diagnosis ask for by name."""

from __future__ import annotations

import pytest
from diagnose.confirming import FRICTION, PLANT, SIZE, recorded
from diagnose.reports import DRAWN, one_drawing

from hoopd.diagnose.report import markup
from hoopd.plants.likelihood.fitting import HypothesisFit, fit


@pytest.fixture
def drawn_where_it_is_looked_at(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """One and the same drawing for all figures of a page whose words are read."""
    if not DRAWN.search(request.node.name):
        drawing = one_drawing()
        monkeypatch.setattr(markup, "svg", lambda figure: drawing)


@pytest.fixture(scope="session")
def fits() -> tuple[HypothesisFit, HypothesisFit]:
    """Without and with a friction, fitted to data that have it."""
    train = [recorded("train", 1, friction=True)]
    base = fit(train, (), PLANT.values)
    return base, fit(train, (FRICTION,), {**base.values, **SIZE}, like=base, noise=base.noise)


@pytest.fixture(scope="session")
def wrong() -> tuple[HypothesisFit, HypothesisFit]:
    """Without and with a friction that is not there, as if it had been."""
    train = [recorded("train", 1, friction=False)]
    base = fit(train, (), PLANT.values)
    return base, fit(train, (FRICTION,), {**base.values, **SIZE}, like=base, noise=base.noise, move=False)
