"""A controller for a running daemon: from a name and a hash to the text that enters the tick's inputs.

Rules of this file: called in a thread of its own, never in the loop's; only files of the folder, and models beside
them or among those that the daemon could have started with; whatever is wrong is one line. What takes long is made
ready before the text enters: the law here, the filter of another model in a process of its own, whose compiled
functions come back; the tick then only puts them in.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from hoopd.core.tick import Tick
from hoopd.daemon.build import Prepared, new_controller, same_period
from hoopd.daemon.preparation import prepared_filter
from hoopd.files.controller import ControllerFile, parse_controller
from hoopd.files.controller_folder import parse_key, read_controller
from hoopd.files.loaded_controller import LoadedController, text_of_loaded
from hoopd.files.reading import InputError, read_text
from hoopd.plants.model_file import parse_model
from hoopd.shell.config import Config, find


class ControllerLoader:
    """Reads and checks controllers of one daemon."""

    def __init__(
        self, config: Config, config_path: Path | None, tick: Tick | None = None, prepared: Prepared | None = None
    ) -> None:
        """`tick`, `prepared`: of a daemon in real time, whose tick must not wait for a filter to be made."""
        self._config, self._config_path = config, config_path
        self._tick, self._prepared = tick, prepared

    def load(self, key: str, by: str) -> str:
        """The text of NAME.yaml@SHA256, asked for by somebody; InputError says why there is none."""
        wanted = parse_key(key)
        folder = controller_folder(self._config, self._config_path)
        content, sha256 = read_controller(folder, wanted)
        file = parse_controller(content, wanted.name)
        same_period(self._config, file, wanted.name)
        model = self._model(folder, wanted.name, file)
        loaded = LoadedController(file=wanted.name, sha256=sha256, by=by, controller=file, model=model)
        text = text_of_loaded(loaded)
        if self._tick is not None and self._prepared is not None:
            self._prepare(self._tick, self._prepared, text, loaded)
        return text

    def _prepare(self, tick: Tick, prepared: Prepared, text: str, loaded: LoadedController) -> None:
        succession, filter_ = tick.succession, None
        # whichever of them acts in the tick that takes the text: a trial may be over by then, who waits may act
        may_act = (succession.acting, succession.accepted, succession.follower or succession.acting)
        if any(one.filter.key != loaded.filter_key for one in may_act):
            filter_ = prepared_filter(self._config, text, tick.succession.limit_nm)
        prepared.clear()  # what was prepared before was never asked for: one file is loaded at a time
        prepared[text] = new_controller(self._config, text, filter_)

    def _model(self, folder: Path, name: str, file: ControllerFile) -> str:
        """Text of the model that a controller was designed on; without the folders of another machine."""
        path = PurePosixPath(file.model)
        if path.is_absolute() or ".." in path.parts or file.model.startswith("~"):
            path = PurePosixPath(path.name)
        device = self._config.device.model
        beside = folder / path
        try:
            if device and path.name == Path(device).name:
                text = read_text(find(device, self._config_path))
            else:
                text = read_text(beside if beside.is_file() else find(str(path), self._config_path))
            drive_nm = parse_model(text, path.name).device.torque_limit_nm
        except InputError as error:
            reason = f"{error.key}: {error.reason}" if error.key else error.reason
            reason += "; lay it beside the controller" if str(path) != file.model else ""
            raise InputError(name, "model", f"{path.name}: {reason}") from None
        if file.limits.torque_nm > drive_nm:
            reason = f"{file.limits.torque_nm:g} is more than the {drive_nm:g} of its model's drive"
            raise InputError(name, "limits.torque_nm", reason)
        return text


def controller_folder(config: Config, config_path: Path | None) -> Path:
    """Where controllers of a running daemon are: the folder of the one it started with, unless another is named."""
    if not config.control.folder:
        return find(config.control.file, config_path).parent
    folder = Path(config.control.folder).expanduser()
    return folder if config_path is None else config_path.parent / folder
