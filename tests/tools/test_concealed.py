"""The generator of concealed cases: its physics, its sizes, its determinism. It shares no code with what it tests."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoopd.plants.hoop.plant import HoopPlant
from hoopd.recording.formats import load

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import actuators, cases, contacts, nats, plant, recipes, sizing  # noqa: E402
from concealed.batch import Column, columns_of, scale_inputs  # noqa: E402
from concealed.classes import partners  # noqa: E402
from concealed.effects import ALL, OUTSIDE, SINGLES, UNKNOWN  # noqa: E402
from concealed.families import FAMILIES, USUAL  # noqa: E402
from concealed.recipes import Recipe, Wish, draw  # noqa: E402
from concealed.simulate import Trace, simulate  # noqa: E402

DEVICE = plant.body({key: np.array([value]) for key, value in plant.DEVICE.items()})
SWING = np.array([[0.0], [20.0], [0.9], [-3.0]])


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recordings of 4 s."""
    for name in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, name, 4.0)


def drawn(*wishes: Wish, seed: int = 5) -> list[Recipe]:
    """Cases whose training inputs are scaled."""
    made = [draw(wish, (seed, index)) for index, wish in enumerate(wishes)]
    for recording in recipes.TRAINING:
        scale_inputs(made, recording)
    return made


def one(name: str, size: float | None = None, seed: int = 5, **flags: bool) -> Recipe:
    """A case with one effect of a size, its first one unless told."""
    (recipe,) = drawn(Wish("single", (name,), **flags), seed=seed)
    ready(recipe, name, size)
    return recipe


def ready(recipe: Recipe, name: str, size: float | None = None) -> None:
    """Gives the effect a size, and its place in the first recording."""
    recipe.fixed[name] |= sizing.scale(recipe, name)
    recipe.fixed[name] |= {"t0": 1.0, "t1": 2.0} if name == "external.disturbance" else {}
    recipe.fixed[name] |= {"recording": 0.0} if "recording" in recipe.fixed[name] else {}
    recipe.sizes[name] = ALL[name].first if size is None else size


def ran(recipe: Recipe, recording: int = 0, **without: bool) -> Trace:
    sizes = {} if without.get("plain") else recipe.sizes
    return simulate(columns_of([Column(recipe, recording, sizes)]))


def coasted(x: np.ndarray, samples: int, device: plant.Body = DEVICE, substeps: int = plant.SUBSTEPS) -> np.ndarray:
    rows = [x]
    for _ in range(samples):
        rows.append(plant.coast(device, rows[-1], np.zeros(1), substeps=substeps))
    return np.array(rows)


def energy(rows: np.ndarray, device: plant.Body) -> np.ndarray:
    none = (np.zeros(1), np.zeros(1))
    return np.array([plant.energy(device, plant.Motion(*row, none))[0] for row in rows])


def test_energy_is_kept_without_friction_and_lost_with_it() -> None:
    free = plant.body({key: np.array([0.0 if key in ("bb", "bh") else v]) for key, v in plant.DEVICE.items()})
    swing = SWING * np.array([[1.0], [0.1], [1.0], [1.0]])
    kept = energy(coasted(swing, 250, free), free)
    # drift-kick-drift: the energy swings around its value and does not drift
    assert np.ptp(kept) < 1e-4 * np.ptp([0.0, free.weight[0]])
    lost = energy(coasted(swing, 200), DEVICE)
    assert np.all(np.diff(lost) < 0)


def test_halving_the_step_changes_nothing_that_a_camera_sees() -> None:
    coarse, fine, fourth = (coasted(SWING, 150, substeps=n * plant.SUBSTEPS) for n in (1, 2, 4))
    assert np.abs(coarse[:, 2] - fine[:, 2]).max() < 1e-4
    # second order: each halving leaves a quarter
    ratio = np.abs(coarse - fine)[:, 2].max() / np.abs(fine - fourth)[:, 2].max()
    assert 3.5 < ratio < 4.5


