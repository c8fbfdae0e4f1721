"""Recordings: from files, and from the daemon itself on the simulated rig.

Rules of this file: the daemon runs as a program of its own, in lock-step as fast as it goes: it needs signals and an
event loop for itself, and a notebook has these already. The device is for the command line alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hoopd.commands.options.declaration import from_python, words_of
from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.commands.plant_experiment import simulate as simulate_experiment
from hoopd.lab.controllers import Controller, as_controller
from hoopd.lab.models import Model, as_model
from hoopd.plants.declaration import Plant
from hoopd.plants.layout import layout_of
from hoopd.plants.model_file import HOOP
from hoopd.plants.registry import resolve_plant
from hoopd.recording import Recording
from hoopd.recording.edit import aged
from hoopd.recording.slices import read_recording
from hoopd.recording.tables import Columns

# Lock-step runs some ten times faster than real time; what takes so long never ends.
PATIENCE_S = 600.0
ASKED_S = 3.0
QUIETLY = ("--sim", "--camera", "direct", "--set", "log.level=error")
RIG = ("--speed", "max", *QUIETLY)


def load(
    path: Path | str,
    columns: Columns | None = None,
    age: Mapping[str, float] | None = None,
    *,
    plant: Plant | str | None = None,
    hold: str = "zero",
) -> Recording:
    """Load a .mcap, .mat, .h5 or .csv recording.

    Parameters
    ----------
    path : str or Path
        The file ("file.h5:Exp2" of several); "@2:14" behind the name cuts it, in s.
    columns : str, sequence or mapping, optional
        What a file's columns hold, where they are not what its format says: in order ("u,theta,dtheta,current"), or by
        name and with units ("x=Position:mm,F=Force", or a mapping {"x": ("Position", "mm")}).
    age : mapping of str to float, optional
        Seconds by which samples are older than their row, {"psi": 0.03, "y": 0.02}: the ball's angle, the board's
        readings; of another plant by channel.
    plant : Plant or str, optional
        A declaration, a registered name or a plant file; the hoop unless given.
    hold : {"zero", "linear", "smooth", "mean"}
        How the inputs went on from row to row: held, straight, on a smooth curve, as what was filtered does, or on one
        of which every row, of inputs and readings, is a mean over the time about it.

    Returns
    -------
    Recording
        Times, inputs and channels.

    Raises
    ------
    InputError
        Tells file, row and column of what cannot be used.
    ValueError
        An `age` of what there is not.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> recording = lab.load("run.mcap@2:14")  # doctest: +SKIP
    >>> recording.t[0], recording.u.max()  # doctest: +SKIP
    >>> swing = lab.load("decay.csv", "alpha=Angle:deg", plant="pendulum")  # doctest: +SKIP
    """
    declared = resolve_plant(plant) if isinstance(plant, str) else plant
    layout = None if declared is None else layout_of(declared)
    ages, known = dict(age or {}), ("psi", "y") if layout is None or layout.is_tick else tuple(layout.channels)
    if unknown := [str(name) for name in ages if name not in known]:
        raise ValueError(f"age: unknown {', '.join(unknown)}; known: {', '.join(known)}")
    recording = read_recording(str(path), columns, layout=layout, hold=hold)
    return aged(recording, **{f"{name}_s": age for name, age in ages.items()}) if ages else recording


def experiment(
    kind: str,
    *,
    rig: Model | str = "hoop",
    plant: Plant | str | None = None,
    at: Mapping[str, float] | None = None,
    file: Path | str | None = None,
    seed: int = 0,
    duration: float | None = None,
    amplitude: float | None = None,
    model: Path | str | None = None,
    use: float = 0.8,
    clock: int = 1,
    low: float | None = None,
    high: float | None = None,
    hold: float | None = None,
    kick: float | None = None,
    rest: float | None = None,
    max_torque: float = 0.3,
    max_speed: float = 45.0,
    max_angle: float = 1.25,
    soft_start: float = 1.0,
    soft_end: float = 0.5,
    centring: float = 0.0,
    around: Path | str | None = None,
    no_ball: bool = False,
    sets: Mapping[str, Any] | Sequence[str] = (),
) -> Recording:
    """Play a test signal on the simulated rig, or on the model of another plant, and record it.

    Parameters
    ----------
    kind : {"prbs", "chirp", "multisine", "steps", "decay"}
        The signal.
    rig : Model or str
        Of the hoop: the model that the rig's plant follows, which nobody else is told.
    plant : Plant or str, optional
        Another plant, which is simulated: a declaration, a registered name or a plant file.
    at : mapping of str to float, optional
        Of another plant: inputs about which to move, and states at the start.
    file : str or Path, optional
        Where the recording is kept (.mcap).
    seed : int
        Of signal and noise.
    duration : float, optional
        Seconds of signal; 20, for decay 34 (of another plant by its usual sample time) unless given.
    amplitude : float, optional
        Of the input, for the hoop in N m; what the model lets through unless given.
    model : str or Path, optional
        Model file that foresees what the signal does; the filter's unless given.
    use : float
        Of the limits, what the signal may use on the model.
    clock : int
        prbs: ticks that a value is held.
    low, high : float, optional
        chirp, multisine: lowest and highest frequency in Hz; 0.3 and 5 (of another plant for as many samples of its
        usual time) unless given, as what follows.
    hold : float, optional
        steps: s of each; 0.4.
    kick, rest : float, optional
        decay: s of input, and without after each kick; 0.2 and 8.
    max_torque : float
        Limit in N m.
    max_speed : float
        Hoop speed in rad/s that ends the experiment.
    max_angle : float
        Ball angle in rad that ends the experiment.
    soft_start, soft_end : float
        s in which the amplitude rises, and falls.
    centring : float
        Feedback that slows the hoop, N m per rad/s.
    around : str or Path, optional
        Controller that holds the ball meanwhile.
    no_ball : bool
        There is no ball in the hoop.
    sets : mapping of str to object
        Keys of the configuration, {"sim.delay_frames": 3}.

    Returns
    -------
    Recording
        What the daemon recorded; of another plant what its sensors would have shown.

    Raises
    ------
    ValueError
        In the words of the command when it refuses, or when the signal could not be played to its end.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> recording = lab.experiment("prbs", duration=4, seed=1)
    >>> round(recording.sample_time_s, 3), len(recording) > 200
    (0.02, True)
    >>> steps = lab.experiment("steps", plant="axis", duration=2)
    >>> list(steps.inputs), list(steps.channels)
    (['F'], ['x'])
    """
    asked = from_python(
        ExperimentOptions, kind=kind, at=at, seed=seed, duration=duration, amplitude=amplitude, model=model, use=use,
        clock=clock, low=low, high=high, hold=hold, kick=kick, rest=rest, max_torque=max_torque, max_speed=max_speed,
        max_angle=max_angle, soft_start=soft_start, soft_end=soft_end, centring=centring, around=around,
        no_ball=no_ball, sets=sets,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{kind}.mcap" if file is None else Path(file)
        if plant is not None and plant != HOOP:
            if rig != HOOP:
                raise ValueError("rig is of the hoop: another plant is simulated itself")
            declared = resolve_plant(plant) if isinstance(plant, str) else plant
            simulate_experiment(replace(asked, out=path), declared)
            return load(path, plant=declared)
        told = Path(folder) / "told.json"
        flags = [*rig_words(rig, folder), "--out", str(path), "--json", str(told)]
        on_the_rig("experiment", *words_of(asked), *RIG, *flags, told=told)
        return load(path)


def daemon(
    law: Controller | str,
    *,
    rig: Model | str = "hoop",
    duration: float = 8.0,
    psi0: float = 0.0,
    zero_angle: float = 0.0,
    reference: float = 0.0,
    **sets: Any,
) -> Recording:
    """Run the daemon with a law on the simulated rig, pictures late and all: what `hoopd --sim` records.

    Parameters
    ----------
    law : Controller or str
        A design, or a controller by name or path.
    rig : Model or str
        The model that the rig's plant follows, which nobody else is told.
    duration : float
        Length in s.
    psi0 : float
        Angle in rad at which the ball is let go, about 1 s after the start.
    zero_angle : float
        Angle in rad that the camera adds.
    reference : float
        Angle in rad, asked for at 3 s.
    **sets : object
        Entries of the configuration with __ for the dot, sim__delay_frames=3.

    Returns
    -------
    Recording
        What the daemon recorded.

    Raises
    ------
    ValueError
        In the words of the daemon when it refuses.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> recording = lab.daemon("lqg", duration=3.0, psi0=0.2)
    >>> bool(abs(recording.psi[-1]) < 0.02)
    True
    """
    with tempfile.TemporaryDirectory() as folder:
        own = as_controller(law)
        known = own.model.save(Path(folder) / "design.yaml")
        path = Controller(own.controller_file, known).save(Path(folder) / "law.yaml").path
        values: dict[str, Any] = {"control.file": path, "device.model": known.path, "sim.psi_rad": psi0}
        values |= {"sim.angle_offset_rad": zero_angle, "sim.commands": _asked(reference)}
        values |= {name.replace("__", "."): value for name, value in sets.items()}
        changes = [part for name, value in values.items() for part in ("--set", f"{name}={value}")]
        on_the_rig(*RIG, *rig_words(rig, folder), *changes, "--duration", str(duration), "--record", folder)
        return load(next(Path(folder).glob("*.mcap")))


def _asked(reference: float) -> str:
    """The rig's operator asks for it."""
    return f"[{{at_s: {ASKED_S}, name: reference, value: {float(reference)!r}}}]" if reference else "[]"


def rig_words(rig: Model | str, folder: str) -> tuple[str, str]:
    """The rig's own plant."""
    return "--set", f"sim.model={as_model(rig).save(Path(folder) / 'rig.yaml').path}"


def on_the_rig(
    *arguments: str, told: Path | None = None, no_is_an_answer: bool = False, patience_s: float = PATIENCE_S
) -> None:
    """Run `hoopd` with this interpreter and package; ValueError with its own words, or the outcome in its result.

    no_is_an_answer: a result was told, whatever the exit code.
    """
    root = str(Path(__file__).resolve().parents[2])
    paths = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-m", "hoopd", *arguments],
        env={**os.environ, "PYTHONPATH": paths},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=patience_s,
        check=False,
    )
    if done.returncode and not (no_is_an_answer and told is not None and told.exists()):
        if told is not None and told.exists():
            raise ValueError(f"experiment: {json.loads(told.read_text())['outcome']}")
        raise ValueError(done.stderr.strip() or done.stdout.strip() or f"hoopd ended with {done.returncode}")
