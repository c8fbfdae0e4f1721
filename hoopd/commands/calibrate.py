"""`hoopd calibrate`: a proposal from a picture, a run of positions, or both, written where the user asks.

Rules of this file: it reads, calls `hoopd.vision`, writes; it decides nothing. The configuration is written only with
`save_path`, never over the picture or the daemon's own file. Weights are written as R, G, B, as in the configuration.
"""

from __future__ import annotations

import csv
import json
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from hoopd.commands.output_files import check_targets
from hoopd.files.reading import InputError, read_bytes
from hoopd.files.yaml_text import text_of
from hoopd.recording.mcap import read_run
from hoopd.vision.calibration import CalibrationError, Proposal, RunProposal, propose, propose_from_run
from hoopd.vision.circles import Circle
from hoopd.vision.draw import draw_proposal, draw_run

Image = NDArray[np.uint8]
T = TypeVar("T")
CONFIG_KEYS = ("weights", "threshold", "circle_px", "zero_angle_rad", "ball_radius_px", "band_px")
LARGEST_FILE_BYTES = 2**26  # a raw picture of the largest size; a device file has no end
LARGEST_TABLE_BYTES = 2**22  # two hours of pictures
LARGEST_POSITION_PX = 1e5
LARGEST_SIDE_PX = 4096  # a larger picture is no camera's of this device and would take minutes


def run(
    picture: Path | None,
    positions: Path | None = None,
    json_path: Path | None = None,
    figure_path: Path | None = None,
    save_path: Path | None = None,
) -> dict[str, Any]:
    """The proposal as plain data; writes JSON, figure and configuration where told. InputError for unusable input."""
    if picture is None and positions is None:
        raise InputError("", "", "calibrate needs a picture or a run of positions")
    if figure_path is None and json_path is not None:
        figure_path = json_path.parent / f"{json_path.stem}_calibration.png"
    outputs = {"--json": json_path, "--figure": figure_path, "--save": save_path}
    check_targets([one for one in (picture, positions) if one is not None], outputs)
    image = None if picture is None else read_picture(picture)
    points = None if positions is None else read_positions(positions)
    if points is not None and np.nanmax(np.abs(points), initial=0.0, where=np.isfinite(points)) > LARGEST_POSITION_PX:
        raise InputError(positions, "", f"positions beyond {LARGEST_POSITION_PX:g} px are no pixels")
    still = None if image is None else guarded(picture, lambda: propose(image))
    track = None if points is None else guarded(positions, lambda: propose_from_run(points))
    result = proposal_data(still) if still is not None else {}
    if track is not None:
        result = merged(result, run_data(track))
    if figure_path is not None:
        write_figure(figure_path, image, still, points, track)
        result["figure"] = str(figure_path)
    if save_path is not None:
        write_text(save_path, config_fragment(result))
    if json_path is not None:
        write_text(json_path, json.dumps(result, indent=2) + "\n")
    return result


def guarded(path: Path | None, compute: Callable[[], T]) -> T:
    """The computed proposal; what a picture or run lacks becomes the one line for the user."""
    try:
        return compute()
    except CalibrationError as error:
        raise InputError(path, "", str(error)) from None


def proposal_data(proposal: Proposal) -> dict[str, Any]:
    """Keys of the JSON for a picture; `circle_px` is the circle of the ball's centre, concentric with the hoop."""
    blue, green, red = proposal.colour.weights
    return {
        "ball_px": rounded(proposal.ball[:2]),
        "circle_px": circle_data(proposal.track),
        "weights": [red, green, blue],
        "weights_order": "RGB",
        "threshold": round(proposal.colour.threshold, 1),
        "zero_angle_rad": round(proposal.zero_angle_rad, 5),
        "ball_radius_px": round(proposal.ball.radius_px, 2),
        "band_px": round(proposal.settings().ring_half_width_px, 1),
        "hoop_outer_radius_px": round(proposal.hoop.radius_px, 2),
        "hoop_coverage": round(proposal.hoop_coverage, 3),
        "gap_grey_levels": round(proposal.colour.gap, 1),
        "confidence": round(proposal.confidence, 3),
        "notes": list(proposal.notes),
    }


def run_data(proposal: RunProposal) -> dict[str, Any]:
    """Keys of the JSON for a run of positions; the colour is not known from it."""
    return {
        "circle_px": circle_data(proposal.track),
        "zero_angle_rad": round(proposal.zero_angle_rad, 5),
        "zero_from": proposal.zero_from,
        "residual_px": round(proposal.residual_px, 3),
        "kept": round(proposal.kept, 4),
        "span_rad": round(proposal.span_rad, 3),
        "notes": list(proposal.notes),
    }


def merged(picture: dict[str, Any], track: dict[str, Any]) -> dict[str, Any]:
    """Colour from the picture, circle from the run; without a zero angle there the picture's ball is at 0."""
    result = {**picture, **track, "notes": picture.get("notes", []) + track["notes"]}
    if track["zero_from"] == "none" and "ball_px" in picture:
        (x, y), (cx, cy) = picture["ball_px"], track["circle_px"]["centre"]
        result["zero_angle_rad"], result["zero_from"] = round(math.atan2(cx - x, y - cy), 5), "picture"
    return result


