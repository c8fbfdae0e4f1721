"""Arguments of the Python interface that a typed dictionary declares, as parameters that help and completion show.

Rules of this file: nothing here knows a function of the lab.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar, get_args, get_type_hints

Function = TypeVar("Function", bound=Callable[..., Any])


def with_named_keywords(function: Function) -> Function:
    """The same with `**names: Unpack[Typed]` shown as the keywords of `Typed`; TypeError for a keyword that is none."""
    signature, hints = inspect.signature(function), get_type_hints(function)
    (rest,) = (one for one in signature.parameters.values() if one.kind is inspect.Parameter.VAR_KEYWORD)
    (typed,) = get_args(hints[rest.name])
    named = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
        for name, annotation in get_type_hints(typed).items()
    ]
    kept = [one for one in signature.parameters.values() if one is not rest]
    function.__signature__ = signature.replace(parameters=[*kept, *named])  # type: ignore[attr-defined]
    return function
