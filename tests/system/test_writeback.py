"""Physics hidden in the rig, named in the model file: the whole daemon controls better, and says when it is missing.

Sizes and the longer figures: tools/bench/writeback.py, docs/explanations/writeback.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness import runs
from harness.rigrun import run_rig
from samples import sampled

from hoopd.core.feedforward import FeedForward, FeedForwardPart
from hoopd.daemon.replay import replay
from hoopd.files.model import EffectEntry, ModelFile, Parameter, model_text
from hoopd.plants.model_file import load_model, parse_model
from hoopd.recording.mcap import read_run
from hoopd.sim import truth

HOOP = Path(__file__).resolve().parents[2] / "config" / "models" / "hoop.yaml"
HIDDEN: dict[str, dict[str, tuple[float, str]]] = {
    "hoop.coulomb_friction": {"Fc": (0.008, "N m")},
    "actuator.cogging": {"A": (0.007, "N m"), "n": (7.0, "-"), "phi": (0.4, "rad")},
    "hoop.imbalance": {"A": (0.008, "N m"), "phi": (0.7, "rad")},
    "camera.latency": {"d": (0.04, "s")},
}
# The reference steps at 4, 7 and 10 s; a step is over within 1.6 s, then the error is judged.
STEPS = [{"at_s": 4.0 + 3.0 * k, "name": "reference", "value": 0.04 * (-1) ** k} for k in range(3)]


def hide(name: str) -> str:
    told = ", ".join(f"{key}: {value}" for key, (value, _) in HIDDEN[name].items())
    return f"sim.effects=[{{name: {name}, parameters: {{{told}}}}}]"


def named(folder: Path, name: str, **valid: tuple[float, float]) -> Path:
    """A model file with the effect."""
    parameters = {key: Parameter(value=value, unit=unit) for key, (value, unit) in HIDDEN[name].items()}
    entry = EffectEntry(name=name, parameters=parameters, valid=valid)
    base = load_model(HOOP)
    model = ModelFile(
        schema=base.schema,
        name="found",
        structure=base.structure,
        device=base.device,
        parameters=base.parameters,
        effects=[entry],
    )
    path = folder / "found.yaml"
    path.write_text(model_text(model))
    assert parse_model(path.read_text(), path) == model
    return path


def settled_error(folder: Path, *sets: str) -> tuple[float, dict[str, Any]]:
    """RMS of psi less its reference where no step is under way, mrad."""
    rows = ", ".join("{" + ", ".join(f"{k}: {v}" for k, v in row.items()) + "}" for row in STEPS)
    made = run_rig(folder, f"sim.commands=[{rows}]", *sets, duration_s=13.0)
    t = truth.read(folder / "truth.csv").t[-len(made.t) :][: len(made.t)]
    judged = ((t - 4.0) % 3.0 > 1.6) & (t > 2.6)
    return 1e3 * float(np.sqrt(np.mean((made.psi - made.reference)[judged] ** 2))), made.summary


@pytest.mark.parametrize("name", sampled(HIDDEN, ["hoop.imbalance", "camera.latency"]))
def test_the_error_falls_when_the_effect_is_written_back(name: str, tmp_path: Path) -> None:
    base, _ = settled_error(tmp_path / "base", hide(name))
    known, summary = settled_error(tmp_path / "known", hide(name), f"device.model={named(tmp_path, name)}")
    assert known < (0.8 if name == "camera.latency" else 0.3) * base
    assert summary["faults"] == {}
    recording = tmp_path / "known" / summary["recording"]["file"]
    assert replay(recording)["equal"]


def test_the_recording_does_not_tell_what_is_hidden(tmp_path: Path) -> None:
    made = run_rig(tmp_path, hide("hoop.coulomb_friction"), duration_s=1.0)
    path = tmp_path / made.summary["recording"]["file"]
    assert b"coulomb" not in path.read_bytes()
    header = read_run(path).header
    assert "effects: []" in header.config and "coulomb" not in header.config + header.model + header.controller


def test_nothing_is_fed_forward_outside_of_the_region_or_when_it_is_switched_off(tmp_path: Path) -> None:
    name = "actuator.cogging"
    inside = named(tmp_path, name)
    torques = {}
    for label, sets in {
        "known": (f"device.model={inside}",),
        "off": (f"device.model={inside}", "control.feedforward=false"),
    }.items():
        torques[label] = run_rig(tmp_path / label, hide(name), *sets, duration_s=3.0).u
    outside = named(tmp_path, name, dtheta=(40.0, 50.0))
    torques["outside"] = run_rig(tmp_path / "out", hide(name), f"device.model={outside}", duration_s=3.0).u
    np.testing.assert_array_equal(torques["off"], torques["outside"])
    assert np.abs(torques["known"][:50] - torques["off"][:50]).max() > 0.003


@pytest.mark.parametrize("hidden", [True, False])
def test_a_model_that_is_wrong_is_told_once_and_nothing_stops(hidden: bool, tmp_path: Path) -> None:
    effects = [{"name": "hoop.imbalance", "parameters": {"A": 0.008, "phi": 0.7}}] if hidden else []
    commands = [{"at_s": 2.0 + 3.0 * k, "name": "reference", "value": 0.03 * (-1) ** k} for k in range(14)]
    made = runs.run(tmp_path, duration_s=45.0, effects=effects, commands=commands)
    told = [event for event in made.events if event.event == "model_drift"]
    assert len(told) == hidden
    if hidden:
        assert 30.0 < told[0].t < 40.0 and told[0].level == "warning"
        assert "hoopd diagnose" in told[0].fields["says"] and "psi" in told[0].fields["channels"]
        assert any(line["event"] == "model_drift" for line in made.log)
    assert made.modes(2.0, 44.9) == {"RUNNING"}


@pytest.mark.parametrize("torque", [None, float("nan")])
def test_a_feed_forward_that_fails_is_told_once_and_takes_only_itself_away(
    torque: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def demand(x: object, wanted: float, acting: object) -> float:
        if torque is None:
            raise RuntimeError("no such function")
        return torque

    plain = run_rig(tmp_path / "plain", duration_s=3.0)
    monkeypatch.setattr(
        "hoopd.daemon.build.feedforward_of", lambda *given, **named: FeedForward([FeedForwardPart("any")], demand, 0.3)
    )
    made = run_rig(tmp_path / "failing", duration_s=3.0)
    np.testing.assert_array_equal(made.u, plain.u)
    events = read_run(tmp_path / "failing" / made.summary["recording"]["file"]).events
    assert [event.level for event in events if event.event == "feedforward_failed"] == ["error"]
    assert made.summary["faults"] == {}
