"""What every result that says how outputs follow inputs can do, whatever estimator it comes from.

A linear result has a `state_space`, from which simulation and prediction follow; a `FreeModel` (nonlinear, or known at
frequencies only) has none and brings its own.

Rules of this file: the protocol alone; each of its words is a function of the package, by its public name.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd import ident

if TYPE_CHECKING:
    from hoopd.ident.data import Data
    from hoopd.ident.estimation_report import EstimationReport
    from hoopd.ident.models import Innovations
    from hoopd.ident.residualtests import ResidualReport
    from hoopd.ident.result_summary import Summary

Array = NDArray[np.float64]


class IdentifiedModel:
    """The protocol of every result: `system`, `simulate`, `predict`, `residuals`, `summary`."""

    if TYPE_CHECKING:  # a field or a property of every result; one of this class would be a field's default
        report: EstimationReport | None

        @property
        def system(self) -> Any:
            """From u to y, as python-control's object."""

    @property
    def state_space(self) -> Innovations:
        """The innovation form, from which simulation and prediction follow."""
        return ident.innovation_form(self.system)

    def simulate(self, data: Any, x0: Any = "estimate", *, seed: int | None = None) -> Any:
        """Outputs (n, ny) from the inputs alone: of data, or of an input array (n,) or (n, nu) from rest; a list of
        them of a list of experiments."""
        return ident.simulate(self, data, x0, seed=seed)

    def predict(self, data: Any, horizon: float = 1, x0: Any = "estimate") -> Any:
        """Outputs (n, ny) from the inputs and from the outputs up to `horizon` samples before; a list of them of a list
        of experiments."""
        return ident.predict(self, data, horizon, x0)

    def residuals(self, data: Data | Sequence[Data], lags: int = 25) -> ResidualReport:
        """Errors one sample ahead on data, with the tests whether they are white and follow no input."""
        return ident.residuals(self, data, lags)

    def summary(self, data: Data | Sequence[Data] | None = None) -> Summary:
        """Estimates with standard errors, poles, fit and warnings; of `data` the fit there, too."""
        return ident.summary(self, data)

    def __repr__(self) -> str:
        return str(self.summary())


class FreeModel(IdentifiedModel):
    """A result without an innovation form: it simulates and predicts in its own way."""

    @property
    def state_space(self) -> Innovations:
        """Refused: there is none."""
        raise TypeError(f"a {type(self).__name__} has no linear state space with noise")

    @abstractmethod
    def simulate(self, data: Data | ArrayLike, x0: Any = "estimate", *, seed: int | None = None) -> Array:
        """Outputs (n, ny) from the inputs alone."""

    @abstractmethod
    def predict(self, data: Data, horizon: float = 1, x0: Any = "estimate") -> Array:
        """Outputs (n, ny) from the inputs and from the outputs up to `horizon` samples before."""