def test_plain_device_agrees_with_the_model_of_hoopd() -> None:
    theirs = HoopPlant("rolling", plant.DEVICE)
    x = SWING[:, 0]
    mine, torque = x[:, None], np.array([0.1])
    for _ in range(100):
        x, mine = theirs.advance(x, 0.1, plant.SAMPLE_S), plant.coast(DEVICE, mine, torque)
    # each sample's first substep takes the speed at its start for the friction: J11 (h/2)^2 theta'' a sample
    assert np.abs(mine[:, 0] - x).max() < 3e-4


def test_entries_are_the_linearisation_of_hoopd_s_model() -> None:
    a, b = HoopPlant("rolling", plant.DEVICE).linearize()
    told = {name: float(value[0]) for name, value in plant.entries(DEVICE).items()}
    theirs = (a[1, 1], a[1, 3], a[1, 2], b[1, 0], a[3, 1], a[3, 3], a[3, 2], b[3, 0])
    assert list(told) == ["J11", "J12", "K1", "L1", "J21", "J22", "K2", "L2"]
    assert np.allclose(list(told.values()), theirs, rtol=1e-9)


def test_coulomb_friction_stops_the_hoop_and_holds_it() -> None:
    at_rest = np.zeros(1)
    line, _ = contacts.lines(DEVICE)
    limit = (np.array([2e-3]),)
    speed = np.array([1.0])
    slower, _ = contacts.rub((line,), speed, at_rest, limit, 5e-4)
    # (M^-1)_11 Fc h less in each step, until it stands
    assert slower == pytest.approx(1.0 - float(DEVICE.i11[0]) * 2e-3 * 5e-4)
    stopped, _ = contacts.rub((line,), np.array([1e-4]), at_rest, limit, 5e-4)
    assert stopped == 0.0


def test_two_frictions_together_never_exceed_their_limits() -> None:
    rubs = contacts.lines(DEVICE)
    hoop, ball = np.array([1e-3]), np.array([1e-4])
    v = np.array([[0.8], [0.5]])
    after = np.array(contacts.rub(rubs, v[0], v[1], (hoop, ball), 5e-4))
    mass = np.linalg.inv(np.array([[DEVICE.i11[0], DEVICE.i12[0]], [DEVICE.i12[0], DEVICE.i22[0]]]))
    on_theta, on_psi = mass @ (after - v)[:, 0]
    rolling = -on_psi / DEVICE.ratio[0]
    assert rolling == pytest.approx(-1e-4 * 5e-4, rel=1e-6)
    assert on_theta - DEVICE.ratio[0] * rolling == pytest.approx(-1e-3 * 5e-4, rel=1e-6)


def test_a_ball_with_all_the_grip_in_the_world_rolls(short: None) -> None:
    recipe = one("ball.slip", 1e-6)
    rolled, slid = ran(recipe, plain=True), ran(recipe)
    assert np.abs(rolled.states - slid.states).max() < 1e-6


def test_a_ball_without_grip_does_not_feel_the_hoop() -> None:
    v, none = np.array([[50.0], [0.0], [0.0]]), np.zeros(1)
    after = contacts.slide(DEVICE, v, (none, none, none), none, (None, None), 5e-4)
    assert np.array_equal(after, v)


def test_a_sliding_contact_carries_no_more_than_its_grip() -> None:
    v, none, grip_n = np.array([[50.0], [0.0], [0.0]]), np.zeros(1), np.array([0.1])
    after = contacts.slide(DEVICE, v, (none, none, none), grip_n, (None, None), 5e-4)
    # the hoop loses F Ro h / Ih, the ball gains F R h / (m R^2) and spins up by F Rb h / Ib
    p = plant.DEVICE
    radius = p["Ro"] - p["Rb"]
    by = (-p["Ro"] / p["Ih"], 1 / (p["mb"] * radius), p["Rb"] / p["Ib"])
    assert np.allclose((after - v)[:, 0], 0.1 * 5e-4 * np.array(by))


def test_delay_moves_the_torque_by_its_time() -> None:
    h, sample_s = 5e-4, 0.02
    u = np.array([1.0, 3.0, -2.0, 5.0])
    for delay_s in (0.0, 0.0003, 0.0123, 0.02, 0.0457):
        weights = [actuators.delay_weights(np.array([delay_s]), j, h, sample_s) for j in range(40)]
        mean = np.mean([w[0] * u[3 - n[0]] + (1 - w[0]) * u[3 - n[0] - 1] for n, w in weights])
        t = 0.06 + (np.arange(20000) + 0.5) * 1e-6
        wanted = u[np.floor((t - delay_s) / sample_s).astype(int)].mean()
        assert mean == pytest.approx(wanted, abs=1e-3)


