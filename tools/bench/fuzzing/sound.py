"""Sound files of every kind that the program reads, small and quickly read: what the cases spoil.

Rules of this file: made by the program itself where it writes that kind; the same in every process.
"""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import scipy.io
from harness import matlab_table

from fuzzing import schema
from fuzzing.plants import MOST
from hoopd.daemon.app import Options, run_daemon
from hoopd.files.reading import parse_yaml
from hoopd.files.shipped import defaults_folder
from hoopd.files.yaml_text import text_of
from hoopd.plants.registry import FOLDER
from hoopd.recording import load, save
from hoopd.recording.column_choice import SignalLayout
from hoopd.recording.edit import between
from hoopd.shell import config as configuration

ROOT = Path(__file__).resolve().parents[3]
RUN_S, LONG_S = 1.6, 8.0
_EXAMPLE = re.compile(r"```python\n(.*?)```", re.DOTALL)
# kind of file -> its extension
EXTENSIONS = {
    "configuration": ".yaml",
    "model": ".yaml",
    "plant": ".yaml",
    "controller": ".yaml",
    "experiment table": ".yaml",
    "frame layout": ".yaml",
    "identified model": ".yaml",
    "law": ".py",
    "effects": ".py",
    "mcap": ".mcap",
    "mat": ".mat",
    "hdf5": ".h5",
    "csv": ".csv",
    "plant csv": ".csv",
    "plant mcap": ".mcap",
    "plant hdf5": ".h5",
    "plant mat": ".mat",
    "plant file": ".yaml",
    "plant program": ".py",
    "plant run": ".csv",
    "other model": ".yaml",
    "struct mat": ".mat",
    "table mat": ".mat",
    "long csv": ".csv",
    "positions csv": ".csv",
    "positions npy": ".npy",
    "picture": ".png",
}


def make(folder: Path) -> None:
    """One file of each kind, named after it."""
    for kind, maker in _MAKERS.items():
        maker(path_of(folder, kind))


def path_of(folder: Path, kind: str) -> Path:
    """Where the sound file of a kind stands."""
    return folder / f"sound {kind}{EXTENSIONS[kind]}".replace(" ", "_")


def _configuration(path: Path) -> None:
    config = configuration.load(None, sim=True, overrides=[])
    data = msgspec.to_builtins(config)
    data["sim"]["faults"] = [{"kind": "late_pictures", "at_s": 0.02, "for_s": 0.1, "params": {"delay_s": 0.04}}]
    data["sim"]["commands"] = [{"at_s": 0.0, "name": "reference", "value": 0.01}]
    data["sim"]["effects"] = [{"name": "hoop.coulomb_friction", "parameters": {"Fc": 0.008}}]
    path.write_text(text_of(data))


def _shipped(name: str) -> Any:
    return lambda path: path.write_text((defaults_folder() / name).read_text())


def _example(page: str) -> Any:
    """The first program of a page of the documentation."""
    text = (ROOT / "docs" / page).read_text()
    return lambda path: path.write_text(_EXAMPLE.search(text)[1])  # type: ignore[index]


def _table(path: Path) -> None:
    text = (defaults_folder() / "controllers/lqg.yaml").read_text()
    data = parse_yaml(text, path)
    around = {"kind": "lqg", "gains": data["gains"]}
    limits = {"torque_nm": 0.3, "hoop_speed_rad_s": 45.0, "ball_angle_rad": 1.25}
    ticks = {"soft_start_ticks": 5, "soft_end_ticks": 5, "centring_nm_per_rad_s": 0.01}
    data |= {"kind": "excitation", "gains": {"table_nm": [0.1, -0.1] * 20, **limits, **ticks, "around": around}}
    path.write_text(text_of(data))


def _layout(path: Path) -> None:
    path.write_text(text_of(schema.layout_table()))


def _other_model(path: Path) -> None:
    """A model of the axis."""
    values = {"M": {"value": 90.0, "unit": "kg"}, "Fv": {"value": 150.0, "unit": "N s/m"}}
    values["offset"] = {"value": 0.0, "unit": "N"}
    path.write_text(text_of({"schema": "hoopd.model/1", "name": "a", "plant": "axis", "parameters": values}))


def _identified(path: Path) -> None:
    eye = [[0.99, 0.0, 0.0], [0.0, 0.98, 0.02], [0.0, -0.4, 0.97]]
    path.write_text(
        text_of(
            {
                "schema": "hoopd.identified/1",
                "name": "x",
                "method": "subspace",
                "sample_time_s": 0.02,
                "inputs": ["u"],
                "outputs": ["dtheta", "psi"],
                "a": eye,
                "b": [[5.0], [0.01], [0.4]],
                "c": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                "d": [[0.0], [0.0]],
                "k": [[0.1, 0.0], [0.0, 0.3], [0.0, 0.5]],
                "r": [[0.01, 0.0], [0.0, 1e-4]],
            }
        )
    )


