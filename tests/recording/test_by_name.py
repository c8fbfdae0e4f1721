"""Columns of any names and units become the signals of a plant, and go through every format to the bit."""

from __future__ import annotations

import io
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from harness.matlab_table import table
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader

from hoopd.files.reading import InputError
from hoopd.plants.layout import layout_of
from hoopd.plants.registry import plant_named
from hoopd.recording import Recording, Signal, from_columns, from_signals, load, load_all, save
from hoopd.recording.column_choice import SignalLayout, split_unit
from hoopd.recording.slices import read_recording
from tests.shared import shared_path

AXIS = SignalLayout({"F": "N"}, {"x": "m", "v": "m/s"})
T = 0.001 * np.arange(6)
FORMATS = (".mcap", ".mat", ".h5", ".csv")


def bits(recording: Recording) -> dict[str, object]:
    """Bytes of every column, and what the signals are; all NaN are one."""
    numbers = {name: np.where(np.isnan(c), np.nan, c).tobytes() for name, c in recording.columns().items()}
    return {**numbers, **{f"unit of {name}": signal.unit for name, signal in recording.signals.items()}}


def csv(folder: Path, text: str, name: str = "a.csv") -> Path:
    """A file of this text."""
    (folder / name).write_text(text)
    return folder / name


TEXT = "Time [ms],Force,Position (mm),note\n0,1.5,10,start\n1,-2,,-\n2,3,30,end\n"


def test_columns_of_any_names_and_units(tmp_path: Path) -> None:
    path = csv(tmp_path, TEXT)
    run = load(path, "F=Force:kN, x=Position", layout=AXIS)
    assert run.t.tolist() == [0.0, 0.001, 0.002] and run.F.tolist() == [1500.0, -2000.0, 3000.0]
    assert run.x.tolist()[::2] == [0.01, 0.03] and np.isnan(run.x[1]) and np.isnan(run.v).all()
    assert {name: signal.unit for name, signal in run.signals.items()} == {"F": "N", "x": "m", "v": "m/s"}
    named = {"t": "Time [ms]", "F": ("Force", "kN"), "x": ("Position (mm)", "mm"), "x_t": ("Time [ms]", "s")}
    other = load(path, named, layout=AXIS)
    assert np.array_equal(other.F, run.F) and other.x_t.tolist() == [0.0, 1.0, 2.0]
    assert load(path, "F,x,-", layout=AXIS).x[0] == 0.01


def test_the_hoop_s_columns_by_name(tmp_path: Path) -> None:
    path = csv(tmp_path, "t,Angle,Torque,clock\n0,180,100,-0.01\n0.02,90,-50,0.01\n")
    for layout in (None, layout_of(plant_named("hoop"))):
        run = load(path, "theta=Angle:deg,u=Torque:mN m,y_t=clock", layout=layout)
        assert run.is_tick and run.theta == pytest.approx([np.pi, np.pi / 2]) and run.u == pytest.approx([0.1, -0.05])
        assert run.y_t.tolist() == [-0.01, 0.01] and np.isnan(run.psi).all()
    plain = csv(tmp_path, "t,a,b\n0,1,2\n", "b.csv")
    assert load(plain, "u,psi", layout=layout_of(plant_named("hoop"))).psi.tolist() == [2.0]  # a list keeps its meaning


def test_a_number_is_a_value_that_does_not_change_and_a_column_of_that_name_goes_first(tmp_path: Path) -> None:
    path = csv(tmp_path, "t,x,7\n0,1,5\n1,2,6\n")
    assert load(path, "x=x,F=0.5:kN", layout=AXIS).F.tolist() == [500.0, 500.0]
    assert load(path, "x=x,F=7", layout=AXIS).F.tolist() == [5.0, 6.0]