def test_lag_is_the_exact_exponential() -> None:
    mean, after = actuators.lag(np.array([0.03]), np.array([1.0]), np.array([0.0]), 0.02)
    assert after == pytest.approx(1 - np.exp(-2 / 3))
    t = (np.arange(20000) + 0.5) * 1e-6
    assert mean == pytest.approx((1 - np.exp(-t / 0.03)).mean(), rel=1e-6)


def test_camera_latency_shows_the_past(short: None) -> None:
    recipe = one("camera.latency", 0.05)
    trace = ran(recipe)
    # 0.05 s are 20 rows of the history
    assert np.allclose(trace.clean[10:, 2], trace.history[10 * 8 - 20 : -20 : 8][: len(trace.clean) - 10, 2], atol=1e-9)


def test_neutral_parameters_are_the_plain_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(recipes.LENGTH_S, "train_1", 1.5)
    monkeypatch.setitem(recipes.LENGTH_S, "train_2", 1.5)
    (recipe,) = drawn(Wish("null"))
    plain = columns_of([Column(recipe, 0, {})])
    effects = {name: {k: np.array([v]) for k, v in ALL[name].neutral.items()} for name in ALL if name != "ball.slip"}
    loaded, bare = simulate(replace(plain, effects=effects)), simulate(plain)
    assert np.abs(loaded.history - bare.history).max() < 1e-6
    assert np.abs(loaded.clean - bare.clean).max() < 1e-6


@pytest.mark.proof
def test_every_effect_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    for recording in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, recording, 2.0)
    names = [*SINGLES, *UNKNOWN, *OUTSIDE]
    made = drawn(*[Wish("single", (name,)) for name in names])
    for recipe, name in zip(made, names, strict=True):
        ready(recipe, name)
    plain = simulate(columns_of([Column(recipe, 0, {}) for recipe in made])).rows
    hidden = np.empty_like(plain)
    for group in ([n for n in names if n != "ball.slip"], ["ball.slip"]):
        index = [names.index(name) for name in group]
        hidden[..., index] = simulate(columns_of([Column(made[i], 0, made[i].sizes) for i in index])).rows
    moved = np.abs(np.nan_to_num(plain) - np.nan_to_num(hidden)).max(axis=(0, 1))
    assert [name for name, most in zip(names, moved, strict=True) if most < 1e-5] == []


def test_nats_are_the_expected_gain_in_log_likelihood(short: None) -> None:
    """Torque bias enters linearly: gain of a fit with it, over many noises, is nats + 1/2 on average."""
    made = drawn(*[Wish("single", ("actuator.torque_bias",))] * 40)
    wanted = [Column(recipe, index, {"actuator.torque_bias": 2.5e-3}) for recipe in made for index in (0, 1)]
    batch = columns_of(wanted)
    trace = simulate(batch)
    effect = nats.change(trace, batch)
    clean = nats.change(trace, batch, disturbed=False)
    data = nats.Change(clean.step, np.nan_to_num(trace.rows - trace.states[:-1, :3]))
    sigmas = nats.sigmas_of(
        np.array([item.recipe.dtheta_noise for item in wanted]), np.array([item.recipe.psi_noise for item in wanted])
    )
    grams = nats.gram(trace, batch, [item.recipe.colour for item in wanted], sigmas, [effect, data])
    pooled = grams[::2] + grams[1::2]
    expected = np.array([nats.gain(g, 0) for g in pooled])
    # gain = (|P r|^2 - |P' r|^2)/2 with P' without the effect's direction: from the Gram matrix, its Schur complement
    found = np.array([_reached(g) for g in pooled])
    z = (found - expected - 0.5) / np.sqrt(2 * expected + 0.5)
    assert expected.min() > 1
    assert abs(z.mean()) < 4 / np.sqrt(len(z))
    assert 0.6 < z.std() < 1.5
    # the filter whitens what is an Ornstein-Uhlenbeck disturbance: unit variance of what is left
    ou = np.array([item.recipe.colour.kind == "ou" for item in wanted])
    rows = np.isfinite(trace.rows).sum((0, 1)) - 4
    plain = grams[:, 9, 9] - grams[:, 8, 8]
    assert np.median(plain[ou] / rows[ou]) == pytest.approx(1.0, abs=0.1)