def _run(path: Path, seconds: float = RUN_S) -> None:
    """A run of the daemon, as it records it."""
    table = "sim.commands=[{at_s: 0.5, name: reference, value: 0.05}, {at_s: 1.0, name: reference, value: -0.05}]"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        options = Options(sim=True, duration_s=seconds, speed="max", direct=True, record=path.parent, sets=(table,))
        run_daemon(options)
    for made in path.parent.glob("run-*.mcap"):
        made.rename(path)


def _converted(path: Path) -> None:
    source = path_of(path.parent, "mcap")
    save(between(load(source), 0.2, 1.4), path)


def _long_run(path: Path) -> None:
    """Long enough for a diagnosis to begin."""
    run = path.with_suffix(".mcap")
    _run(run, LONG_S)
    save(load(run), path)
    run.unlink()


def _other_plant_csv(path: Path) -> None:
    """The axis, with names and units of its own."""
    t = 0.001 * np.arange(600)
    rows = zip(1e3 * t, 0.1 * np.sin(9 * t), 40 * t**2, strict=True)
    lines = "\n".join(f"{ms:.3f},{force:.6g},{place:.6g},ok" for ms, force, place in rows)
    path.write_text(f"Time [ms],Force,Position,state\n{lines}\n")


def _other_plant(path: Path) -> None:
    """The same as a file of ours, read by its own names."""
    layout = SignalLayout({"F": "N"}, {"x": "m"})
    save(load(path_of(path.parent, "plant csv"), "F=Force:kN,x=Position:mm", layout=layout), path)


def _any_plant_csv(path: Path) -> None:
    """A column for every signal of the random plants."""
    names = ["t", "F", "x", *(f"{letter}{i}" for letter, most in MOST.items() for i in range(most))]
    rows = np.sin(np.outer(0.02 * np.arange(200), np.arange(1, len(names) + 1)))
    rows[:, 0] = 0.02 * np.arange(200)
    path.write_text("\n".join([",".join(names), *(",".join(f"{one:.4g}" for one in row) for row in rows)]) + "\n")


def _columns() -> dict[str, Any]:
    t = 0.001 * np.arange(600)
    return {"Time": 1e3 * t, "Force": 0.1 * np.sin(9 * t), "Position": 40 * t**2}


def _struct(path: Path) -> None:
    """What Simulink writes: a struct with time and signals."""
    time, force, position = _columns().values()
    signals = np.array([(force, "Force"), (position, "Position")], dtype=[("values", object), ("label", object)])
    scipy.io.savemat(path, {"run": {"Time": time, "signals": signals, "text": "x", "wide": np.zeros((600, 3))}})


def _matlab_table(path: Path) -> None:
    path.write_bytes(matlab_table.table(_columns(), {"Time": "ms", "Force": "kN", "Position": "mm"}))


def _points() -> Any:
    angle = np.linspace(-0.9, 0.9, 300)
    return np.column_stack([240.0 - 182.0 * np.sin(angle), 240.0 + 182.0 * np.cos(angle)])


def _positions_csv(path: Path) -> None:
    rows = "\n".join(f"{x:.3f},{y:.3f}" for x, y in _points())
    path.write_text(f"x_px,y_px\n{rows}\n")


def _positions_npy(path: Path) -> None:
    np.save(path, _points())


def _picture(path: Path) -> None:
    image = np.full((480, 480, 3), 90, np.uint8)
    cv2.circle(image, (240, 240), 205, (30, 30, 30), 8)
    cv2.circle(image, (240, 422), 23, (30, 30, 200), -1)
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())


_MAKERS: dict[str, Any] = {
    "configuration": _configuration,
    "model": _shipped("models/hoop.yaml"),
    "plant": lambda path: path.write_text((FOLDER / "axis.yaml").read_text()),
    "controller": _shipped("controllers/lqg.yaml"),
    "experiment table": _table,
    "frame layout": _layout,
    "identified model": _identified,
    "law": _example("guides/laws.md"),
    "effects": _example("reference/effects.md"),
    "mcap": _run,
    "mat": _converted,
    "hdf5": _converted,
    "csv": _converted,
    "plant csv": _other_plant_csv,
    "plant mcap": _other_plant,
    "plant hdf5": _other_plant,
    "plant mat": _other_plant,
    "plant file": lambda path: path.write_text((FOLDER / "axis.yaml").read_text()),
    "plant program": _example("guides/your_plant.md"),
    "plant run": _any_plant_csv,
    "other model": _other_model,
    "struct mat": _struct,
    "table mat": _matlab_table,
    "long csv": _long_run,
    "positions csv": _positions_csv,
    "positions npy": _positions_npy,
    "picture": _picture,
}
