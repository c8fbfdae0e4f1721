"""Controllers: designed, shipped, from files.

Rules of this file: thin over `hoopd.design`; an unstable design can be looked at and is never written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

from hoopd.commands.options.declaration import from_python
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.plant_design import designed
from hoopd.design.arx_law import design_arx
from hoopd.design.controller_text import controller_data, controller_text
from hoopd.design.gang_of_four import gang_of_four
from hoopd.design.laws import LAWS, Law, Spec
from hoopd.design.margins import Margins, margins
from hoopd.design.poles import Pole, closed_loop_poles, unstable
from hoopd.design.weights import Weights
from hoopd.files.controller import ControllerFile, load_controller, parse_controller
from hoopd.files.shipped import defaults_folder, way_to
from hoopd.files.whole_files import replace_file
from hoopd.lab.models import Model, as_model, check_of_hoop, model as load_model, model_of, shipped
from hoopd.lab.pictures import Picture
from hoopd.lab.plant_controllers import DesignedPlant
from hoopd.plants.declaration import Plant
from hoopd.plants.plant_model import PlantModel
from hoopd.plots.loops import draw_gang_of_four
from hoopd.recording.recording import Recording

# Arguments of `design` and what the specification calls them.
SPEC = {"omega": "omega_rad_s", "phase": "phase_deg", "delay": "delay_s", "sample_time": "sample_time_s"}
SPEC |= {name: name for name in ("mt", "zeta", "filter_ratio", "lead", "ratio", "gain", "poles", "weights", "method")}
LISTS = ("lead", "poles", "weights", "method")  # what is not one number
WEIGHTS = {"dtheta": "dtheta_rad_s", "psi": "psi_rad", "dpsi": "dpsi_rad_s", "torque": "torque_nm"}


@dataclass(frozen=True, repr=False)
class Controller:
    """A law as the daemon loads it, and the model that its filter knows."""

    controller_file: ControllerFile
    model: Model
    path: Path | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name}, {self.controller_file.kind}, for the model {self.model.name})"

    @property
    def name(self) -> str:
        """Of its file."""
        return self.controller_file.name

    def save(self, path: Path | str) -> Controller:
        """Write `hoopd.controller/1`; ValueError when its model is in no file, for the daemon reads that one too."""
        target = Path(path)
        if self.model.path is None:
            raise ValueError("the controller file names its model's: save the model first, and design with that one")
        way = way_to(self.model.path, target)
        file = msgspec.structs.replace(self.controller_file, name=target.stem, model=way)
        text = controller_text(msgspec.to_builtins(file), f"Made by hoopd.lab from {self.model.path.name}.")
        parse_controller(text, target)
        replace_file(target, text.encode())
        return Controller(file, self.model, target)


@dataclass(frozen=True, repr=False)
class Design(Controller):
    """A designed law with its linear loop."""

    law: Law | None = None

    @property
    def linear(self) -> Law:
        """Controller, plant and loop as python-control systems, and the numbers found on the way."""
        assert self.law is not None
        return self.law

    @property
    def numbers(self) -> dict[str, Any]:
        """What the design found and promised: gains, specification, largest |T|."""
        return self.linear.numbers

    @property
    def notes(self) -> tuple[str, ...]:
        """What the design could not keep."""
        return self.linear.notes

    @cached_property
    def margins(self) -> Margins:
        """Phase in rad, delay in s, factors of gain, largest |S| and |T|."""
        return margins(self.linear.loop)

    def margins_later(self, delay: float) -> Margins:
        """The same law in a loop that is `delay` s later than what it was designed for."""
        return margins(self.linear.loop, delay)

    @cached_property
    def poles(self) -> list[Pole]:
        """Of the closed loop, the slowest first."""
        return closed_loop_poles(self.linear.loop)

    @property
    def stable(self) -> bool:
        """The closed loop, delay and sampling included."""
        return unstable(self.poles) is None

    def save(self, path: Path | str) -> Controller:
        """Write the file that the daemon loads; ValueError for an unstable loop."""
        if worst := unstable(self.poles):
            raise ValueError(f"the closed loop is unstable, |z| = {abs(worst.z):.4g}: not written")
        return super().save(path)

    def plot(self) -> Picture:
        """The gang of four."""
        gang = gang_of_four(self.linear.plant, self.linear.controller, self.linear.loop)
        return Picture(draw_gang_of_four({"": gang}, f"Gang of four: {self.name}"))


def design(
    law: str,
    model: Model | PlantModel | Path | str | None = None,
    *,
    plant: Plant | str | None = None,
    at: Mapping[str, float] | None = None,
    steer: Sequence[str] | None = None,
    recording: Recording | None = None,
    omega: float | None = None,
    mt: float | None = None,
    phase: float | None = None,
    zeta: float | None = None,
    filter_ratio: float | None = None,
    lead: tuple[float, float] | None = None,
    ratio: float | None = None,
    gain: float | None = None,
    poles: Sequence[complex] | None = None,
    weights: Weights | Mapping[str, float] | None = None,
    delay: float | None = None,
    sample_time: float | None = None,
    method: str | None = None,
) -> Design | DesignedPlant:
    """Design a law for a model of any plant.

    Parameters
    ----------
    law : {"lqg", "lqr", "placement", "pid", "pi", "lead", "lag", "arx"}
        What kind; "arx" wants a recording. Of another plant than the hoop "lqg" or "placement".
    model : Model, str or Path, optional
        A model, its name or its path; another plant's nominal values unless given.
    plant : Plant or str, optional
        A declaration, a registered name or a plant file; the model's unless given.
    at : mapping of str to float, optional
        Of another plant: inputs that are held, and states near which to look for the equilibrium; one that needs an
        input that was not named is refused.
    steer : sequence of str, optional
        Of another plant with several inputs: those that the law moves; all of them unless given.
    recording : Recording, optional
        Goes with the law arx, and only with it.
    omega : float, optional
        rad/s at which the loop is shaped, or the link acts.
    mt : float, optional
        pid: largest |T|.
    phase : float, optional
        Degrees; pid: angle of the touching point; pi: phase margin.
    zeta : float, optional
        pi: damping, poles placed instead.
    filter_ratio : float, optional
        pid: N of the derivative's filter Td/N; 15 unless given.
    lead : (float, float), optional
        pid: lead link in series, rad/s and N.
    ratio : float, optional
        lead: N; lag: M; 5 unless given.
    gain : float, optional
        lead, lag: N m/rad; 1 unless given.
    poles : sequence of complex, optional
        placement: in rad/s, one a state of the law.
    weights : mapping of str to float, optional
        lqg, arx: deviations that cost one, {"psi": 0.2, "torque": 0.05}; of another plant its states and inputs.
    delay : float, optional
        Age in s of a picture at its tick; 0.05 unless given.
    sample_time : float, optional
        Tick in s; 0.02 unless given, of another plant its usual sample time.
    method : str, optional
        pid, pi, lead, lag: how the law is sampled; "tustin" unless given.

    Returns
    -------
    Design or DesignedPlant
        The law as the daemon loads it, with its linear loop, `numbers`, `margins` and `poles`; of another plant as a
        program of your own loads it, with the plant's own closed loop.

    Raises
    ------
    ValueError
        A law, a name or a number that there is not.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> pid = lab.design("pid", "thesis", delay=0.0)
    >>> round(pid.numbers["kp"], 4), round(pid.numbers["peak_complementary"]["value"], 2), pid.stable
    (0.1967, 1.25, True)
    >>> lab.design("placement", plant="axis", poles=(-20 + 10j, -20 - 10j))
    DesignedPlant(placement for axis: F from x, every 0.001 s)
    """
    given: dict[str, Any] = {
        "omega": omega, "mt": mt, "phase": phase, "zeta": zeta, "filter_ratio": filter_ratio, "lead": lead,
        "ratio": ratio, "gain": gain, "poles": poles, "weights": weights, "delay": delay, "sample_time": sample_time,
    }  # fmt: skip
    specification = {name: value for name, value in given.items() if value is not None}
    if (other := model_of(plant, model)) is not None:
        if recording is not None or method is not None:
            raise ValueError("recording and method are of the hoop's laws")
        asked = from_python(DesignOptions, law=law, at=at, steer=steer, **specification)
        return DesignedPlant(designed(other, asked), Path(model) if isinstance(model, Path | str) else None)
    if at or steer:
        raise ValueError("at and steer are of other plants: a law of the hoop is for rest at the bottom")
    if model is None or isinstance(model, PlantModel):
        raise ValueError("design takes a model, or another plant than the hoop: design('lqg', plant='axis')")
    specification |= {} if method is None else {"method": method}
    if law not in (*LAWS, "arx"):
        raise ValueError(f"unknown law {law!r}; known: {', '.join((*LAWS, 'arx'))}")
    if recording is not None:
        check_of_hoop([recording])
    if (law == "arx") != (recording is not None):
        raise ValueError("a recording goes with the law arx, and only with it")
    spec, own = _spec(specification), as_model(model)
    found = LAWS[law](own.plant, spec) if recording is None else design_arx(own.plant, spec, recording)
    data = controller_data(
        law,
        found.kind,
        found.gains,
        model=own.name,
        notes=f"designed as {law} for pictures {1e3 * spec.delay_s:g} ms old",
        sample_time_s=spec.sample_time_s,
        torque_nm=own.file.device.torque_limit_nm,
    )
    return Design(parse_controller(controller_text(data, law), law), own, None, found)


def controller(name: Path | str) -> Controller:
    """Load a controller, with its model.

    Parameters
    ----------
    name : str or Path
        Its shipped name ("lqg", "pid", "lead", "arx"), or its file's path.

    Returns
    -------
    Controller
        The law as the daemon loads it.

    Raises
    ------
    InputError
        A file that cannot be used.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> lab.controller("pid").controller_file.kind
    'pid'
    """
    path = shipped("controllers", name)
    file = load_controller(path)
    beside = path.parent / file.model
    return Controller(file, load_model(beside if beside.exists() else defaults_folder() / file.model), path)


def as_controller(law: Controller | Path | str) -> Controller:
    """A controller as it is, or by name or path."""
    if not isinstance(law, Controller | Path | str):
        raise ValueError(f"a law is a design, or a controller by name or path, not {law!r}")
    return law if isinstance(law, Controller) else controller(law)


def _spec(given: Mapping[str, Any]) -> Spec:
    for name, value in given.items():
        if name not in LISTS and not isinstance(value, int | float | None):
            raise ValueError(f"{name} must be a number, not {value!r}")
    values: dict[str, Any] = {SPEC[name]: _frozen(value) for name, value in given.items()}
    if "weights" in values:
        values["weights"] = _weights(values["weights"])
    return Spec(**values)


def _frozen(value: Any) -> Any:
    """A list as the tuple that a specification holds."""
    return tuple(value) if isinstance(value, list) else value


def _weights(given: Weights | Mapping[str, float]) -> Weights:
    if isinstance(given, Weights):
        return given
    unknown = [name for name in given if name not in WEIGHTS]
    if unknown or not all(value > 0.0 for value in given.values()):
        raise ValueError(f"weights are numbers above 0 of {', '.join(WEIGHTS)}, not {dict(given)}")
    return replace(Weights(), **{WEIGHTS[name]: float(value) for name, value in given.items()})