def _reached(gram: np.ndarray) -> float:
    keep = slice(0, nats.ENTRIES)
    scale = np.sqrt(np.diag(gram)[keep])
    inverse = np.linalg.pinv(gram[keep, keep] / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    seen = gram[keep, 8:] / scale[:, None]
    left = gram[8:, 8:] - seen.T @ inverse @ seen
    return float(left[0, 1] ** 2 / left[0, 0] / 2)


@pytest.mark.proof
def test_the_integrator_is_not_visible() -> None:
    """Over a whole calm case, both recordings of 30 s, and with the least noise that sensors have."""
    made = drawn(*[Wish("null", calm=True)] * 3)
    wanted = [Column(recipe, index, {}) for recipe in made for index in recipes.TRAINING]
    batch = columns_of(wanted)
    trace = simulate(batch)
    x = trace.states[:-1].transpose(1, 0, 2)
    sigmas = nats.sigmas_of(np.full(6, 0.05), np.full(6, 1e-3))

    def visible(substeps: int) -> float:
        coarse, fine = (plant.coast(batch.device, x, trace.torque, substeps=n) for n in (substeps, 8 * plant.SUBSTEPS))
        change = nats.Change((coarse - fine).transpose(1, 0, 2), np.zeros_like(trace.clean))
        grams = nats.gram(trace, batch, [item.recipe.colour for item in wanted], sigmas, [change])
        return max(nats.gain(g) for g in grams[::2] + grams[1::2])

    assert visible(plant.SUBSTEPS) < 1e-3
    # it would be seen if it were there: the step's error is of second order, its nats of fourth
    assert visible(plant.SUBSTEPS // 10) > 1e-2


@pytest.mark.proof
def test_an_effect_of_no_size_is_not_visible(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but the effect tells a tiny one from the plain device: nats grow with the square of the size."""
    for recording in recipes.RECORDINGS:
        monkeypatch.setitem(recipes.LENGTH_S, recording, 2.0)
    names = [name for name in (*SINGLES, *UNKNOWN, *OUTSIDE) if not ALL[name].drawn]
    made = drawn(*[Wish("single", (name,)) for name in names])
    for recipe, name in zip(made, names, strict=True):
        ready(recipe, name)
    usual, tiny = (
        sizing.visible([(r, {n: ALL[n].first * factor}) for r, n in zip(made, names, strict=True)])
        for factor in (1.0, 1e-3)
    )
    assert [n for n, a, b in zip(names, usual, tiny, strict=True) if b > 1e-4 * a + 1e-4] == []


def test_sizes_are_found_and_coarse_steps_see_the_same(short: None) -> None:
    made = drawn(Wish("single", ("hoop.coulomb_friction",)), Wish("single", ("frame.tilt",)))
    sizing.find_sizes(made)
    for recipe in made:
        (name,) = recipe.sizes
        assert recipe.capped[name] or recipe.nats[name] == pytest.approx(recipe.targets[name], rel=0.25)
    fine = []
    for recipe in made:
        wanted = [Column(recipe, index, recipe.sizes) for index in (0, 1)]
        batch = columns_of(wanted)
        trace = simulate(batch)
        sigmas = nats.sigmas_of(np.full(2, recipe.dtheta_noise), np.full(2, recipe.psi_noise))
        grams = nats.gram(trace, batch, [recipe.colour] * 2, sigmas, [nats.change(trace, batch)])
        fine.append(nats.gain(grams.sum(0)))
    assert fine == pytest.approx([next(iter(recipe.nats.values())) for recipe in made], rel=0.05)


@pytest.mark.proof
def test_an_effect_that_cannot_be_seen_keeps_its_cap_and_says_so(short: None, monkeypatch: pytest.MonkeyPatch) -> None:
    wish, cap = Wish("single", ("hoop.coulomb_friction",)), ALL["hoop.coulomb_friction"].cap
    (seen,) = cases.make([wish], 6)
    monkeypatch.setattr(recipes, "NATS", (1e9, 1e9))  # more than the cap can show
    (capped,) = cases.make([wish], 6)
    (usual,), (largest,) = seen.answer["effects"], capped.answer["effects"]
    assert usual["capped"] is False
    assert usual["parameters"]["Fc"] < cap
    assert largest["capped"] is True
    assert largest["parameters"]["Fc"] == pytest.approx(cap)
    assert usual["nats"] < largest["nats"] < largest["target"]


def test_same_seed_same_bytes_and_another_seed_other_ones(short: None) -> None:
    wishes = recipes.numbered([Wish("single", ("camera.late_frames",)), Wish("null", closed=True)])
    first, again, other = (cases.make(wishes, seed) for seed in (3, 3, 4))
    assert [case.files for case in first] == [case.files for case in again]
    assert [case.answer for case in first] == [case.answer for case in again]
    assert {case.identifier for case in first}.isdisjoint(case.identifier for case in other)
    with pytest.raises(ValueError, match="one number"):
        cases.make([Wish("null"), Wish("null")], 3)


def test_a_case_s_folder_holds_recordings_and_nothing_of_the_answer(short: None, tmp_path: Path) -> None:
    (case,) = cases.make([Wish("left_out", ("frame.vibration",))], 3)
    cases.write([case], tmp_path / "cases", tmp_path / "sealed" / "answers")
    names = sorted(str(path.relative_to(tmp_path / "cases")) for path in (tmp_path / "cases").rglob("*.*"))
    assert names == [f"{case.identifier}/{name}.csv" for name in ("holdout", "train_1", "train_2")]
    told = [path.read_text().splitlines() for path in (tmp_path / "cases").rglob("*.csv")]
    assert {lines[0] for lines in told} == {"t,u,theta,dtheta,psi"}
    # nothing but numbers, and nothing beside the five columns
    assert {len([float(cell or "nan") for cell in line.split(",")]) for lines in told for line in lines[1:]} == {5}
    assert case.answer["effects"][0]["name"] == "frame.vibration"
    assert case.answer["left_out"] == ["frame.vibration"]


def test_recordings_are_read_by_hoopd(short: None, tmp_path: Path) -> None:
    (case,) = cases.make([Wish("null")], 3)
    cases.write([case], tmp_path / "cases", tmp_path / "answers")
    recording = load(tmp_path / "cases" / case.identifier / "train_1.csv")
    assert len(recording) == 200
    assert np.isfinite(recording.u).all() and np.isfinite(recording.theta).all()
    assert np.isfinite(recording.psi).mean() > 0.9
    # the encoder counts
    counts = recording.theta / (2 * np.pi / 4096)
    assert np.abs(counts - np.round(counts)).max() < 1e-6


def test_base_parameters_are_three_to_ten_percent_off() -> None:
    for index in range(30):
        recipe = draw(Wish("null"), (9, index))
        off = [abs(recipe.base[name] / value - 1) for name, value in plant.DEVICE.items() if name != "g"]
        assert min(off) >= 0.03 - 1e-9
        assert max(off) <= 0.10 + 1e-9


def test_families_have_the_cases_that_were_asked_for() -> None:
    rng = np.random.default_rng(0)
    assert sorted({w.effects[0] for w in FAMILIES["single"](2, rng)}) == sorted(SINGLES)
    assert len(FAMILIES["single"](2, rng)) == 2 * len(SINGLES)
    slots = [[ALL[name].slot for name in wish.effects] for wish in FAMILIES["compound"](20, rng)]
    assert all(len(set(each)) == len(each) >= 2 for each in slots)
    assert {w.effects[0] for w in FAMILIES["unknown"](len(UNKNOWN), rng)} == set(UNKNOWN)
    left_out = [w.effects[0] for w in FAMILIES["left_out"](1, rng)]
    assert len(left_out) == len(set(left_out)) >= 10
    assert not any(partners(name) for name in left_out)
    assert "left_out" not in USUAL
