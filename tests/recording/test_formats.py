"""Every format to every format to the bit, and one line for everything that can be wrong with a file."""

from __future__ import annotations

import io
import os
import random
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings, strategies as st
from mcap.reader import make_reader

from hoopd.files.reading import InputError
from hoopd.recording import Recording, load, load_all, mat5, mcap, save
from hoopd.recording.recording import UNITS, from_columns
from tests.shared import shared_path

FORMATS = (".mcap", ".mat", ".h5", ".csv")
REAL = ("meas_ballOnly01", "meas_hoop01_f05_a01", "meas_hoop01_prbs", "meas_hoop02_chirp", "meas_hoopAndBall2_01")


def made(rows: int = 60) -> Recording:
    """Numbers of every kind: missing ones, times of their own, a current."""
    rng = np.random.default_rng(1)
    t = 0.02 * np.arange(rows)
    columns = {name: rng.normal(size=rows) for name in ("u", "theta", "dtheta", "psi", "current")}
    columns["psi"][::3] = np.nan
    return from_columns({"t": t, **columns, "psi_t": t - 0.05}, source="made", config="a: 1\n")


def bits(recording: Recording) -> dict[str, bytes]:
    """Bytes of every column; all NaN are one."""
    columns = {name: np.array(getattr(recording, name)) for name in UNITS}
    return {name: np.where(np.isnan(column), np.nan, column).tobytes() for name, column in columns.items()}


numbers = st.floats(allow_infinity=False)


@st.composite
def any_recording(draw: st.DrawFn) -> Recording:
    times = draw(st.lists(st.floats(-1e10, 1e10), min_size=1, max_size=6, unique_by=lambda x: x + 0.0))
    t = np.sort(np.array(times))
    names = draw(st.sets(st.sampled_from([name for name in UNITS if name != "t"])))
    size = len(t)
    return from_columns({"t": t, **{n: draw(st.lists(numbers, min_size=size, max_size=size)) for n in sorted(names)}})


@settings(max_examples=120, deadline=None)
@given(recording=any_recording(), first=st.sampled_from(FORMATS), second=st.sampled_from(FORMATS))
def test_every_format_to_every_format_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording, first: str, second: str
) -> None:
    folder = tmp_path_factory.mktemp("trip")
    save(recording, folder / f"a{first}")
    save(load(folder / f"a{first}"), folder / f"b{second}")
    assert bits(load(folder / f"b{second}")) == bits(recording)


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_through_every_format(tmp_path: Path, name: str) -> None:
    recording = load(shared_path(f"recordings/{name}.mat"))
    assert recording.sample_time_s == pytest.approx(0.02)
    for extension in FORMATS:
        save(recording, tmp_path / f"a{extension}")
        assert bits(load(tmp_path / f"a{extension}")) == bits(recording)


def test_the_fourth_column_is_what_the_caller_says() -> None:
    path = shared_path("recordings/meas_hoop02_chirp.mat")
    plain, named = load(path), load(path, columns="u,theta,dtheta,current")
    assert np.isnan(plain.current).all() and np.isnan(named.psi).all()
    assert np.array_equal(plain.psi, named.current)
    assert np.isnan(load(path, columns="u,theta,dtheta,-").psi).all()


