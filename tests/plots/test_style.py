"""Figures as files: same bytes from every process, one clear line when a path cannot be used, no global state."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from hoopd.files.reading import InputError
from hoopd.plots import style

DRAW = """
import sys
from pathlib import Path
from hoopd.plots import style
figure = style.figure(4, 3, rows=2, title="Test", sharex=True)
for axes in figure.axes:
    axes.plot([0, 1, 2], [1, 0, 3], label="psi [rad]")
    style.legend(axes)
figure.axes[1].set_xlabel("time [s]")
for path in sys.argv[1:]:
    style.save(figure, Path(path))
assert "matplotlib.pyplot" not in sys.modules
"""


def small() -> Figure:
    figure = style.figure(3, 2)
    figure.axes[0].plot([0, 1], [0, 1], label="a")
    style.legend(figure.axes[0])
    return figure


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the same figure, in every form, of two processes on different days and with other hashes."""
    folder = tmp_path_factory.mktemp("drawn")
    for seed in (1, 2):
        files = [str(folder / f"{seed}{extension}") for extension in style.EXTENSIONS]
        environment = {**os.environ, "PYTHONHASHSEED": str(seed), "SOURCE_DATE_EPOCH": str(seed * 10**9)}
        subprocess.run([sys.executable, "-c", DRAW, *files], env=environment, check=True, timeout=60)
    return folder


@pytest.mark.parametrize("extension", style.EXTENSIONS)
def test_two_processes_write_the_same_bytes(drawn: Path, extension: str) -> None:
    first, second = ((drawn / f"{seed}{extension}").read_bytes() for seed in (1, 2))
    assert first == second
    assert mpl.__version__.encode() not in first


def test_no_part_of_a_figure_is_left_behind(drawn: Path) -> None:
    names = [f"{seed}{extension}" for seed in (1, 2) for extension in style.EXTENSIONS]
    assert sorted(path.name for path in drawn.iterdir()) == sorted(names)


def test_drawing_and_saving_change_no_setting_of_matplotlib(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    style.save(small(), tmp_path / "a.svg")
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(
    ("name", "reason"),
    [("a.gif", "unknown extension '.gif'"), ("a", "unknown extension ''"), ("no/a.png", "no such folder")],
)
def test_a_path_that_cannot_be_used_is_one_line(tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        style.save(small(), tmp_path / name)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_directory_and_a_full_disk_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "d.png").mkdir()
    with pytest.raises(InputError, match="is a directory"):
        style.save(small(), tmp_path / "d.png")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="no space left on device"):
        style.save(small(), tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["d.png"]


def test_colours_are_distinct_in_lightness_or_hue() -> None:
    assert len(set(style.COLOURS)) == len(style.COLOURS) == 7


def test_axes_come_row_by_row() -> None:
    figure = style.figure(rows=2, columns=2)
    places = [one.get_position() for one in figure.axes]
    assert [(place.x0 > 0.4, place.y0 < 0.4) for place in places] == [(0, 0), (1, 0), (0, 1), (1, 1)]
