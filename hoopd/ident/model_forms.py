"""Whatever is a model as a form that predicts: results of this package, python-control's systems, frequency responses.

Rules of this file: python-control is looked at only where it has been imported; what is no model is a TypeError in one
line.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.identified_model import FreeModel, IdentifiedModel
from hoopd.ident.models import Innovations
from hoopd.ident.statespace.sampling import sampled_form

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]


def innovation_form(model: Any, dt: float | None = None) -> Innovations:
    """Give the innovation form of any linear model: a result of this package, or a python-control system.

    Parameters
    ----------
    model : any model
        What is linear; a python-control system becomes an output-error model.
    dt : float, optional
        Step in s at which a continuous one is sampled, inputs held; without it that stays continuous (dt = 0).

    Returns
    -------
    Innovations
        The same model.

    Raises
    ------
    TypeError
        What is no model, or no linear one.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import innovation_form
    >>> form = innovation_form(control.tf([1.0], [1.0, 1.0]), dt=0.1)
    >>> form.a.round(4), form.nx, form.dt  # exp(-0.1)
    (array([[0.9048]]), 1, 0.1)
    """
    found = predicting_form(model, dt)
    return found if isinstance(found, Innovations) else found.state_space


def predicting_form(model: Any, dt: float | None = None) -> Innovations | FreeModel:
    """The innovation form of a model, or the model itself where it has none; a continuous one sampled at `dt` s."""
    if isinstance(model, FreeModel):
        return model
    if isinstance(model, IdentifiedModel):
        return _at_step(model.state_space, dt)
    if is_response(model):
        from hoopd.ident.response_model import ResponseModel

        return ResponseModel(model)
    if is_system(model):
        return _at_step(_of_system(model, dt), dt)
    raise TypeError(
        f"a model is wanted (a result of hoopd.ident, or a python-control system or FRD), not {_called(model)}"
    )


def root_form(model: Any) -> Innovations:
    """The form whose poles and zeros are the model's: of one with a dead time the continuous one without it."""
    return getattr(model, "undelayed", None) or innovation_form(model)


def is_response(model: Any) -> bool:
    """Whether it is a frequency response of python-control."""
    ct = sys.modules.get("control")
    return ct is not None and isinstance(model, ct.FrequencyResponseData)


def is_system(model: Any) -> bool:
    """Whether it is a linear system of python-control."""
    ct = sys.modules.get("control")
    return ct is not None and isinstance(model, ct.StateSpace | ct.TransferFunction)


def _of_system(system: ct.StateSpace | ct.TransferFunction, dt: float | None) -> Innovations:
    """A python-control system as an output-error model; a step that it leaves open is `dt`."""
    import control as ct

    own = system if isinstance(system, ct.StateSpace) else _realised(system)
    step = (dt or 1.0) if own.dt is True or (own.nstates == 0 and not own.dt) else float(own.dt or 0.0)
    gain = np.zeros((own.nstates, own.noutputs))
    return Innovations(
        own.A, own.B, own.C, own.D, gain, step, inputs=tuple(own.input_labels), outputs=tuple(own.output_labels)
    )  # fmt: skip


def named_models(models: Any) -> dict[str, Any]:
    """Models by name: of a mapping its own; of one or several the estimator's name, numbered where two are alike."""
    if isinstance(models, Mapping):
        return dict(models)
    each = list(models) if isinstance(models, Sequence) and not isinstance(models, str) else [models]
    names = [_name(one) for one in each]
    found: dict[str, Any] = {}
    for name, one in zip(names, each, strict=True):
        alike = names.count(name) > 1
        found[f"{name} {1 + sum(own.startswith(f'{name} ') for own in found)}" if alike else name] = one
    return found


def _name(model: Any) -> str:
    report = getattr(model, "report", None)
    return report.method if report is not None else type(model).__name__


def _at_step(model: Innovations, dt: float | None) -> Innovations:
    if model.dt != 0.0 or dt is None:
        return model
    return sampled_form(model, dt)


def _realised(system: ct.TransferFunction) -> ct.StateSpace:
    """A state space, entry by entry: without slycot python-control has none of several inputs or outputs."""
    import control as ct
    from scipy.linalg import block_diag

    parts = []
    for i in range(system.noutputs):
        for j in range(system.ninputs):
            entry = ct.TransferFunction(system.num[i][j], system.den[i][j], system.dt)
            parts.append((i, j, _entry(entry)))
    a = block_diag(*(part.A for _, _, part in parts)).reshape((sum(part.nstates for *_, part in parts),) * 2)
    b = np.vstack([np.outer(part.B[:, 0], np.eye(system.ninputs)[j]) for _, j, part in parts])
    c = np.hstack([np.outer(np.eye(system.noutputs)[i], part.C[0]) for i, _, part in parts])
    d = np.zeros((system.noutputs, system.ninputs))
    for i, j, part in parts:
        d[i, j] = part.D[0, 0]
    return ct.StateSpace(a, b, c, d, system.dt, inputs=system.input_labels, outputs=system.output_labels)


def _entry(entry: ct.TransferFunction) -> ct.StateSpace:
    import control as ct
    from scipy.signal import tf2ss

    num, den = np.trim_zeros(entry.num[0][0], "f"), np.trim_zeros(entry.den[0][0], "f")
    if len(num) > len(den):
        raise ValueError("the transfer function has more zeros than poles: no samples follow from it")
    if len(den) == 1:
        gain = float(num[0] / den[0]) if len(num) else 0.0
        return ct.StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[gain]], entry.dt)
    if not len(num):
        num = np.zeros(1)
    return ct.StateSpace(*tf2ss(num, den), entry.dt, remove_useless_states=False)


def _called(model: Any) -> str:
    return f"{'an' if type(model).__name__[:1].lower() in 'aeiou' else 'a'} {type(model).__name__}"