@pytest.mark.parametrize("extension", FORMATS)
def test_same_recording_same_bytes_and_nothing_left_beside(tmp_path: Path, extension: str) -> None:
    for name in ("a", "b"):
        save(made(), tmp_path / f"{name}{extension}")
    assert (tmp_path / f"a{extension}").read_bytes() == (tmp_path / f"b{extension}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("extension", [".mcap", ".h5"])
def test_configuration_text_is_kept(tmp_path: Path, extension: str) -> None:
    save(made(), tmp_path / f"a{extension}")
    assert load(tmp_path / f"a{extension}").config == "a: 1\n"


def test_mcap_says_that_it_was_converted(tmp_path: Path) -> None:
    save(made(), tmp_path / "a.mcap")
    run = mcap.read_run(tmp_path / "a.mcap")
    assert (run.header.converted, run.inputs, len(run.ticks)) == ("made", [], 60)
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == 60
        assert "/hoopd/tick" in {channel.topic for channel in summary.channels.values()}
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "torn.mcap").write_bytes(data[: len(data) * 3 // 4])
    mcap.recover(tmp_path / "torn.mcap", tmp_path / "whole.mcap")
    assert len(load(tmp_path / "whole.mcap")) > 10


def test_mcap_whose_rows_do_not_fit(tmp_path: Path) -> None:
    recording = made(2)
    save(recording, tmp_path / "a.mcap")
    first, second = mcap.read_run(tmp_path / "a.mcap").ticks
    with (tmp_path / "b.mcap").open("wb") as file:
        writer = mcap.Writer(file, mcap.Header(), sync=False)
        writer.add_tick(first._replace(x_hat=(1.0,)))  # type: ignore[arg-type]
        writer.add_tick(second)
        writer.finish()
    with pytest.raises(InputError, match=r"b\.mcap: tick: "):
        load(tmp_path / "b.mcap")


def write_h5(path: Path, **groups: dict[str, object]) -> Path:
    """HDF5 file with groups of arrays."""
    with h5py.File(path, "w") as file:
        for name, arrays in groups.items():
            group = file.create_group(name)
            for key, value in arrays.items():
                group[key] = value
    return path


def experiment(rows: int = 9, states: int = 3, turned: bool = False, **changes: object) -> dict[str, object]:
    """Arrays of one experiment, as Julia writes them (`turned`) or as Python does."""
    table = np.arange(rows * states, dtype=float).reshape(rows, states)
    arrays: dict[str, object] = {
        "Timestamps": 0.02 * np.arange(rows),
        "States": table.T if turned else table,
        "Input": np.ones(rows),
    }
    return {name: value for name, value in {**arrays, **changes}.items() if value is not None}


@pytest.mark.parametrize("states", [3, 4])
@pytest.mark.parametrize("turned", [False, True])
def test_hdf5_either_way_round(tmp_path: Path, states: int, turned: bool) -> None:
    recording = load(write_h5(tmp_path / "a.h5", Exp1=experiment(9, states, turned)))
    assert recording.theta.tolist() == [states * k for k in range(9)]
    assert recording.psi.tolist() == [states * k + 2 for k in range(9)]
    if states == 4:
        assert recording.extra["dpsi"].tolist() == [4 * k + 3 for k in range(9)]


def test_hdf5_vectors_may_be_matrices_of_one_row(tmp_path: Path) -> None:
    arrays = experiment(9, 3, True, Timestamps=0.02 * np.arange(9)[None, :], Input=np.ones((9, 1)))
    assert len(load(write_h5(tmp_path / "a.h5", Exp1=arrays))) == 9


def test_hdf5_experiments(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "a.h5", Exp10=experiment(10), Exp2=experiment(12), Exp1=experiment(11))
    assert [len(item) for item in load_all(path)] == [11, 12, 10]
    assert len(load(f"{path}:Exp2")) == len(load(path, experiment="Exp2")) == 12
    with pytest.raises(InputError, match=r"holds Exp1, Exp2, Exp10: choose one, as a.h5:Exp10"):
        load(path)
    with pytest.raises(InputError, match=r"Exp3: no such experiment; there are Exp1, Exp2, Exp10"):
        load(f"{path}:Exp3")
    with pytest.raises(InputError, match="Exp1 in the path and Exp2 beside it"):
        load(f"{path}:Exp1", experiment="Exp2")


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        (experiment(Input=None), "Exp1/Input: no such array; there are States, Timestamps"),
        (experiment(Input=np.ones(8)), "Exp1/Input: has 8 values, Timestamps has 9"),
        (experiment(States=np.ones((8, 3))), "Exp1/States: is 8 x 3, neither side has the 9 rows"),
        (experiment(States=np.ones((9, 3, 2))), "Exp1/States: is 9 x 3 x 2"),
        (experiment(States=np.ones((9, 2))), "Exp1/Input and States: has 3 columns, expected 4"),
        (experiment(3, States=np.ones((3, 3))), "Exp1/States: is 3 x 3 for 3 times"),
        (experiment(Timestamps=np.ones((3, 3))), "Exp1/Timestamps: expected one number a row, found 3 x 3"),
        (experiment(Timestamps=np.array([b"a"] * 9)), "Exp1/Timestamps: expected real numbers"),
        (experiment(Input=["a"] * 9), "Exp1/Input: expected real numbers"),
        (experiment(Timestamps=np.full(9, np.nan)), "row 1, column t: time must be a finite number"),
        (experiment(Input=np.full(9, np.inf)), "row 1, column u: must be finite"),
    ],
)
def test_hdf5_refused(tmp_path: Path, arrays: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        load(write_h5(tmp_path / "a.h5", Exp1=arrays))


def test_hdf5_without_experiments(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no group with Timestamps, States, Input.*; it holds other"):
        load(write_h5(tmp_path / "a.h5", other={"x": 1.0}))
    with pytest.raises(InputError, match="it holds nothing"):
        load(write_h5(tmp_path / "b.h5"))


TIME, DATA = 0.02 * np.arange(7), np.arange(28.0).reshape(7, 4)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"other": 1.0}, "meas_pos: no such struct in the file; it holds other"),
        ({"meas_pos": 1.0}, r"meas_pos: expected one struct, found numbers \(1 x 1\)"),
        ({"meas_pos": {"Time": TIME}}, r"meas_pos.Data: no such field; there are Time"),
        ({"meas_pos": {"Time": TIME, "Data": DATA[:, :3]}}, r"meas_pos.Data: has 3 columns, expected 4"),
        ({"meas_pos": {"Time": TIME[:5], "Data": DATA}}, r"meas_pos.Data: is 7 x 4, neither side has the 5 rows"),
        ({"meas_pos": {"Time": TIME, "Data": "text"}}, r"meas_pos.Data: expected real numbers, found text"),
        ({"meas_pos": {"Time": TIME, "Data": DATA * 1j}}, r"meas_pos.Data: expected real numbers, found complex"),
        ({"meas_pos": {"Time": TIME * 0, "Data": DATA}}, "row 2, column t: time must grow from row to row, found 0.0"),
        ({"meas_pos": {"Time": -TIME, "Data": DATA}}, "row 2, column t: time must grow from row to row"),
        ({"meas_pos": {"Time": TIME + 1.7e12, "Data": DATA}}, "row 1, column t: time is not in seconds"),
        ({"meas_pos": {"Time": TIME[:0], "Data": DATA[:0]}}, "holds no rows"),
    ],
)
def test_mat_refused(tmp_path: Path, content: dict[str, object], says: str) -> None:
    scipy.io.savemat(tmp_path / "a.mat", content)
    with pytest.raises(InputError, match=says):
        load(tmp_path / "a.mat")


