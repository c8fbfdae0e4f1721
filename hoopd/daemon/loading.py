"""A controller for a running daemon: from a name and a hash to the text that enters the tick's inputs.

Rules of this file: called in a thread of its own, never in the loop's; only files of the folder, and models beside
them or among those that the daemon could have started with; whatever is wrong is one line.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from hoopd.daemon.build import same_period
from hoopd.files.controller import ControllerFile, parse_controller
from hoopd.files.controller_folder import parse_key, read_controller
from hoopd.files.loaded_controller import LoadedController, text_of_loaded
from hoopd.files.reading import InputError, read_text
from hoopd.plants.model_file import parse_model
from hoopd.shell.config import Config, find


class ControllerLoader:
    """Reads and checks controllers of one daemon."""

    def __init__(self, config: Config, config_path: Path | None) -> None:
        self._config, self._config_path = config, config_path

    def load(self, key: str, by: str) -> str:
        """The text of NAME.yaml@SHA256, asked for by somebody; InputError says why there is none."""
        wanted = parse_key(key)
        folder = controller_folder(self._config, self._config_path)
        content, sha256 = read_controller(folder, wanted)
        file = parse_controller(content, wanted.name)
        same_period(self._config, file, wanted.name)
        model = self._model(folder, wanted.name, file)
        return text_of_loaded(LoadedController(file=wanted.name, sha256=sha256, by=by, controller=file, model=model))

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
            raise InputError(name, "model", f"{path.name}: {error.reason}") from None
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
