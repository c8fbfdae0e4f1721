"""The pages on identification: their commands run, the session prints what the page shows and draws its figures."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest
from inprocess import call
from scipy.signal import lfilter
from shared import shared_path

ROOT = Path(__file__).resolve().parents[2]
SESSION = runpy.run_path(str(ROOT / "docs" / "ident_session.py"))


def test_the_session_prints_what_the_page_shows_and_draws_its_figures(tmp_path: Path) -> None:
    said = SESSION["run"](tmp_path)
    shown = SESSION["SAID"].search(SESSION["PAGE"].read_text(encoding="utf-8"))
    assert shown is not None
    assert said.splitlines()[0] == shown[1].splitlines()[0]
    # another machine's last digits may be others: the words are the same, the numbers near
    words, numbers = (re.compile(one) for one in (r"[A-Za-z][\w ,-]*", r"-?\d+\.\d+"))
    assert words.findall(said)[:30] == words.findall(shown[1])[:30]
    ours, theirs = (np.array(numbers.findall(text), float)[:20] for text in (said, shown[1]))
    assert np.allclose(ours, theirs, rtol=0.02, atol=0.02)
    for name in SESSION["FIGURES"]:
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
        assert (ROOT / "docs" / "figures" / f"ident_{name}.png").exists()


def test_the_session_has_ten_lines_of_work() -> None:
    code = SESSION["CODE"].search(SESSION["PAGE"].read_text(encoding="utf-8"))
    lines = [line for line in code[1].splitlines() if line.strip() and not line.startswith("from ")]
    assert len(lines) == 10


def test_the_session_on_a_real_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = np.loadtxt(shared_path("plants/daisy/dryer.dat"))
    monkeypatch.chdir(tmp_path)
    code = SESSION["CODE"].search(SESSION["PAGE"].read_text(encoding="utf-8"))[1]
    assert "example_data()" in code
    own = code.replace("example_data()", "detrend(iddata(rows[:, 1], rows[:, 0], dt=0.08))", 1)
    names: dict[str, object] = {"rows": rows}
    exec("from hoopd.ident import detrend, iddata\n" + own.replace("print(identify(train))", ""), names)
    found = names["compare"](names["models"], names["valid"], horizons=[1])  # type: ignore[operator]
    assert max(float(one.percent[1][0]) for one in found) > 90.0
    assert all((tmp_path / f"{name}.png").exists() for name in SESSION["FIGURES"])


@pytest.mark.proof
def test_the_commands_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "guides" / "identify.md").read_text(encoding="utf-8")
    block = re.search(r"```\n(hoopd identify run.csv.*?)```", page, re.DOTALL)
    assert block is not None
    u, e = np.random.default_rng(0).standard_normal((2, 400))
    level = lfilter([0.0, 0.1, 0.05], [1.0, -1.5, 0.7], u) + 0.02 * e
    table = np.column_stack([0.5 * np.arange(400), 40.0 + 5.0 * u, 2.0 + level])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,Valve [%],Level [m]", comments="")
    monkeypatch.chdir(tmp_path)
    for line in block[1].splitlines():
        words = shlex.split(line.split("#")[0])[1:]
        code, _, errors = call(words)
        assert code == 0, (words, errors)
    assert {"model.yaml", "model.png", "model_bode.png", "said.png", "law.yaml"} <= {
        one.name for one in tmp_path.iterdir()
    }