@settings(max_examples=60, deadline=None)
@given(
    shape=st.tuples(st.integers(0, 5), st.integers(0, 5)),
    kind=st.sampled_from(["f8", "f4", "i1", "u2", "i4", "u8"]),
    packed=st.booleans(),
    name=st.text("abcXYZ_", min_size=1, max_size=20).filter(lambda text: not text.startswith("_")),
)
def test_mat_is_read_as_scipy_reads_it(shape: tuple[int, int], kind: str, packed: bool, name: str) -> None:
    table = np.arange(shape[0] * shape[1]).reshape(shape).astype(kind) * 3
    content = {"x": "text", "meas_pos": {name: table, "words": ["c", 1.0], "other": np.arange(300)}, "cell": np.eye(2)}
    scipy.io.savemat(buffer := io.BytesIO(), content, do_compression=packed)
    arrays = {array.name: array for array in mat5.variables(buffer.getvalue(), "meas_pos")}
    assert list(arrays) == ["x", "meas_pos", "cell"]
    ours, theirs = mat5.fields(arrays["meas_pos"]), scipy.io.loadmat(buffer)["meas_pos"][0, 0]
    assert list(ours) == list(theirs.dtype.names)
    for field in (name, "other"):
        assert np.array_equal(mat5.values(ours[field]), theirs[field])


def test_real_mat_files_are_read_as_scipy_reads_them() -> None:
    for name in REAL:
        path = shared_path(f"recordings/{name}.mat")
        theirs, ours = scipy.io.loadmat(path)["meas_pos"][0, 0], load(path)
        assert np.array_equal(ours.t, theirs["Time"].ravel())
        assert np.array_equal(np.column_stack([ours.u, ours.theta, ours.dtheta, ours.psi]), theirs["Data"])


def test_damage_in_an_unpacked_mat_file(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"c": np.array(["x", 1.0], object), "meas_pos": {"Time": TIME, "Data": DATA}})
    good = (tmp_path / "a.mat").read_bytes()
    for place in range(124, 500):  # headers and tags: a wrong type there ends the interpreter in scipy
        for value in (0, 0xE5):
            (tmp_path / "b.mat").write_bytes(good[:place] + bytes([value]) + good[place + 1 :])
            try:
                load(tmp_path / "b.mat")
            except InputError as error:
                assert "\n" not in str(error)


def test_mat_of_version_7_3(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        group = file.create_group("meas_pos")
        group["Time"], group["Data"] = TIME[None, :], DATA.T
    with (tmp_path / "a.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert load(tmp_path / "a.mat").psi.tolist() == DATA[:, 3].tolist()


HEAD = "t,u,theta,dtheta,psi\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the file is empty"),
        ("\n\n", "line 1: expected a header with t"),
        ("1,2,3\n", "line 1: expected a header with t and signals .*, found '1,2,3'"),
        ("t;u;speed\n0;1;2\n", "line 1: unknown column 'speed'"),
        ("t;u;theta\n0;1;1.234,5\n", "line 2, column theta: expected a number, found '1.234,5'"),
        ("t,u,speed\n0,1,2\n", "line 1: unknown column 'speed'"),
        ("t,u,speed\n0,1,2\n", "or name them with --columns"),
        ("t,u,u\n0,1,2\n", "line 1: u stands twice"),
        (HEAD, "holds a header and no rows"),
        (HEAD + "0,1,2,3,4\n0.02,1,2\n", "line 3: has 3 cells, the header has 5"),
        (HEAD + "0,1,2,3,4,5\n", "line 2: has 6 cells, the header has 5"),
        (HEAD + "0,1,2,3,4\n\n0.02,1,x,3,4\n", "line 4, column theta: expected a number, found 'x'"),
        (HEAD + "0,1_0,2,3,4\n", "line 2, column u: expected a number, found '1_0'"),
        (HEAD + "0,1,2,3,4\n,1,2,3,4\n", "line 3, column t: time must be a finite number"),
        (HEAD + "0,1,2,3,inf\n", "line 2, column psi: must be finite"),
        (HEAD + "0,1,2,3,4\n0,1,2,3,4\n", "line 3, column t: time must grow from row to row, found 0.0"),
        (HEAD + '0,1,2,"3,4\n', "not CSV: unexpected end of data"),
        (HEAD + "0" * 20_000, "line 2: longer than 16384 characters"),
    ],
)
def test_csv_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        load(tmp_path / "a.csv")