def test_an_input_that_goes_straight(tmp_path: Path) -> None:
    path = csv(tmp_path, "t,F,x\n0,1,2\n1,2,3\n")
    run = load(path, layout=AXIS, hold="linear")
    assert run.inputs["F"].hold == "linear" and load(path, layout=AXIS).inputs["F"].hold == "zero"
    hoop = csv(tmp_path, "t,u,psi\n0,1,2\n1,2,3\n", "b.csv")
    assert load(hoop, hold="linear").inputs["u"].hold == "linear"
    for name in ("c.mcap", "c.h5"):  # these two keep it
        for which in (run, load(hoop, hold="linear")):
            save(which, tmp_path / name)
            assert [s.hold for s in load(tmp_path / name).inputs.values()] == ["linear"]
    with pytest.raises(InputError, match=r"hold: unknown 'cubic'; known: zero, linear"):
        load(path, layout=AXIS, hold="cubic")
    with pytest.raises(InputError, match="hold: unknown 'cubic'"):
        load(hoop, hold="cubic")


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ("F=Force,x=Posiion", r"a\.csv: column Posiion: no such column for x; did you mean 'Position"),
        ("F=Force,x=zzz", r"column zzz: no such column for x; there are Time \[ms\], Force, Position \(mm\), note"),
        ("F=Force:V,x=Position", "column Force: wrong unit 'V': the plant's is N"),
        ("F=Force:stone,x=Position", "column Force: unknown unit 'stone'"),
        ("F=Force,F=Force,x=Position", "columns: F stands twice"),
        ("F=Force,y=Position", "columns: unknown name 'y'; known: F, x, v, t; another plant's come with --plant"),
        ("F=Force,Position", r"columns: expected CHANNEL=COLUMN\[:UNIT\], found 'Position'"),
        ("x=Position", r"no column for the input F; there are .*: say F=COLUMN\[:UNIT\] in --columns .* or F=0"),
        ("F=Force", r"no column for a channel \(x, v\); there are .*: say x=COLUMN"),
        ("F,x", "columns: 2 names for 3 columns beside Time"),
        ("F=Force,x=note", "line 2, column note: expected a number, found 'start'"),
        ("F=inf,x=Position", "column inf: no such column for F"),
        ("t=note,F=Force,x=Position", "line 2, column note: expected a number"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path: Path, columns: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        load(csv(tmp_path, TEXT), columns, layout=AXIS)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,F,x\n0,1,2\n", "no column for the time; there are a, F, x: say t=COLUMN"),
        ("time,Time,F,x\n0,0,1,2\n", "no column for the time"),
        ("t,F,x,x\n0,1,2,3\n", "line 1: x stands twice"),
        ("t,F,x\n0,1,2\n0,1,2\n", "line 3, column t: time must grow"),
        ("t,F,x\n0,1,inf\n", "line 2, column x: must be finite"),
        ("t,F,x\n", "holds a header and no rows"),
    ],
)
def test_files_that_cannot_be(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        load(csv(tmp_path, text), layout=AXIS)


def test_units_behind_names() -> None:
    assert split_unit("Angle [deg]") == ("Angle", "deg") and split_unit("v (m/s)") == ("v", "m/s")
    assert split_unit("Position (left)") == ("Position (left)", "") and split_unit(" x ") == ("x", "")


numbers = st.floats(allow_infinity=False)


@st.composite
def any_run(draw: st.DrawFn) -> tuple[Recording, SignalLayout]:
    """Signals of any plant, some with times of their own."""
    times = draw(st.lists(st.floats(-1e10, 1e10), min_size=1, max_size=5, unique_by=lambda x: x + 0.0))
    t = np.sort(np.array(times))
    column = st.lists(numbers, min_size=len(t), max_size=len(t))
    names = draw(st.lists(st.sampled_from(["F", "x", "h1", "alpha", "speed_left", "T"]), min_size=1, unique=True))
    count, units = draw(st.integers(0, len(names) - 1)), st.sampled_from(["", "N", "m", "rad", "m3/s", "-"])
    signals = {}
    for name in names:
        sampled = t if draw(st.booleans()) else np.clip(draw(column), -1e300, 1e300)
        signals[name] = Signal(np.array(draw(column)), sampled, draw(units))
    inputs, channels = dict(list(signals.items())[:count]), dict(list(signals.items())[count:])
    layout = SignalLayout({n: s.unit for n, s in inputs.items()}, {n: s.unit for n, s in channels.items()})
    return from_signals(t, inputs, channels, source="made", config="a: 1\n"), layout


@settings(max_examples=80, deadline=None)
@given(run=any_run(), first=st.sampled_from(FORMATS), second=st.sampled_from(FORMATS), told=st.booleans())
def test_every_format_to_every_format_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory,
    run: tuple[Recording, SignalLayout],
    first: str,
    second: str,
    told: bool,
) -> None:
    (recording, layout), folder = run, tmp_path_factory.mktemp("trip")

    def again(extension: str, name: str) -> Recording:
        # MCAP and HDF5 say what they hold; of CSV and MATLAB files the plant does
        return load(folder / f"{name}{extension}", layout=layout if told or extension in (".csv", ".mat") else None)

    save(recording, folder / f"a{first}")
    save(again(first, "a"), folder / f"b{second}")
    assert bits(again(second, "b")) == bits(recording)


def axis(rows: int = 300) -> Recording:
    """A run of the axis."""
    t = 0.001 * np.arange(rows)
    x = np.where(np.arange(rows) % 3 == 0, np.nan, 1e-3 * np.sin(9 * t))
    return from_signals(t, {"F": Signal(np.sin(t), t, "N")}, {"x": Signal(x, t - 2e-4, "m")}, source="made")


