"""A controller as it enters the recorded inputs: its checked numbers and its model's text, as compact JSON.

Rules of this file: the text is all that a tick, and a replay, needs; equal files give equal texts.
"""

from __future__ import annotations

import hashlib

import msgspec

from hoopd.files.controller import ControllerFile
from hoopd.files.records import Strict


class LoadedController(Strict, frozen=True):
    """What a command of `controller`, `trial` or `experiment` brings."""

    file: str  # name in the daemon's folder
    sha256: str  # of the file's bytes
    by: str  # who asked for it
    controller: ControllerFile
    model: str  # text of the file of the filter's model

    @property
    def filter_key(self) -> str:
        """Equal keys, equal filters."""
        return filter_key(self.model, self.controller)


_encode = msgspec.json.Encoder(order="sorted").encode
_decode = msgspec.json.Decoder(LoadedController).decode


def text_of_loaded(loaded: LoadedController) -> str:
    """The text of a command."""
    return _encode(loaded).decode()


def parse_loaded(text: str) -> LoadedController:
    """What a text holds; ValueError when it is none."""
    try:
        return _decode(text)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise ValueError(f"not the text of a controller: {error}") from None


def filter_key(model: str, file: ControllerFile) -> str:
    """Hash of what a filter is made of: the model's text and the estimator's numbers, without what is normal of it."""
    numbers = msgspec.structs.replace(file.estimator, innovations={})
    return hashlib.sha256(_encode([model, numbers])).hexdigest()