def test_csv_of_other_programs(tmp_path: Path) -> None:
    text = '\ufefft , u,psi\r\n0,0.1,\r\n0.02, .2 ,NaN\r\n\r\n0.04,"-3e-1",1\r\n'
    (tmp_path / "a.CSV").write_bytes(text.encode())
    recording = load(tmp_path / "a.CSV")
    assert recording.u.tolist() == [0.1, 0.2, -0.3]
    assert np.isnan(recording.psi).tolist() == [True, True, False] and np.isnan(recording.theta).all()
    named = load(tmp_path / "a.CSV", columns="u,current")
    assert named.current[2] == 1.0 and np.isnan(named.psi).all()


@pytest.mark.parametrize("extension", FORMATS)
def test_what_is_no_file_of_its_kind(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"a{extension}"
    with pytest.raises(InputError, match="no such file"):
        load(path)
    path.mkdir()
    with pytest.raises(InputError, match="not a file"):
        load(path)
    with pytest.raises(InputError, match="is a directory"):
        save(made(), path)
    for content in (b"", b"\x89PNG\r\n\x1a\n" + bytes(200), b"\xff\xfe" * 100, random.Random(1).randbytes(3000)):
        (other := tmp_path / f"b{extension}").write_bytes(content)
        with pytest.raises(InputError):
            load(other)


@pytest.mark.parametrize(("wrong", "right"), [*pairwise(FORMATS), (".csv", ".mcap"), (".h5", ".mat")])
def test_another_type_with_this_extension(tmp_path: Path, wrong: str, right: str) -> None:
    save(made(), tmp_path / f"a{right}")
    (tmp_path / f"a{right}").rename(tmp_path / f"a{wrong}")
    with pytest.raises(InputError):
        load(tmp_path / f"a{wrong}")


def test_options_that_do_not_fit(tmp_path: Path) -> None:
    for extension in FORMATS:
        save(made(), tmp_path / f"a{extension}")
    with pytest.raises(InputError, match=r"unknown extension \.txt"):
        load("a.txt")
    with pytest.raises(InputError, match="an MCAP file names its columns itself"):
        load(tmp_path / "a.mcap", columns="u,theta")
    with pytest.raises(InputError, match=r"only an \.h5 file holds several experiments"):
        load(tmp_path / "a.csv", experiment="Exp1")
    for columns, says in (
        ("u,theta", "has 4 columns, expected 2"),
        ("u,u,psi,-", "twice"),
        ("u,x,-,-", "unknown name 'x'"),
    ):
        with pytest.raises(InputError, match=says):
            load(tmp_path / "a.mat", columns=columns)


@pytest.mark.parametrize("extension", FORMATS)
def test_an_impossible_recording_is_not_written(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"a{extension}"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match="row 2, column u: must be finite"):
        save(from_columns({"t": [0.0, 1.0], "u": [0.0, np.inf]}), path)
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_read_only_folder_is_one_line(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="permission denied"):
        save(made(), tmp_path / "a.csv")


def damaged(good: bytes, rng: random.Random) -> bytes:
    """A file with some flipped bits, perhaps cut."""
    data = bytearray(good)
    for _ in range(rng.choice((1, 1, 2, 8))):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data[: rng.randrange(len(data))] if rng.random() < 0.2 else data)


@pytest.mark.parametrize("extension", FORMATS)
def test_damage_never_raises_anything_else(tmp_path: Path, extension: str) -> None:
    save(made(), tmp_path / f"a{extension}")
    good, rng = (tmp_path / f"a{extension}").read_bytes(), random.Random(7)
    read: Callable[[Path], object] = load_all
    for _ in range(150):
        (tmp_path / f"b{extension}").write_bytes(damaged(good, rng))
        try:
            read(tmp_path / f"b{extension}")
        except InputError as error:
            assert "\n" not in str(error) and f"b{extension}" in str(error)