def test_files_of_ours_say_what_they_hold(tmp_path: Path) -> None:
    for extension in (".mcap", ".h5"):
        for name in ("a", "b"):
            save(axis(), tmp_path / f"{name}{extension}")
        assert (tmp_path / f"a{extension}").read_bytes() == (tmp_path / f"b{extension}").read_bytes()
        run = load(tmp_path / f"a{extension}")
        assert (list(run.inputs), list(run.channels), run.source) == (["F"], ["x"], f"a{extension}")
        renamed = load(tmp_path / f"a{extension}", "pos=x,F=0", layout=SignalLayout({"F": "N"}, {"pos": "mm"}))
        assert renamed.pos == pytest.approx(1000 * run.x, nan_ok=True) and np.array_equal(renamed.pos_t, run.x_t)
        with pytest.raises(InputError, match=r"no column for a channel \(alpha\); there are t, F, x"):
            load(tmp_path / f"a{extension}", layout=layout_of(plant_named("pendulum")))
        with pytest.raises(InputError, match="names its columns itself"):
            load(tmp_path / f"a{extension}", "F,x")
    assert len(read_recording(f"{tmp_path}/a.mcap@0.1:0.2")) == 101
    assert len(load_all(tmp_path / "a.h5")) == 1


def test_the_hoop_s_recording_as_another_plant_s(tmp_path: Path) -> None:
    t = 0.02 * np.arange(5)
    save(from_columns({"t": t, "u": t, "theta": 2 * t, "y_t": t - 0.01}), tmp_path / "a.mcap")
    run = load(tmp_path / "a.mcap", "x=theta,F=u", layout=SignalLayout({"F": "N m"}, {"x": "rad"}))
    assert run.x.tolist() == (2 * t).tolist() and run.x_t.tolist() == (t - 0.01).tolist() and not run.is_tick


