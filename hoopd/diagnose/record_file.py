"""The bytes of a diagnosis, and a diagnosis from its bytes.

Rules of this file: bytes depend on the diagnosis alone; what cannot be read is one InputError.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np

from hoopd.diagnose.record import SCHEMA, Diagnosis, Number
from hoopd.files.reading import InputError

# Far more than any interval leaves open.
DIGITS = 7
VERDICTS_WITHOUT_EFFECTS = ("consistent", "parameters")


def canonical(diagnosis: Diagnosis) -> Diagnosis:
    """Effects and candidates by falling evidence; ValueError when verdict and effects contradict each other."""
    if bool(diagnosis.effects) == (diagnosis.verdict in VERDICTS_WITHOUT_EFFECTS):
        raise ValueError(f"verdict {diagnosis.verdict!r} with {len(diagnosis.effects)} effects")
    effects = sorted(diagnosis.effects, key=lambda one: _falling(one.evidence.log_likelihood_gain, one.name))
    candidates = sorted(diagnosis.candidates, key=lambda one: _falling(one.log_likelihood_gain, one.name))
    return msgspec.structs.replace(diagnosis, effects=effects, candidates=candidates)


def to_json_bytes(diagnosis: Diagnosis) -> bytes:
    """The file: UTF-8, indented, keys of mappings in alphabetical order; ValueError as in `canonical`."""
    plain = to_plain(msgspec.to_builtins(canonical(diagnosis), enc_hook=unwrapped))
    return msgspec.json.format(msgspec.json.encode(plain, order="deterministic"), indent=2) + b"\n"


def rounded(diagnosis: Diagnosis) -> Diagnosis:
    """Numbers to DIGITS digits: arithmetic on differently aligned memory differs in the last ones, and says nothing."""
    return msgspec.convert(_rounded(msgspec.to_builtins(diagnosis, enc_hook=unwrapped)), Diagnosis)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return to_digits(value) if isinstance(value, float) else value


def to_digits(value: float) -> float:
    """Without the digits that nothing determines."""
    return float(f"{value:.{DIGITS}g}")


def parse(data: bytes, path: object) -> Diagnosis:
    """A diagnosis from its file's bytes; InputError (`path` in its message) when it is none."""
    try:
        return msgspec.json.decode(data, type=Diagnosis)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(path, "", f"not a {SCHEMA}: {error}") from None


def _falling(gain: Number, name: str) -> tuple[float, str]:
    """Most evidence first; what is not determined last; the name decides among equals."""
    return (-gain if gain is not None and not math.isnan(gain) else math.inf, name)


def unwrapped(value: Any) -> Any:
    """Numpy's numbers and arrays as Python's."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no place in a diagnosis")


def to_plain(value: Any) -> Any:
    """Without what JSON has no word for: numbers that are none, file names that are no text."""
    if isinstance(value, dict):
        return {_text(str(key)): to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, str):
        return _text(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _text(text: str) -> str:
    """A name of undecodable bytes keeps them readable."""
    return text.encode("utf-8", "backslashreplace").decode()
