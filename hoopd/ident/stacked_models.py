"""Models of one output each as one model of all outputs, as armax, oe and bj need it for data of several outputs.

Rules of this file: the rows share inputs and step; their errors count as independent of each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.estimation_report import EstimationReport
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.models import Innovations, Polynomials

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class StackedModels(IdentifiedModel):
    """Rows (one model an output) as one model; `system`, covariance and summary are those of all rows together."""

    rows: tuple[Polynomials, ...]
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(row.output for row in self.rows)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.rows[0].inputs

    @property
    def state_space(self) -> Innovations:
        """The innovation form, the states of the rows under each other."""
        each = [row.state_space for row in self.rows]
        return Innovations(
            _diagonal([one.a for one in each]), np.vstack([one.b for one in each]),
            _diagonal([one.c for one in each]), np.vstack([one.d for one in each]),
            _diagonal([one.k for one in each]), each[0].dt,
            r=_diagonal([np.zeros((1, 1)) if one.r is None else one.r for one in each]),
            inputs=self.inputs, outputs=self.outputs,
        )  # fmt: skip

    @property
    def system(self) -> ct.StateSpace:
        """From u to y."""
        return self.state_space.system

    def deviations(self) -> dict[str, float]:
        """Standard errors of the coefficients of each row, by coefficient and output; empty without a covariance."""
        return {
            f"{name} ({row.output})": sd for row in self.rows for name, sd in row.deviations().items()
        }  # fmt: skip


def stack(models: Sequence[Polynomials]) -> StackedModels:
    """Put models of one output each together as one model of all outputs.

    Parameters
    ----------
    models : sequence of Polynomials
        One an output, all with the same inputs and step.

    Returns
    -------
    StackedModels
        A result like any other: it simulates, predicts, sums itself up, and has the regions of its rows.

    Raises
    ------
    ValueError
        No model, or models of other inputs or steps.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import Polynomials, stack
    >>> fast, slow = (Polynomials(0.1, np.array([1.0, -a]), (np.array([0.0, 1.0]),), output=y)
    ...               for a, y in ((0.5, "fast"), (0.9, "slow")))
    >>> both = stack([fast, slow])
    >>> both.outputs, both.system.dcgain().ravel().round(6)
    (('fast', 'slow'), array([ 2., 10.]))
    """
    rows = tuple(models)
    if not rows:
        raise ValueError("no model given")
    for row in rows[1:]:
        if row.nu != rows[0].nu or not np.isclose(row.dt, rows[0].dt, rtol=1e-6, atol=0.0):
            raise ValueError(f"{row.output} has {row.nu} inputs and a step of {row.dt} s, {rows[0].output} other ones")
    reports = [row.report for row in rows if row.report is not None]
    return StackedModels(rows, _common(reports) if len(reports) == len(rows) else None)


def _common(reports: Sequence[EstimationReport]) -> EstimationReport:
    notes = tuple(dict.fromkeys(text for one in reports for text in one.warnings))
    choices = tuple(dict.fromkeys(text for one in reports for text in one.choices))
    return EstimationReport(reports[0].method, (), choices, notes)


def _diagonal(blocks: Sequence[Array]) -> Array:
    """Blocks along the diagonal; one without rows or columns takes the other side alone, unlike scipy's."""
    out = np.zeros(tuple(sum(one.shape[side] for one in blocks) for side in (0, 1)))
    i, j = 0, 0
    for one in blocks:
        out[i : i + one.shape[0], j : j + one.shape[1]] = one
        i, j = i + one.shape[0], j + one.shape[1]
    return out
