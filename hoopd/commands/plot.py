"""`hoopd plot`: recordings as a picture, or as a page to zoom in.

Rules of this file: from files to a file; what is drawn is decided in `hoopd.plots`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hoopd.commands.inputs import read_recording
from hoopd.commands.options.plot import PlotOptions
from hoopd.files.reading import InputError
from hoopd.files.whole_files import check_target, replace_file
from hoopd.plants.registry import resolve_plant
from hoopd.plots import style
from hoopd.plots.panels import DIFFERENCE, RecordingPicture, compared_picture, picture
from hoopd.plots.recording_page import recording_page
from hoopd.plots.recordings import draw_picture
from hoopd.recording.pairs import paired
from hoopd.recording.recording import Recording
from hoopd.recording.slices import file_of

PAGES = (".html", ".htm")


def target_of(options: PlotOptions) -> Path:
    """Where the picture goes; InputError when it cannot."""
    path = options.out
    if path is None:
        file = file_of(options.recordings[0])
        path = Path(f"{file.stem}-plot.png")
    if path.suffix.lower() not in (*style.EXTENSIONS, *PAGES):
        known = ", ".join((*style.EXTENSIONS, ".html"))
        raise InputError(path, "--out", f"unknown extension {path.suffix!r}; known: {known}")
    check_target(path, "--out")
    return path


def run(options: PlotOptions) -> dict[str, Any]:
    """Draw; what was drawn, and where it is."""
    target = target_of(options)  # before anything is read
    if options.compare and (len(options.recordings) != 2 or options.from_zero):
        raise InputError("--compare", "", "takes two recordings, and lays one over the other by itself")
    recordings = _read(options)
    shown = (
        compared_picture(recordings, paired(*recordings.values()), options.channels)
        if options.compare
        else picture(recordings, options.channels, from_zero=options.from_zero)
    )
    if target.suffix.lower() in PAGES:
        replace_file(target, recording_page(shown))
    else:
        style.save(draw_picture(shown), target)
    return {
        "picture": str(target),
        "channels": {
            panel.name: ", ".join(filter(None, (panel.words, panel.unit)))
            for panel in shown.panels
            if panel.words != DIFFERENCE
        },
        "recordings": {name: f"{len(one)} rows, {one.t[-1] - one.t[0]:.6g} s" for name, one in recordings.items()},
        **_differences(shown),
        "notes": [*([shown.note] if shown.note else []), *_losses(recordings)],
    }


def _differences(shown: RecordingPicture) -> dict[str, Any]:
    """Of two recordings, by channel."""
    rows = {
        one.channel: {key: value for key, value in one._asdict().items() if key != "channel"} for one in shown.figures
    }
    return {"difference": rows} if rows else {}


def _losses(recordings: Mapping[str, Recording]) -> list[str]:
    return [f"{name}: {one.lost}" for name, one in recordings.items() if one.lost]


def _read(options: PlotOptions) -> dict[str, Recording]:
    """Recordings by the name under which they are drawn: without folders where that tells them apart."""
    plant = None if options.plant is None else resolve_plant(options.plant)
    texts = options.recordings
    short = [Path(text).name for text in texts]
    names = [name if short.count(name) == 1 else text for name, text in zip(short, texts, strict=True)]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(twice, "", "stands twice")
    read = (read_recording(text, options.columns, options.age, plant=plant, hold=options.hold) for text in texts)
    return dict(zip(names, read, strict=True))
