"""`hoopd calibration`: the versions of a device's calibration, in the folder that its configuration names.

Rules of this file: options in, a result record out; nothing is ever overwritten (`hoopd.files.calibration`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from hoopd.commands.options.calibration import CalibrationOptions
from hoopd.commands.version_words import user_name, version_number
from hoopd.files.calibration import AcceptedCalibration, Calibrations, ListedCalibration
from hoopd.files.reading import InputError, parse_yaml, read_text
from hoopd.shell import config as configuration

NO_FOLDER = "names no folder of calibrations: add calibration.folder, or --set calibration.folder=FOLDER"
COUNTS = "counts from the daemon's next start"


def run(options: CalibrationOptions) -> dict[str, Any]:
    """The result as a record, `exit` among it; InputError for what cannot be used."""
    action = ACTIONS.get(options.action)
    if action is None:
        raise InputError("ACTION", options.action, f"unknown; known: {', '.join(ACTIONS)}")
    folder = configuration.calibrations(options.config, list(options.sets))
    if folder is None:
        raise InputError(options.config or "configuration", "calibration.folder", NO_FOLDER)
    return action(folder, options)


def _list(folder: Calibrations, options: CalibrationOptions) -> dict[str, Any]:
    if options.what:
        raise InputError("list", options.what, "takes no more than that")
    listed = folder.listed()
    newest = listed[-1].number if listed else None
    spoiled = [f"{one.number:04}: {one.wrong}" for one in listed if one.wrong]
    return {
        "in_force": newest,
        "versions": {f"{one.number:04}": _row(one) for one in listed},
        "notes": spoiled or ([] if listed else ["no calibration was accepted yet"]),
        "exit": 1 if spoiled else 0,
    }


def _row(one: ListedCalibration) -> dict[str, Any]:
    version = one.calibration
    if version is None:
        return {"date_utc": None, "who": None, "why": None, "changed": "spoiled"}
    keys = ", ".join(change.key.partition(".")[2] for change in one.changes) or "nothing"
    return {"date_utc": version.date[:16].replace("T", " "), "who": version.who, "why": version.why, "changed": keys}


def _show(folder: Calibrations, options: CalibrationOptions) -> dict[str, Any]:
    version = folder.read(version_number(options.what, "calibration"))
    listed = next(one for one in folder.listed() if one.number == version.number)
    told: dict[str, Any] = msgspec.to_builtins(version)
    changes = {one.key: {"before": one.before, "now": one.now} for one in listed.changes}
    return {
        **told,
        "changes": changes,
        "notes": [listed.wrong] if listed.wrong else [],
        "exit": int(bool(listed.wrong)),
    }


def _add(folder: Calibrations, options: CalibrationOptions) -> dict[str, Any]:
    path = Path(options.what)
    part = configuration.calibration_part(parse_yaml(read_text(path), path), path)
    device = configuration.load_to_ask(options.config, list(options.sets)).device.name
    return _added(folder.add(part, device=device, who=user_name(), why=options.why or f"from {path.name}"))


def _restore(folder: Calibrations, options: CalibrationOptions) -> dict[str, Any]:
    return _added(folder.restore(version_number(options.what, "calibration"), user_name()))


def _added(version: AcceptedCalibration) -> dict[str, Any]:
    fields = {"version": version.number, "who": version.who, "why": version.why}
    return {**fields, "configuration": version.configuration, "notes": [COUNTS], "exit": 0}


ACTIONS: Mapping[str, Callable[[Calibrations, CalibrationOptions], dict[str, Any]]] = {
    "list": _list,
    "show": _show,
    "add": _add,
    "restore": _restore,
}
