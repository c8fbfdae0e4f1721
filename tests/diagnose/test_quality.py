"""A recording is judged by itself: what is bad is found, what is only fast or kicked is left alone."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import spoiled
from diagnose.madeup import assess, shipped_plant
from freeruns import COUNT_RAD, PSI_SIGMA_RAD
from samples import sampled
from shared import shared_path

from hoopd.diagnose.camera_faults import camera_faults
from hoopd.diagnose.inputs import source_of
from hoopd.diagnose.quality import recording_quality, standstill as stops
from hoopd.diagnose.quality.recording_quality import cleaned
from hoopd.diagnose.quality.sensor_samples import clustered_error
from hoopd.plants.free_run import FreeRun
from hoopd.plants.registry import plant_named
from hoopd.recording import load
from hoopd.recording.recording import from_columns, from_signals


def corruption_findings(quality):
    return [(one.name, one.share, one.ci95, one.gain) for one in camera_faults([quality])]


CLEAN = {
    "two levels": spoiled.clean,
    "many levels": lambda seed: spoiled.clean(seed, kind="many"),
    "sine": lambda seed: spoiled.clean(seed, kind="sine"),
    "free swings": lambda seed: spoiled.clean(seed, kind="none", start=(0, 0, 1.2, 0)),
    "round and round": lambda seed: spoiled.clean(seed, start=(0, 0, 0, 25)),
    "closed loop": lambda seed: spoiled.closed_loop(seed, 12.0),
}


@pytest.mark.parametrize("kind", sampled(CLEAN, ["round and round", "closed loop"]))
def test_a_clean_recording_has_nothing_bad_in_it(kind):
    recordings = [CLEAN[kind](seed) for seed in range(3)]
    found = [assess(recording) for recording in recordings]
    rows = sum(map(len, recordings))
    for channel in ("theta", "dtheta", "psi"):
        assert sum((~one.channels[channel].counts).sum() for one in found) <= 0.002 * rows, channel
    assert not any(corruption_findings(one) or one.segments for one in found)


def test_noise_floors_are_those_of_the_sensors():
    channels = assess(spoiled.clean(1)).channels
    assert channels["psi"].sigma == pytest.approx(PSI_SIGMA_RAD, rel=0.06)
    assert channels["dtheta"].sigma == pytest.approx(spoiled.DTHETA_SIGMA, rel=0.1)
    assert channels["theta"].sigma == pytest.approx(COUNT_RAD / np.sqrt(12.0), rel=0.1)
    assert channels["theta"].quantum == pytest.approx(COUNT_RAD, rel=1e-6)
    assert np.isnan(channels["psi"].quantum)


@pytest.mark.parametrize("equal", [True, False], ids=["equal to the bit", "measured anew"])
@pytest.mark.parametrize("share", [0.03, 0.2])
def test_late_frames_are_found_with_their_share(share, equal):
    recording = spoiled.clean(7)
    rows = spoiled.chosen(recording, share, 7)
    quality = assess(spoiled.late(recording, rows, equal))
    ((name, found, (low, high), gain),) = corruption_findings(quality)
    assert name == "camera.late_frames"
    assert low < rows.mean() < high
    assert found == pytest.approx(rows.mean(), rel=0.15)
    assert gain > 100.0
    psi = quality.channels["psi"]
    visible = np.abs(np.diff(recording.extra["exact"], prepend=0.0)) > 4 * PSI_SIGMA_RAD
    assert (~psi.counts)[rows & visible].mean() > 0.95
    assert psi.late[~rows].mean() < 0.005


@pytest.mark.parametrize("sigmas", [6.5, 10.0, 30.0, None])
@pytest.mark.parametrize("share", [0.03, 0.2])
def test_false_angles_are_found_with_their_share(share, sigmas):
    recording = spoiled.clean(5)
    rows = spoiled.chosen(recording, share, 5)
    bad = spoiled.false(recording, rows, None if sigmas is None else sigmas * PSI_SIGMA_RAD)
    quality = assess(bad)
    ((name, found, _, _),) = corruption_findings(quality)
    assert name == "camera.outliers"
    assert found == pytest.approx(rows.mean(), rel=0.25)
    outliers = quality.channels["psi"].outliers
    far = rows & (np.abs(bad.psi - recording.extra["exact"]) > 6 * PSI_SIGMA_RAD)
    assert outliers[far].mean() > 0.95
    assert outliers[~rows].mean() < 0.02


def test_false_angles_are_found_while_the_ball_goes_round_and_psi_is_wrapped():
    recording = spoiled.clean(3, 20.0, start=(0, 0, 0, 28))
    wrapped = replace(recording, psi=np.remainder(recording.psi + np.pi, 2 * np.pi) - np.pi)
    rows = spoiled.chosen(recording, 0.05, 3)
    anywhere = np.random.default_rng(3).uniform(-np.pi, np.pi, rows.sum())
    psi = assess(spoiled.changed(wrapped, "psi", rows, anywhere)).channels["psi"]
    assert (~psi.counts)[rows].mean() > 0.9
    assert (~psi.counts)[~rows].mean() < 0.04


def test_the_interval_of_a_share_holds_how_far_stretches_differ_where_they_do():
    """A camera that is slow for a while, again and again: of another recording another share is late."""
    rng, counted, held = np.random.default_rng(3), np.ones(1500, dtype=bool), []
    for clustered in (False, True):
        hits = []
        for _ in range(150):
            shares = rng.choice([0.0, 0.2], 5, p=[0.7, 0.3]) if clustered else np.full(5, 0.06)
            bad = rng.random(1500) < np.repeat(shares, 300)
            single = np.sqrt(bad.mean() * (1.0 - bad.mean()) / 1500)
            error = clustered_error(bad, counted, single)
            assert error >= single * (1.0 - 1e-9)
            hits.append([abs(bad.mean() - 0.06) < 1.96 * one for one in (single, error)])
        held.append(np.mean(hits, axis=0))
    (alone, same), (narrow, wide) = held
    assert alone == pytest.approx(0.95, abs=0.04) and same == pytest.approx(0.95, abs=0.05)
    assert narrow < 0.6 and wide > narrow + 0.2


def test_late_and_false_angles_in_one_recording_are_told_apart():
    recording = spoiled.clean(11)
    late, false = spoiled.chosen(recording, 0.1, 1), spoiled.chosen(recording, 0.1, 2)
    false &= ~late
    found = corruption_findings(assess(spoiled.false(spoiled.late(recording, late, False), false, None)))
    shares = {name: share for name, share, _, _ in found}
    assert shares["camera.late_frames"] == pytest.approx(late.mean(), rel=0.15)
    assert shares["camera.outliers"] == pytest.approx(false.mean(), rel=0.15)


def test_a_camera_that_reads_in_steps_repeats_itself_without_being_late():
    recording = spoiled.clean(2, kind="none", start=(0, 0, 0.1, 0))
    coarse = replace(recording, psi=np.round(recording.psi / 0.005) * 0.005)
    assert (np.diff(coarse.psi) == 0).mean() > 0.1
    assert corruption_findings(assess(coarse)) == []


def test_a_burst_is_a_segment_and_no_effect():
    recording = spoiled.clean(4)
    burst = spoiled.changed(recording, "psi", slice(500, 540), np.random.default_rng(0).uniform(-1.5, 1.5, 40))
    quality = assess(burst)
    ((first, last, reason),) = quality.segments
    assert (first, last) == pytest.approx((10.0, 10.78), abs=0.06)
    assert reason.startswith("psi: values off the course")
    assert corruption_findings(quality) == []
    assert not quality.channels["psi"].counts[505:535].any()


def test_a_drive_that_ends_and_a_camera_that_stops_are_segments():
    recording = spoiled.clean(6)
    ended = spoiled.changed(recording, "theta", slice(1200, None), recording.theta[1200])
    ended = spoiled.changed(ended, "dtheta", slice(1200, None), 0.0)
    ((first, last, reason),) = assess(ended).segments
    assert (first, last) == pytest.approx((24.0, 30.0), abs=0.05)
    assert "answer" in reason
    stopped = assess(spoiled.changed(recording, "psi", slice(1300, None), recording.psi[1300]))
    ((first, last, reason),) = stopped.segments
    assert (first, last) == pytest.approx((26.0, 30.0), abs=0.05)
    assert "repeats" in reason
    assert stopped.channels["psi"].numbers["late"] == 0


def test_a_hoop_at_rest_under_a_small_torque_is_no_drive_that_ended():
    recording = spoiled.clean(6)
    held = spoiled.changed(recording, "theta", slice(600, 700), recording.theta[600])
    held = spoiled.changed(held, "u", slice(600, 700), 0.004)
    held = spoiled.changed(
        held, "theta", slice(700, None), recording.theta[700:] - recording.theta[700] + held.theta[699]
    )
    assert not [reason for *_, reason in assess(held).segments if "answer" in reason]


def test_gaps_jitter_and_set_clocks_are_seen():
    recording = spoiled.clean(1)
    t = recording.t + np.random.default_rng(0).normal(0.0, 0.001, len(recording))
    t[700:] += 1.5
    shifted = t.copy()
    shifted[1000:] -= 0.4
    uneven = replace(recording, t=t, y_t=t, psi_t=shifted)
    notes, clock = assess(uneven).notes, stops.clock(uneven)
    assert any("rows are missing in 1 places, for 1.5" in note for note in notes)
    assert any("clock was set at" in note for note in notes)
    assert clock.jitter_s == pytest.approx(0.001 * np.sqrt(2.0), rel=0.1)
    ((first, last),) = clock.gaps
    assert last - first > 1.4
    assert clock.steps == pytest.approx([t[1000]], abs=0.3)
    assert clock.not_increasing == 0


def test_a_torque_that_stays_at_its_limit_is_told():
    recording = spoiled.clean(1)
    wave = 0.1 * np.sin(2.0 * np.pi * recording.t)
    held = np.repeat(np.random.default_rng(3).normal(0.0, 0.1, len(wave) // 5 + 1), 5)[: len(wave)]
    for u, told in (
        (np.clip(wave, -0.08, 0.08), True),
        (wave, False),
        (held, False),
        (np.clip(10 * wave, -0.7, 0.7), True),
    ):
        notes = assess(replace(recording, u=u)).notes
        end = "limit" if u.max() >= 0.7 else "largest value"
        assert any(f"stays at its {end}" in note for note in notes) == told


def test_uneven_sampling_of_the_encoder_is_no_false_value():
    recording = spoiled.clean(1, kind="many")
    error = np.random.default_rng(1).normal(0.0, 3e-4, len(recording)) * np.gradient(recording.theta, recording.t)
    theta = np.round((recording.theta + error) / COUNT_RAD) * COUNT_RAD
    quality = assess(replace(recording, theta=theta))
    assert quality.channels["theta"].jitter_s == pytest.approx(3e-4, rel=0.2)
    assert quality.channels["theta"].even_sigma < COUNT_RAD
    assert quality.channels["theta"].outliers.mean() < 0.005
    assert any("too early or too late" in note for note in quality.notes)


def test_a_rate_that_is_rounded_far_below_its_noise_is_as_noisy_as_it_is():
    """Its rounding is no noise floor: by that, a little unevenness made it ten times as noisy where it changed fast."""
    recording, plant = spoiled.clean(1, kind="many"), shipped_plant()
    changes = np.gradient(recording.dtheta, recording.t)
    uneven = np.random.default_rng(1).normal(0.0, 2e-3, len(recording)) * changes
    rounded = replace(recording, dtheta=np.round(recording.dtheta + uneven, 2))
    one = assess(rounded).channels["dtheta"]
    assert one.jitter_s > 0.0 and one.even_sigma > 5.0 * one.quantum
    column = list(plant.channels).index("dtheta")
    scatter = np.concatenate([part.scatter[:, column] for part in source_of("a", rounded, plant).stretches])
    assert 1.0 < scatter.max() < 5.0 and np.median(scatter) < 1.5


def test_a_camera_slower_than_the_rows_is_said():
    recording = spoiled.clean(1)
    rows = np.zeros(len(recording), dtype=bool)
    rows[300:400:5] = True
    notes = assess(spoiled.late(recording, rows, equal=True)).notes
    assert any("from 6 to 7.9 s" in note and "40 frames a second" in note for note in notes)


@pytest.mark.parametrize(
    ("change", "channel", "words"),
    [
        (lambda r: r.dtheta, "theta_rate", "scatters"),
        (lambda r: 0.8 * r.dtheta, "theta_rate", "times the slope"),
        (lambda r: np.concatenate([[0.0], r.dtheta[:-1]]), "theta_rate", "samples late"),
        (lambda r: np.gradient(r.theta, r.t), "dtheta", "agrees"),
        (lambda r: np.full(len(r), np.nan), "theta_rate", "missing"),
    ],
)
def test_the_speed_to_be_trusted_is_decided_by_the_data(change, channel, words):
    recording = spoiled.clean(1)
    quality = assess(replace(recording, dtheta=change(recording)))
    assert quality.speeds["dtheta"].channel == channel
    assert words in quality.speeds["dtheta"].reason


def test_cleaned_keeps_what_counts_and_nothing_else():
    recording = spoiled.clean(9)
    rows = spoiled.chosen(recording, 0.05, 9)
    bad = spoiled.false(recording, rows, None)
    quality = assess(bad)
    psi = cleaned(bad, quality).psi
    assert np.array_equal(np.isfinite(psi), quality.channels["psi"].counts)
    assert np.nanmax(np.abs(psi - recording.extra["exact"])) < 0.05
    assert np.array_equal(cleaned(bad, quality).u, bad.u)


def test_every_sample_is_one_thing_and_the_numbers_are_json():
    recording = spoiled.clean(9)
    bad = spoiled.false(recording, spoiled.chosen(recording, 0.05, 1), None)
    bad = spoiled.changed(spoiled.late(bad, spoiled.chosen(recording, 0.05, 2), True), "psi", slice(50, 60), np.nan)
    quality = assess(bad)
    for channel in quality.channels.values():
        kinds = (channel.counts, channel.missing, channel.stuck, channel.late, channel.outliers, channel.ignored)
        assert (np.sum(kinds, axis=0) == 1).all(), channel.name
    numbers = json.loads(json.dumps(quality.data_quality(), allow_nan=False))
    assert numbers["frames"] == len(bad)
    assert numbers["samples"] == 3 * len(bad)
    assert numbers["missing"] == 10
    assert numbers["late_frames"] == pytest.approx(75, abs=15)
    assert numbers["outliers"] == pytest.approx(75, abs=15)


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 12, 40])
def test_short_recordings_are_judged_too(rows):
    whole = spoiled.clean(1, 5.0)
    names = ("t", "u", "theta", "dtheta", "psi")
    quality = assess(from_columns({name: getattr(whole, name)[:rows] for name in names}))
    assert corruption_findings(quality) == []


@pytest.mark.parametrize("names", [("psi",), ("theta",), ("dtheta",), ("theta", "dtheta"), ("theta", "dtheta", "psi")])
def test_sensors_that_are_not_there_are_not_missing_samples(names):
    whole = spoiled.clean(1, 10.0)
    quality = assess(replace(whole, **{name: np.full(len(whole), np.nan) for name in names}))
    assert quality.data_quality()["missing"] == 0
    assert not any(quality.channels[name].counts.any() for name in names)


def test_the_same_recording_gives_the_same_answer():
    recording = spoiled.clean(9)
    bad = spoiled.false(recording, spoiled.chosen(recording, 0.05, 9), None)
    assert assess(bad).data_quality() == assess(bad).data_quality()
    assert corruption_findings(assess(bad)) == corruption_findings(assess(bad))


def test_real_recordings_show_their_late_frames_stuck_camera_and_driver_speed():
    quality = assess(load(shared_path("recordings/meas_hoop01_prbs.mat")))
    assert [name for name, *_ in corruption_findings(quality)] == ["camera.late_frames"]
    ((first, last, _),) = [one for one in quality.segments if "camera" in one[2]]
    assert last - first > 1.5
    assert last == pytest.approx(50.0)
    assert quality.speeds["dtheta"].channel == "theta_rate"
    assert "times the slope" in quality.speeds["dtheta"].reason


def test_a_motor_current_is_no_ball():
    quality = assess(load(shared_path("recordings/meas_hoop02_chirp.mat")))
    assert quality.plant.coordinates == ("theta",)
    assert not quality.channels["psi"].counts.any()


def test_a_reading_that_an_input_moves_by_way_of_another_state_has_no_false_values() -> None:
    """The source's steps bend a capacitor's voltage: no sample near one is false."""
    circuit, random = plant_named("circuit"), np.random.default_rng(3)
    t = np.arange(1000) * circuit.time_scale_s
    u = 5.0 * random.choice((-1.0, 1.0), len(t))
    v = FreeRun(circuit).run([], [0.0, 0.0], t, u[:-1]).readings[:, 0] + 0.02 * random.normal(size=len(t))
    judged = recording_quality.assess(from_signals(t, {"V": u}, {"v": v}), circuit)
    assert judged.segments == [] and judged.channels["v"].numbers["counts"] == len(t)
    assert judged.channels["v"].sigma == pytest.approx(0.02, rel=0.1)


def test_an_input_that_never_moves_is_told():
    recording = spoiled.clean(1)
    notes = assess(replace(recording, u=np.zeros_like(recording.u))).notes
    assert any("is the same in all rows" in note for note in notes)


def test_a_ball_off_the_outer_hoop_is_set_aside_and_told() -> None:
    whole = spoiled.clean(2)
    modes, psi = np.array([""] * len(whole), dtype="<U7"), whole.psi.copy()
    modes[200:300], psi[200:300] = "inner", np.pi
    up = replace(whole, psi=psi, extra={"ball_mode": modes})
    found = source_of("up.mcap", up, shipped_plant())
    t0, t1 = up.t[200], up.t[307]
    assert (pytest.approx(t0), pytest.approx(t1), "the ball is off the outer hoop") in found.quality.segments
    assert any("108 rows were taken with the ball off the outer hoop" in note for note in found.quality.notes)
    assert len(found.stretches) == 2 and not any(
        ((one.t > t0 - up.t[0] + 0.1) & (one.t < t1 - up.t[0] - 0.1)).any() for one in found.stretches
    )
    assert found.quality.channels["psi"].numbers["outliers"] <= 2
