"""Physics outside the library: energy, limits, signs, step halving, and the truth that is told to the judge."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import cases, control, forces, nats, plant, recipes, simulate, sizing  # noqa: E402
from concealed.batch import Column, columns_of, scale_inputs  # noqa: E402
from concealed.effects import ALL, OUTSIDE  # noqa: E402
from concealed.families import FAMILIES, USUAL  # noqa: E402
from concealed.outside import bodies, contact, drive, friction, mechanisms, sensing  # noqa: E402
from concealed.recipes import Recipe, Wish, draw  # noqa: E402
from concealed.sensors import Noise  # noqa: E402
from concealed.simulate import WARM, Columns, Trace  # noqa: E402

LOSSLESS = {key: np.array([0.0 if key in ("bb", "bh") else value]) for key, value in plant.DEVICE.items()}
H = 5e-4
LOSSY = ("dahl", "eddy_brake", "running_in", "dwell", "ratchet", "bearing_load", "bouc_wen")
CONSERVATIVE = ("flat_spot", "magnet", "rim_magnets", "wobble")

# Nats of the usual grades.
STEPS = [(5.0, 15.0), (15.0, 45.0), (45.0, 134.0), (134.0, 400.0)]


def moment(
    dtheta: float = 0.0, theta: float = 0.0, psi: float = 0.0, dpsi: float = 0.0, **memory: float
) -> forces.Moment:
    """A moment of one device."""
    state = {name.replace("_speed", ".speed").replace("_angle", ".angle"): np.array([x]) for name, x in memory.items()}
    x = (np.array([value]) for value in (theta, dtheta, psi, dpsi, 0.0))
    return forces.Moment(0.0, *x, plant.body(LOSSLESS), state, H)


def values(**given: float) -> dict[str, np.ndarray]:
    return {key: np.array([value]) for key, value in given.items()}


def drawn(names: Sequence[str], seed: int = 4) -> list[Recipe]:
    """A case of each name with its first size, inputs scaled: of all in one batch."""
    recipes = [draw(Wish("outside", (name,), calm=True), (seed, OUTSIDE.index(name))) for name in names]
    scale_inputs(recipes, 0)
    for recipe, name in zip(recipes, names, strict=True):
        recipe.sizes[name] = ALL[name].first
    return recipes


def batch_of(names: Sequence[str], factor: float) -> Columns:
    """The first recording of each, with its first size times this."""
    cases = zip(drawn(names), names, strict=True)
    return columns_of([Column(recipe, 0, {name: factor * ALL[name].first}) for recipe, name in cases])


def swing(name: str, size: float, seconds: float = 3.0, substeps: int = plant.SUBSTEPS) -> tuple[Columns, Trace]:
    """A device without friction that nobody drives, with one mechanism and perfect sensors."""
    rows = WARM + round(seconds / plant.SAMPLE_S)
    fixed = {**ALL[name].fixed(np.random.default_rng(3)), "phi": 0.0}
    if "direction" in fixed:  # a pawl that the swing passes
        fixed |= {"direction": 1.0, "q": 1.0}
    given = ALL[name].at(size, fixed)
    effect = {key: np.array([given[key]]) for key in ALL[name].neutral}
    zero, none = np.zeros((rows, 1)), np.zeros((rows, 1), dtype=bool)
    still = (np.zeros(1),) * 3
    columns = Columns(
        plant.body(LOSSLESS), {name: effect}, np.array([[0.3], [2.0], [0.9], [-1.0]]), zero,
        np.zeros((rows * plant.PIECES, 2, 1)), Noise(zero, zero, none, none, zero + np.nan),
        control.Law(*still, reference=zero),
    )  # fmt: skip
    return columns, simulate.simulate(columns, substeps)


def own_energy(columns: Columns, trace: Trace) -> np.ndarray:
    """Energy of hoop and ball at the samples, J."""
    none = (np.zeros(1), np.zeros(1))
    return np.array([plant.energy(columns.device, plant.Motion(*row, none))[0] for row in trace.states])


def potential(name: str, p: dict[str, np.ndarray], columns: Columns, trace: Trace) -> np.ndarray:
    theta, psi = trace.states[:, 0, 0], trace.states[:, 2, 0]
    weight, ratio = columns.device.weight, columns.device.ratio
    well = {
        "outside.flat_spot": lambda: -p["A"] * np.exp((np.cos(ratio * (theta - psi) - p["q"]) - 1) / p["w"] ** 2),
        "outside.magnet": lambda: -p["A"] * np.exp((np.cos(psi - theta - p["q"]) - 1) / p["w"] ** 2),
        "outside.rim_magnets": lambda: -p["A"] * np.cos(p["n"] * (psi - theta) - p["q"]),
        "outside.wobble": lambda: weight * (np.cos(psi) - np.cos(psi - p["d"] * np.cos(theta - p["q"]))),
    }
    return np.asarray(well[name]())


@pytest.mark.parametrize("kind", CONSERVATIVE)
def test_what_has_a_potential_keeps_the_energy(kind: str) -> None:
    name = f"outside.{kind}"
    columns, trace = swing(name, 0.3 * ALL[name].cap)
    stored = potential(name, columns.effects[name], columns, trace)
    whole = own_energy(columns, trace) + stored
    # drift-kick-drift swings around the energy: far less than what the mechanism stores
    assert np.ptp(whole) < 0.02 * np.ptp(stored)


@pytest.mark.parametrize("kind", LOSSY)
def test_friction_takes_energy_and_gives_none_back_but_what_it_stored(kind: str) -> None:
    name = f"outside.{kind}"
    size = 0.3 * ALL[name].cap
    columns, trace = swing(name, size)
    assert trace.forces is not None
    before, after = trace.states[:-1, :, 0], trace.states[1:, :, 0]
    speed = (before + after)[:, 1] / 2
    rolling = columns.device.ratio * (speed - (before + after)[:, 3] / 2)
    work = plant.SAMPLE_S * (trace.forces[:, 0, 0] * speed + trace.forces[:, 2, 0] * rolling)
    # the most that a hysteresis of F over the way q stores is F q
    way = columns.effects[name].get("q", np.zeros(1))[0] * (columns.device.ratio[0] if kind == "bouc_wen" else 1.0)
    stored = size * way if kind in ("dahl", "bouc_wen") else 0.0
    # the mean force of a sample times its mean speed is its work to second order
    scale = np.abs(work).sum()
    assert np.cumsum(work).max() <= stored + 0.02 * scale
    assert work.sum() < 0
    energy = own_energy(columns, trace)
    assert energy[-1] - energy[0] == pytest.approx(work.sum(), rel=0.05)


@pytest.mark.parametrize("kind", ["play", "appendage"])
def test_a_hidden_body_and_the_hoop_together_lose_energy_only(kind: str) -> None:
    name = f"outside.{kind}"
    columns, trace = swing(name, 0.5 * ALL[name].cap)
    p = columns.effects[name]
    angle, speed = trace.memory[f"{kind}.angle"][:, 0], trace.memory[f"{kind}.speed"][:, 0]
    stiff = bodies.STOP_RAD_S if kind == "play" else p["w"]
    into = angle - np.clip(angle, -p["b"], p["b"]) if kind == "play" else angle
    whole = own_energy(columns, trace) + p["J"] * (speed**2 + (stiff * into) ** 2) / 2
    lost = whole[0] - whole[-1]
    assert lost > 0
    assert np.diff(whole).max() < 0.02 * lost
    if kind == "play":  # the stops hold
        assert np.abs(angle).max() < p["b"][0] + 0.1


def test_no_size_is_the_plain_device_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(recipes.LENGTH_S, "train_1", 1.0)
    columns = batch_of(OUTSIDE, 0.0)
    none, plain = simulate.simulate(columns), simulate.simulate(replace(columns, effects={}))
    assert np.array_equal(none.history, plain.history)
    assert np.array_equal(none.clean, plain.clean)
    assert np.array_equal(none.rows, plain.rows, equal_nan=True)


@pytest.mark.proof
def test_halving_the_step_changes_little_of_what_a_mechanism_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(recipes.LENGTH_S, "train_1", 1.0)
    columns = batch_of(OUTSIDE, 3.0)
    plain = replace(columns, effects={})
    coarse, fine = (simulate.simulate(columns, n).clean - simulate.simulate(plain, n).clean for n in (40, 80))
    share = (np.std(coarse - fine, axis=0) / (np.std(fine, axis=0) + 1e-12)).max(axis=0)
    assert [name for name, one in zip(OUTSIDE, share, strict=True) if one > 0.05] == []


def test_the_told_force_is_what_moved_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(recipes.LENGTH_S, "train_1", 2.0)
    names = [*mechanisms.FORCES, *mechanisms.ON_HOOP, *mechanisms.MAPS, mechanisms.DEAD_TIME]
    columns = batch_of(names, 1.0)
    trace = simulate.simulate(columns)
    assert trace.forces is not None
    moved, device = nats.change(trace, columns).step, columns.device
    roll = device.ratio * trace.forces[:, 2]
    on_theta, on_psi = trace.forces[:, 0] + roll, trace.forces[:, 1] - roll
    # a constant force for one sample, the device's own answer to it within the sample left out
    told = plant.SAMPLE_S * (device.i11 * on_theta + device.i12 * on_psi)
    left = moved[:, 1] - told
    share = np.sqrt((left**2).mean(axis=0) / (moved[:, 1] ** 2).mean(axis=0))
    assert [name for name, one in zip(names, share, strict=True) if not one < 0.05] == []


def test_presliding_is_a_spring_at_first_and_coulomb_s_friction_in_the_end() -> None:
    p = values(F=2e-3, q=0.2)
    y = {"dahl": 0.0}
    at_first = moment(dtheta=1e-3 / H, **y)
    force, _, _ = friction.dahl(p, at_first)
    assert force == pytest.approx(-2e-3 * 0.5e-3 / 0.2, rel=0.01)  # the mean of a way of 1 mrad
    far = moment(dtheta=100.0, **y)
    for _ in range(100):
        force, _, _ = friction.dahl(p, far)
    assert force == pytest.approx(-2e-3)
    back = moment(dtheta=-1e-3 / H, dahl=1.0)
    assert friction.dahl(p, back)[0] < 0  # it still pulls back after the reversal


def test_running_in_is_the_closed_form_in_the_way() -> None:
    m = moment(dtheta=20.0, running_in=0.0)
    for _ in range(2000):
        limit = friction.running_in(values(F=2e-3, L=10.0), m)
    assert limit == pytest.approx(2e-3 / (1 + 1999 * 20.0 * H / 10.0))


def test_a_contact_ages_at_rest_and_is_as_old_as_its_way_when_it_slides() -> None:
    p = values(F=1e-3, L=2.0)
    rest, slide = moment(dwell=0.0), moment(dtheta=10.0, dwell=1.0)
    for _ in range(2000):
        friction.dwell(p, rest)
        friction.dwell(p, slide)
    assert rest.memory["dwell"] == pytest.approx(1.0)
    assert slide.memory["dwell"] == pytest.approx(2.0 / 10.0, rel=0.05)


def test_a_pawl_drags_one_way_only_and_a_brake_has_its_maximum() -> None:
    p = values(F=1e-3, q=0.5, w=0.4, direction=1.0)
    assert friction.ratchet(p, moment(dtheta=1.0, theta=0.5 + 2 * np.pi)) == pytest.approx(1e-3)
    assert friction.ratchet(p, moment(dtheta=-1.0, theta=0.5)) == 0
    assert friction.ratchet(p, moment(dtheta=1.0, theta=1.0)) == 0
    speeds = np.linspace(0.5, 30.0, 60)
    drag = [float(-friction.eddy_brake(values(A=2e-3, w0=5.0), moment(dtheta=v))[0][0]) for v in speeds]
    assert speeds[int(np.argmax(drag))] == pytest.approx(5.0)
    assert max(drag) == pytest.approx(2e-3)


def test_hysteresis_closes_its_loop() -> None:
    p, m = values(F=1e-4, q=0.1), moment(bouc_wen=0.0)
    work, loop = [], []
    for step in range(4000):
        m.dtheta[...] = 1.0 if (step // 1000) % 2 == 0 else -1.0
        _, _, on_roll = contact.bouc_wen(p, m)
        work.append(float(on_roll[0] * m.dtheta[0] * H))
        loop.append(float(m.memory["bouc_wen"][0]))
    assert max(np.abs(loop)) <= 1.0
    assert loop[1999] == pytest.approx(loop[3999], abs=1e-6)
    assert sum(work[2000:]) < 0


def test_a_motor_heats_a_supply_sags_when_it_drives_and_not_when_it_brakes() -> None:
    hot = moment(motor_heating=0.0)
    for _ in range(4000):
        told = drive.motor_heating(values(a=0.5, T=1.0), np.array([0.2]), hot)
    heat = 4 * -np.expm1(-3999 * H)
    assert told == pytest.approx(0.2 / (1 + 0.5 * heat))
    p = values(r=0.1, T=0.2)
    driving, braking = moment(dtheta=10.0, supply_sag=1.0), moment(dtheta=-10.0, supply_sag=1.0)
    for _ in range(8000):
        driven, braked = (drive.supply_sag(p, np.array([0.2]), m) for m in (driving, braking))
    # at rest V = 1 - r u theta' with the torque that gets through taken before the sag
    assert driven == pytest.approx(0.2 * (1 - 0.1 * 2.0))
    assert braked == 0.2


def test_dead_time_moves_small_torques_more() -> None:
    p, before = values(d=8e-3, u0=0.05), np.array([0.1])
    for now in (0.0, -0.05, 0.2):
        told = [drive.dead_time(p, np.array([now]), before, (j + 1) * H, H) for j in range(40)]
        late_s = 8e-3 * np.exp(-abs(now) / 0.05)
        assert np.mean(told) == pytest.approx(now + (0.1 - now) * late_s / 0.02)


def test_a_shaft_winds_up_by_its_compliance() -> None:
    m = moment(shaft_twist=0.0)
    m.memory["shaft_twist.rate"] = np.zeros(1)
    p = values(c=0.05, T=0.01)
    for _ in range(20):
        sensing.wind(p, np.array([0.1]), m)
    assert m.memory["shaft_twist"] == pytest.approx(0.005 * -np.expm1(-1.0))
    theta, dtheta = sensing.shaft_twist(p, np.array([2.0]), np.array([3.0]), m)
    assert theta == pytest.approx(2.0 + 0.005 * -np.expm1(-1.0))
    assert dtheta == pytest.approx(3.0 + 0.5 * np.exp(-1.0))


def test_ages_beat_and_a_lens_bends() -> None:
    p = values(d=0.02, P=2.0, phi=np.pi)
    assert sensing.beat_age_s(p, 0.5) == pytest.approx(0.02 * 0.75)
    assert sensing.beat_age_s(p, 1.5) == pytest.approx(0.02 * 0.25)
    lens = values(k=0.1, cx=0.6, cy=-0.3)
    for psi in (-1.2, 0.0, 0.7):
        x = np.array((np.sin(psi), np.cos(psi)))
        off = x - (0.6, -0.3)
        there = (0.6, -0.3) + off * (1 + 0.1 * off @ off)
        assert sensing.distortion(lens, np.array([psi])) == pytest.approx(np.arctan2(*there))
    # a lens on the hoop's axis changes the radius and no angle
    assert sensing.distortion(values(k=0.1, cx=0.0, cy=0.0), np.array([0.7])) == pytest.approx(0.7)


def test_every_kind_is_told_and_graded() -> None:
    assert len(OUTSIDE) == len(set(OUTSIDE)) == 20
    for name in OUTSIDE:
        law = ALL[name].law
        assert law is not None
        assert law.slots and law.depends_on and law.formula and law.source
    assert {name for name in OUTSIDE if ALL[name].law.memory} >= set(mechanisms._STATES)
    made = FAMILIES["outside"](4, np.random.default_rng(0))
    for name in OUTSIDE:
        assert sorted(wish.nats for wish in made if wish.effects == (name,)) == STEPS
    assert "outside" not in USUAL
    # one case a kind, too, has every grade
    assert {wish.nats for wish in FAMILIES["outside"](1, np.random.default_rng(0))} == set(STEPS)
    larger = FAMILIES["outside"](4, np.random.default_rng(0), nats=(40.0, 400.0))
    assert {wish.nats for wish in larger} == {(40.0, 71.0), (71.0, 126.0), (126.0, 225.0), (225.0, 400.0)}


def test_every_kind_stands_on_its_page() -> None:
    page = (ROOT / "docs" / "explanations" / "outside.md").read_text(encoding="utf-8").replace("\\|", "|")
    for name in OUTSIDE:
        law = ALL[name].law
        assert law is not None
        assert f"| {name.removeprefix('outside.')} | {', '.join(law.slots)} | {law.formula} |" in page


@pytest.mark.proof
def test_the_truth_of_a_case_is_sealed_with_its_answer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, name, 4.0)
    wishes = [Wish("outside", (name,), nats=(20.0, 30.0)) for name in ("outside.dahl", "outside.play")]
    case, _ = cases.make(recipes.numbered(wishes), 3)
    cases.write([case], tmp_path / "cases", tmp_path / "answers")
    assert sorted(path.name for path in (tmp_path / "cases" / case.identifier).iterdir()) == sorted(case.files)
    (effect,) = case.answer["effects"]
    assert effect["slot"] == "hoop"
    assert effect["law"]["memory"] == "way since the last reversal"
    lines = (tmp_path / "answers" / "signals" / case.identifier / "train_1.csv").read_text().splitlines()
    motion = "true_theta,true_dtheta,true_psi,true_dpsi"
    assert lines[0] == f"t,on_theta,on_psi,on_phi,theta,dtheta,psi,{motion},dahl"
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert len(table) == 200
    assert np.abs(table[:, 1]).max() == pytest.approx(effect["parameters"]["F"], rel=0.2)
    assert not table[:, 2:7].any()
    assert sizing.SEARCH_SUBSTEPS % plant.PIECES == 0