def circle_data(circle: Circle) -> dict[str, Any]:
    """Centre and radius in pixels."""
    return {"centre": rounded(circle[:2]), "radius": round(circle.radius_px, 2)}


def rounded(values: tuple[float, ...]) -> list[float]:
    """Pixels to a hundredth."""
    return [round(value, 2) for value in values]


def config_fragment(result: dict[str, Any]) -> str:
    """The `vision:` section with what was found."""
    section = {key: result[key] for key in CONFIG_KEYS if key in result}
    head = "# Proposed by `hoopd calibrate`; weights are of R, G, B; circle_px: on which the ball's centre moves.\n"
    return head + text_of({"vision": section}, default_flow_style=None)


def read_picture(path: Path) -> Image:
    """Picture as blue, green, red of uint8."""
    data = np.frombuffer(read_bytes(path, LARGEST_FILE_BYTES), np.uint8)
    try:
        with silent_libraries():
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except cv2.error:  # one that claims more pixels than OpenCV may take (see cli.py)
        image = None
    if image is None:
        raise InputError(path, "", "not a picture that OpenCV can read")
    if max(image.shape[:2]) > LARGEST_SIDE_PX:
        raise InputError(path, "", f"{image.shape[1]} x {image.shape[0]} px is too large: {LARGEST_SIDE_PX} at most")
    return np.asarray(image, np.uint8)


@contextmanager
def silent_libraries() -> Iterator[None]:
    """What libpng and others write to standard error themselves is not for the user, who gets our one line."""
    sys.stderr.flush()
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def read_positions(path: Path) -> NDArray[np.float64]:
    """N x 2 pixels: columns x_px, y_px of a CSV, the first two columns of an npy array, or a recording."""
    if path.suffix == ".npy":
        return read_npy(path)
    if path.suffix == ".csv":
        return read_csv(path)
    if path.suffix == ".mcap":
        return read_recording(path)
    raise InputError(path, "", "expected positions as .csv, .npy or a recording (.mcap)")


def read_recording(path: Path) -> NDArray[np.float64]:
    """Positions that a recorded run found, one row a picture."""
    samples = [inputs.camera for inputs in read_run(path, ("input",)).inputs if inputs.camera is not None]
    positions = np.array([(sample.x_px, sample.y_px) for sample in samples], float).reshape(-1, 2)
    found: NDArray[np.float64] = positions[np.isfinite(positions).all(axis=1)]
    if not len(found):
        raise InputError(path, "input.camera", "the run saw no ball")
    return found


def read_npy(path: Path) -> NDArray[np.float64]:
    """First two columns of a numeric array."""
    data = read_bytes(path, LARGEST_FILE_BYTES)
    try:
        array = np.load(BytesIO(data), allow_pickle=False)
        if array.dtype.kind not in "iuf":
            raise TypeError(array.dtype)
        points = np.asarray(array, np.float64)
    except Exception:  # numpy's reader parses Python text: a damaged header may end in anything
        raise InputError(path, "", "not a numeric npy array") from None
    if points.ndim != 2 or points.shape[1] < 2:
        raise InputError(path, "", f"expected N x 2 positions, got shape {points.shape}")
    return points[:, :2]


def read_csv(path: Path) -> NDArray[np.float64]:
    """Columns x_px and y_px; an empty field is a missing position."""
    try:
        text = read_bytes(path, LARGEST_TABLE_BYTES).decode("utf-8-sig")  # spreadsheets write a byte order mark
    except UnicodeDecodeError:
        raise InputError(path, "", "not a text file") from None
    try:
        return csv_points(csv.DictReader(text.splitlines(), skipinitialspace=True), path)
    except csv.Error as error:
        raise InputError(path, "", f"not a table: {error}") from None


def csv_points(reader: csv.DictReader[str], path: Path) -> NDArray[np.float64]:
    """The two columns of a table with a head."""
    for key in ("x_px", "y_px"):
        if key not in (reader.fieldnames or ()):
            raise InputError(path, key, "column is missing")
    rows = [[number(row[key], path, f"line {reader.line_num}, {key}") for key in ("x_px", "y_px")] for row in reader]
    return np.array(rows, np.float64).reshape(-1, 2)


def number(text: str | None, path: Path, where: str) -> float:
    """A number, NaN for an empty field."""
    if text is None or not text.strip():
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise InputError(path, where, f"expected a number, got {text!r}") from None


def write_text(path: Path, text: str) -> None:
    """Text into a file."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(path, "", (error.strerror or "cannot be written").lower()) from None


def write_figure(
    path: Path,
    image: Image | None,
    still: Proposal | None,
    points: NDArray[np.float64] | None,
    track: RunProposal | None,
) -> None:
    """PNG of the run where there is one, else of the picture."""
    if track is not None and points is not None:
        drawn = draw_run(points, track, image)
    elif still is not None and image is not None:
        drawn = draw_proposal(image, still)
    else:
        return
    try:
        path.write_bytes(cv2.imencode(".png", drawn)[1].tobytes())
    except OSError as error:
        raise InputError(path, "", (error.strerror or "cannot be written").lower()) from None