def test_a_torn_mcap_gives_what_came_before(tmp_path: Path) -> None:
    save(axis(5000), tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "b.mcap").write_bytes(data[: len(data) * 2 // 3])
    run = load(tmp_path / "b.mcap")
    assert 500 < len(run) < 5000 and "never closed" in run.lost and np.array_equal(run.F, axis(5000).F[: len(run)])


def saved(folder: Path, **content: object) -> Path:
    """A MATLAB file."""
    scipy.io.savemat(folder / "a.mat", content)
    return folder / "a.mat"


def test_simulink_s_structure_with_time(tmp_path: Path) -> None:
    signals = np.empty(
        (1, 3), dtype=[("values", object), ("dimensions", object), ("label", object), ("blockName", object)]
    )
    signals[0, 0] = (np.arange(6.0)[:, None], 1.0, "F", "model/Drive")
    signals[0, 1] = (1000 * np.arange(6.0)[:, None], 1.0, "", "model/Encoder")
    signals[0, 2] = (np.arange(12.0).reshape(6, 2), 2.0, "both", "model/Both")
    path = saved(tmp_path, measData={"time": T[:, None], "signals": signals, "blockName": "model/To Workspace"})
    run = load(path, "F=F,x=Encoder:mm,v=both_2", layout=AXIS)
    assert run.F.tolist() == [0, 1, 2, 3, 4, 5] and run.x == pytest.approx(np.arange(6.0)) and run.v[1] == 3.0
    with pytest.raises(InputError, match="no such column for v; there are time, F, Encoder, both_1, both_2"):
        load(path, "F=F,v=zz", layout=AXIS)


def test_structs_by_the_names_of_their_fields(tmp_path: Path) -> None:
    fields = {"F": T, "x": np.arange(6, dtype=np.int16), "name": "text", "one": 1.0}
    path = saved(tmp_path, run={"Time": T, **fields})
    assert load(path, layout=AXIS).x.tolist() == [0, 1, 2, 3, 4, 5]
    assert load(saved(tmp_path, log={"time": T, "signals": fields}), layout=AXIS).F.tolist() == T.tolist()
    values = {"values": np.ones(6), "unit": "kN"}
    assert load(saved(tmp_path, log={"time": T, "signals": {"F": values, "x": T}}), layout=AXIS).F[0] == 1000.0
    assert load(saved(tmp_path, t=T, F=T, x=T, other={"a": 1.0}), layout=AXIS).F.tolist() == T.tolist()
    both = saved(tmp_path, a={"t": T, "F": T, "x": T}, b={"t": T, "F": 2 * T, "x": T})
    with pytest.raises(InputError, match="holds a, b: choose one with --experiment"):
        load(both, layout=AXIS)
    assert load(both, None, "b", layout=AXIS).F[1] == 0.002
    with pytest.raises(InputError, match="c: no such struct with signals; there are a, b"):
        load(both, None, "c", layout=AXIS)
    hoop = saved(tmp_path, measData={"time": T, "signals": {"u": T, "theta": T, "psi": T}})
    assert load(hoop).is_tick and load(hoop).psi.tolist() == T.tolist()
    matrix = saved(tmp_path, meas_pos={"Time": T, "Data": np.arange(24.0).reshape(6, 4)})
    assert load(matrix, "x=Data_2:mm,F=Data_1", layout=AXIS).x.tolist() == [0.001 * k for k in (1, 5, 9, 13, 17, 21)]


def test_a_table_by_the_names_of_its_variables(tmp_path: Path) -> None:
    columns = {"Time": T, "F": np.arange(6.0), "Position": 1000 * T}
    (tmp_path / "a.mat").write_bytes(table(columns, {"Position": "mm"}))
    run = load(tmp_path / "a.mat", "F=F,x=Position", layout=AXIS)
    assert run.t.tolist() == T.tolist() and run.F.tolist() == [0, 1, 2, 3, 4, 5] and run.x == pytest.approx(T)
    assert load(tmp_path / "a.mat", "F=F,x=Position", "T", layout=AXIS).F[1] == 1.0


def test_another_object_is_refused_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(table({"Time": T}, {}, kind="timetable"))
    with pytest.raises(
        InputError, match=r"T: an object, of which no signals are read; save it as a table, or as a str"
    ):
        load(tmp_path / "a.mat", layout=AXIS)
    scipy.io.savemat(buffer := io.BytesIO(), {"run": {"t": T, "F": T, "x": T}})
    data = table({"Time": T}, {}, kind="timetable")
    (tmp_path / "a.mat").write_bytes(buffer.getvalue() + data[128:])
    assert len(load(tmp_path / "a.mat", layout=AXIS)) == 6


def test_a_damaged_table_is_one_line(tmp_path: Path) -> None:
    good = table({"Time": T, "F": T, "x": T}, {"x": "m"})
    random = np.random.default_rng(1)
    for place in [*range(128, 900, 3), *random.integers(128, len(good), 400)]:
        bad = bytearray(good)
        bad[place] = random.integers(256)
        (tmp_path / "b.mat").write_bytes(bad)
        try:
            load(tmp_path / "b.mat", layout=AXIS)
        except InputError as error:
            assert "\n" not in str(error)


def test_hdf5_by_the_names_of_datasets(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in ("one", "two"):
            group = file.create_group(name)
            group["time"], group["Force"], group["pos"] = T, T * 2, 1000 * T
            group["pos"].attrs["unit"] = np.bytes_("mm")
            group["words"] = "text"
    run = load(f"{tmp_path}/a.h5:two", "F=Force,x=pos", layout=AXIS)
    assert run.F.tolist() == (2 * T).tolist() and run.x == pytest.approx(T)
    with pytest.raises(InputError, match="holds one, two: choose one"):
        load(tmp_path / "a.h5", "F=Force,x=pos", layout=AXIS)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["t"], file["F"], file["x"] = T, T, T
    assert load(tmp_path / "b.h5", layout=AXIS).x.tolist() == T.tolist()


def test_a_mat_file_of_version_7_3_by_name(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        group = file.create_group("log")
        group["time"], group["F"] = T[None, :], T[None, :]
        group.create_group("signals")["x"] = T[None, :]
    with (tmp_path / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert load(tmp_path / "a.mat", layout=AXIS).x.tolist() == T.tolist()


@pytest.mark.parametrize(
    ("plant", "file", "rows"),
    [("axis", "axis_1kHz", 24841), ("pendulum", "pendulum_decay_7", 1001), ("falling", "drop_tennis_ball_1", 46)],
)
def test_real_recordings_of_other_plants(tmp_path: Path, plant: str, file: str, rows: int) -> None:
    layout = layout_of(plant_named(plant))
    run = load(shared_path(f"plants/{file}.csv"), layout=layout)
    assert len(run) == rows and np.isfinite(next(iter(run.channels.values())).values).all()
    for extension in FORMATS:
        save(run, tmp_path / f"a{extension}")
        assert bits(load(tmp_path / f"a{extension}", layout=layout)) == bits(run)


def test_samples_in_mcap_have_a_schema_with_units_and_without_unions(tmp_path: Path) -> None:
    save(axis(), tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = [(schema, channel, message) for schema, channel, message in reader.iter_messages()]
    schema, channel, message = found[1]
    described = json.loads(schema.data)
    assert (channel.topic, schema.encoding, len(found)) == ("/hoopd/sample", "jsonschema", 300)
    assert [(name, field["type"], field["unit"]) for name, field in described["properties"].items()] == [
        ("t", "number", "s"),
        ("F", "number", "N"),
        ("x", "number", "m"),
        ("x_t", "number", "s"),
    ]
    assert described["required"] == ["t"] and message.log_time == 1_000_000
    assert json.loads(found[0][2].data).keys() == {"t", "F", "x_t"}  # x is missing there
