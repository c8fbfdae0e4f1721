"""Delays of a sampled loop: held inputs that arrive late, and the Smith predictor.

Rules of this file: python-control's systems in and out; sample times and delays in s. Three answers to the camera's
delay are in this project: the filter fuses late pictures at their own time (`hoopd.core.estimator`; the default), a
law is shaped against the delay (`loopshaping_pid(..., delay_s=)`), or a predictor stands in front of it (here, for
plants that come to rest by themselves quickly enough: see `smith_predictor`).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import control
import numpy as np
from scipy.linalg import expm

Lti: TypeAlias = control.TransferFunction | control.StateSpace


def sample_delay(samples: int, h: float) -> control.TransferFunction:
    """z^-samples, for example of a computation or of pictures on their way."""
    if samples < 0:
        raise ValueError("a delay is no prediction")
    return control.tf([1.0], [1.0, *[0.0] * samples], h)


def held(plant: Lti, h: float, delay_s: float = 0.0) -> control.StateSpace:
    """Plant under a zero-order hold whose inputs arrive `delay_s` late, exact for any delay.

    With delay = d h + r, 0 <= r < h, the sample k -> k + 1 sees u_(k-d-1) for r seconds and u_(k-d) for h - r:
    x_(k+1) = F(h) x_k + F(h - r) G(r) u_(k-d-1) + G(h - r) u_(k-d)   (Astrom, Wittenmark, Computer-Controlled
    Systems, 2.3). The late inputs are states of the result, named after the inputs, the oldest first; the plant's own
    come before them.
    """
    if delay_s < 0.0:
        raise ValueError("a delay is no prediction")
    ss = plant if isinstance(plant, control.StateSpace) else control.ss(plant)
    whole = int(delay_s / h + 1e-9)
    rest = max(delay_s - whole * h, 0.0)
    f, g_rest = _held_over(ss, rest)
    f_after, g_after = _held_over(ss, h - rest)
    n, m, line = ss.nstates, ss.ninputs, whole + (rest > 1e-12)
    a, b = np.zeros((n + line * m, n + line * m)), np.zeros((n + line * m, m))
    a[:n, :n] = f_after @ f
    inputs = np.hstack([a[:, n:], b])  # columns: u_(k-line) ... u_(k-1), u_k
    late = np.zeros((n + line * m, (line + 1) * m))
    late[:n, (line - whole) * m : (line - whole + 1) * m] = g_after
    if line > whole:
        late[:n, :m] += f_after @ g_rest
    late[n:, m:] = np.eye(line * m)
    inputs += late
    a[:, n:], b = inputs[:, : line * m], inputs[:, line * m :]
    if np.any(ss.D):
        raise ValueError("the plant must not answer at once")
    names = [*ss.state_labels, *(f"{one}_{k}" for k in range(line, 0, -1) for one in ss.input_labels)]
    labels = {"states": names, "inputs": ss.input_labels, "outputs": ss.output_labels, "name": ss.name}
    return control.ss(a, b, np.hstack([ss.C, np.zeros((ss.noutputs, line * m))]), 0, h, **labels)


def _held_over(ss: control.StateSpace, h: float) -> tuple[Any, Any]:
    """F = exp(A h), G = integral of exp(A t) B over h."""
    n, m = ss.B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = ss.A * h, ss.B * h
    result = expm(block)
    return result[:n, :n], result[:n, n:]


def smith_predictor(
    controller: control.TransferFunction, model: control.TransferFunction, samples: int
) -> control.TransferFunction:
    """C/(1 + C P (1 - z^-samples)): the loop C P z^-samples then answers its reference like C P without delay.

    Its inner model runs beside the plant, so what disturbs the plant, or how it was let go, dies out with the plant's
    own poles however good C is (O. Smith 1957; Astrom, Wittenmark, 4.8). The ball's own swing takes 18 s to a
    twentieth: here a state predictor, which the filter is, has to do this work.
    """
    if controller.dt != model.dt:
        raise ValueError(f"sample times differ: {controller.dt} and {model.dt} s")
    cn, cd = (np.poly1d(side[0][0]) for side in (controller.num, controller.den))
    pn, pd = (np.poly1d(side[0][0]) for side in (model.num, model.den))
    line = np.poly1d([1.0, *[0.0] * samples])
    # over z^samples: cn pd z^d / (cd pd z^d + cn pn (z^d - 1))
    below = cd * pd * line + cn * pn * (line - 1.0)
    return control.tf((cn * pd * line).coeffs, below.coeffs, controller.dt)
