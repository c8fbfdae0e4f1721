"""How a result came about: method, data, what was chosen, what was warned of.

Rules of this file: an estimator is wrapped by `estimated`, and its result carries the report; nothing is computed from
the data before somebody asks. A warning is shown as if nobody had listened.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, ParamSpec, TypeVar

from hoopd.ident.data import Data
from hoopd.ident.doubts import IdentificationWarning

P = ParamSpec("P")
R = TypeVar("R")

_CHOICES: ContextVar[list[str] | None] = ContextVar("choices", default=None)


@dataclass(frozen=True)
class EstimationReport:
    """Method in words, data of the fit, what the data chose and why, warnings."""

    method: str
    data: tuple[Any, ...]
    choices: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def chosen(text: str) -> None:
    """Say in a sentence what the data chose and why; it stands in the report of the estimate that is being made."""
    choices = _CHOICES.get()
    if choices is not None and text not in choices:
        choices.append(text)


def estimated(method: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let the results of an estimator carry their report; `method`: what the estimator is called in words."""

    def wrapped(estimator: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(estimator)
        def estimate(*args: P.args, **options: P.kwargs) -> R:
            choices: list[str] = []
            token = _CHOICES.set(choices)
            try:
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always", IdentificationWarning)
                    result = estimator(*args, **options)
            finally:
                _CHOICES.reset(token)
                for text in choices:
                    chosen(text)
                for one in caught:
                    warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
            notes = [str(one.message) for one in caught if issubclass(one.category, IdentificationWarning)]
            data = args[0] if args else next(iter(options.values()))
            return _reported(result, EstimationReport(method, _each(data), tuple(choices), tuple(dict.fromkeys(notes))))

        return estimate

    return wrapped


def _reported(result: R, report: EstimationReport) -> R:
    assert is_dataclass(result)
    return replace(result, report=report)  # type: ignore[type-var]


def _each(data: Any) -> tuple[Any, ...]:
    """The experiments of a fit; a response or frequency data alone."""
    return tuple(data) if isinstance(data, Sequence) and not isinstance(data, Data) else (data,)
