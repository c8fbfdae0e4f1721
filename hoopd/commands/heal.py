"""`hoopd heal`: the versions that it keeps, listed, decided and restored; `heal_watch` follows a daemon.

Rules of this file: every action ends at once; only `restore` tells the daemon something, as an operator would.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hoopd.commands.options.heal import HealOptions
from hoopd.commands.options.shared import finish
from hoopd.commands.output import check_json
from hoopd.commands.version_words import user_name, version_number
from hoopd.files.reading import InputError

if TYPE_CHECKING:
    from hoopd.files.heal_versions import HealVersion, VersionFolder


def heal(options: HealOptions) -> None:
    """One of the actions; `watch` goes on until Ctrl-C."""
    check_json(options.json_path)
    if options.action == "watch":
        from hoopd.commands.heal_watch import watch

        watch(options)
        return
    action = ACTIONS.get(options.action)
    if action is None:
        raise InputError("ACTION", options.action, f"unknown; known: watch, {', '.join(ACTIONS)}")
    finish(action(options), options.json_path)


def _list(options: HealOptions) -> dict[str, Any]:
    if options.number:
        raise InputError("list", options.number, "takes no more than that")
    folder = _folder(options)
    loop = folder.loop()
    rows = {f"{one.number:04}": _row(one) for one in folder.every()}
    return {"device": loop.device, "acting": f"{loop.acting:04}", "watched": folder.is_watched, "versions": rows}


def _row(one: HealVersion) -> dict[str, Any]:
    when = datetime.fromtimestamp(one.begun, UTC).isoformat(sep=" ", timespec="minutes")[:16]
    return {
        "date_utc": when,
        "state": one.state.replace("_", " "),
        "kind": one.kind,
        "decided_by": one.decided_by,
        "reason": one.reason,
    }


def _show(options: HealOptions) -> dict[str, Any]:
    import msgspec

    told: dict[str, Any] = msgspec.to_builtins(_folder(options).read(version_number(options.number, "heal")))
    return told


def _accept(options: HealOptions) -> dict[str, Any]:
    return _decided(options, accept=True)


def _leave(options: HealOptions) -> dict[str, Any]:
    return _decided(options, accept=False)


def _decided(options: HealOptions, *, accept: bool) -> dict[str, Any]:
    from hoopd.files.heal_versions import HealDecision

    folder, number = _folder(options), version_number(options.number, "heal")
    folder.decide(number, HealDecision(accept=accept, who=user_name()))
    word = "goes on trial" if accept else "is left"
    there = folder.is_watched
    says = f"version {number} {word}" if there else f"no hoopd heal runs here: version {number} {word} once one does"
    return {"version": number, "decided_by": user_name(), "says": says}


def _restore(options: HealOptions) -> dict[str, Any]:
    """Any version that once acted, by one command to the daemon; what watches notes that somebody changed it."""
    from hoopd.commands.operator import ask

    folder, number = _folder(options), version_number(options.number, "heal")
    version, device = folder.read(number), folder.loop().device
    if version.accepted is None:
        raise InputError(folder.folder, str(number), f"never acted (it is {version.state.replace('_', ' ')})")
    folder.check(number)
    key = _usable_key(folder, version, options.controllers)
    answer = ask({"command": "controller", "key": key}, options.config, (*options.sets, f"device.name={device}"))
    folder.keep(folder.read(number), time.time(), f"restored by {user_name()}")
    folder.acts(version.acts_as)
    return {"version": number, "key": key, "mode": answer["mode"], "says": f"version {number} acts"}


def _usable_key(folder: VersionFolder, version: HealVersion, controllers: Path | None) -> str:
    """Of a copy with its own model in the daemon's folder, laid in anew where somebody took it away; where this machine
    has no such folder, of what was laid in before."""
    from hoopd.dashboard.work.controllers import Controllers
    from hoopd.heal.version_copies import lay_copy

    told = controllers or folder.loop().controllers
    if not told or (controllers is None and not Path(told).is_dir()):
        return version.keys[0]
    return lay_copy(folder, version.acts_as, Controllers(Path(told)).lay_in_with)


def _folder(options: HealOptions) -> VersionFolder:
    from hoopd.files.heal_versions import VersionFolder

    folder = VersionFolder(options.out)
    folder.loop()
    return folder


ACTIONS: Mapping[str, Callable[[HealOptions], dict[str, Any]]] = {
    "list": _list, "show": _show, "accept": _accept, "leave": _leave, "restore": _restore,
}  # fmt: skip
