"""Text files as programs and countries write them: semicolons, decimal commas, remarks, units, encodings."""

from __future__ import annotations

from pathlib import Path

import pytest

from hoopd.files.reading import InputError
from hoopd.recording import load
from hoopd.recording.column_choice import SignalLayout
from hoopd.recording.recording import Recording

AXIS = SignalLayout({"F": "N"}, {"x": "m"})
HEATER = SignalLayout({"q": "W"}, {"T": "K"})
BY_PLACE = "t=1,F=2,x=3"


def loaded(folder: Path, name: str, text: str, columns: str | None = None, layout: SignalLayout = AXIS) -> Recording:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return load(path, columns, layout=layout)


@pytest.mark.parametrize(
    ("name", "text", "columns"),
    [
        ("a.csv", "t;F;x\n0;1;2\n0,5;-1,5e-3;2,5\n", None),
        ("a.csv", "\n\nt;F;Kraft, links;x\n0;1;;2\n0.5;-1.5e-3;;2.5\n", None),
        ("a.csv", "0,0;1,0;2,0\n0,5;-1,5e-3;2,5\n", BY_PLACE),
        ("a.txt", "t;F;x\n0;1;2\n0,5;-1,5e-3;2,5\n", None),
        ("a.tsv", "t\tF\tx\n0\t1\t2\n0,5\t-1,5e-3\t2,5\n", None),
        ("a.dat", "0,0 1,0 2,0\n0,5 -1,5e-3 2,5\n", BY_PLACE),
        ("a.dat", "# by hand\nt F x\n0 1 2 % the first\n%\n0.5 -1.5e-3 2.5 # the last\n", None),
        ("a.dat", "t, F, x\n0, 1, 2\n0.5, -1.5e-3, 2.5\n", None),
        ("a.dat", "t y F x # names\n0,0 nan 1,0 2,0\n0,5 nan -1,5e-3 2,5% the last\n", None),
        ("a.dat", "t,F,x\n0,1,2,# the first\n0.5,-1.5e-3,2.5\n", None),
        ("a.csv", '"0,0";"1,0";"2,0"\n"0,5";"-1,5e-3";"2,5"\n', BY_PLACE),
    ],
)
def test_cells_and_commas(tmp_path: Path, name: str, text: str, columns: str | None) -> None:
    found = loaded(tmp_path, name, text, columns)
    assert found.t.tolist() == [0.0, 0.5]
    assert (found.F.tolist(), found.x.tolist()) == ([1.0, -1.5e-3], [2.0, 2.5])


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_with_times_of_day_are_times(tmp_path: Path, zone: str) -> None:
    rows = [f"2026-03-01T08:59:{second}{zone},1,2" for second in ("30", "59.5")] + [f"2026-03-01 09:00:29{zone},1,2"]
    found = loaded(tmp_path, "a.csv", "\n".join(["timestamp,F,x", *rows]))
    assert (found.t - found.t[0]).tolist() == [0.0, 29.5, 59.0]
    assert loaded(tmp_path, "a.csv", "\n".join(["timestamp [ms],F,x", *rows])).t[2] - found.t[0] == 59.0
    with pytest.raises(InputError, match="column F: expected a number, found '2026-03-01'"):
        loaded(tmp_path, "a.csv", "timestamp,F,x\n0,2026-03-01,2\n1,2026-03-02,2\n")
    with pytest.raises(InputError, match="line 3, column timestamp: expected a date, found '2026-13-01'"):
        loaded(tmp_path, "a.csv", "timestamp,F,x\n2026-03-01T08:59:30,1,2\n2026-13-01,1,2\n")


def test_a_percent_sign_in_a_name_is_no_remark(tmp_path: Path) -> None:
    duty = SignalLayout({"duty": ""}, {"x": "m"})
    for name, between in (("a.tsv", "\t"), ("a.csv", ","), ("b.csv", ";")):
        text = "\n".join([between.join(["t", "duty [%]", "x"]), between.join("012"), between.join("112")])
        assert loaded(tmp_path, name, text, layout=duty).duty.tolist() == [0.01, 0.01]


def test_units_of_inches_and_pounds(tmp_path: Path) -> None:
    found = loaded(tmp_path, "a.csv", "t [ms],F [lbf],x (in)\n0,1,2\n1,1,2\n")
    assert found.F[0] == pytest.approx(4.44822) and found.x[0] == pytest.approx(0.0508) and found.t[1] == 1e-3


def test_a_unit_that_nobody_knows_is_not_taken_for_the_plants(tmp_path: Path) -> None:
    text = "t,F [grunt],x\n0,1,2\n1,1,2\n"
    with pytest.raises(InputError, match=r"column F \[grunt\]: nobody here knows the unit 'grunt': say it, F=F .*:N"):
        loaded(tmp_path, "a.csv", text, "F=F [grunt],x=x,t=t")
    assert loaded(tmp_path, "a.csv", text, "F=F [grunt]:kN,x=x,t=t").F[0] == 1e3
    assert loaded(tmp_path, "a.csv", "t,F,x[2]\n0,1,2\n1,1,2\n", "F=F,x=x[2]").x[0] == 2.0


def test_degrees_celsius_are_not_kelvins(tmp_path: Path) -> None:
    text = "t,q,T [°C]\n0,1,20\n1,1,21\n"
    with pytest.raises(InputError, match=r"°C and K count from elsewhere, 273\.15 apart"):
        loaded(tmp_path, "a.csv", text, layout=HEATER)
    with pytest.raises(InputError, match=r"mK and degC count from elsewhere"):
        loaded(tmp_path, "a.csv", text.replace("°C", "mK"), layout=SignalLayout({"q": "W"}, {"T": "degC"}))
    for same in (SignalLayout({"q": "W"}, {"T": "degC"}), HEATER):
        asked = "q=q,T=T:K" if same is HEATER else None
        assert loaded(tmp_path, "a.csv", text, asked, same).T.tolist() == [20.0, 21.0]


@pytest.mark.parametrize(("encoding", "sign"), [("latin-1", "b0"), ("utf-16", "ff")])
def test_another_encoding_is_said_with_its_line(tmp_path: Path, encoding: str, sign: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,q,T [°C]\n0,1,2\n", encoding=encoding)
    with pytest.raises(InputError, match=rf"line 1: is no UTF-8 \(byte {sign}\): save the file as UTF-8"):
        load(path, layout=HEATER)


def test_an_empty_cell_at_the_end_of_a_row_between_tabs_is_a_missing_one(tmp_path: Path) -> None:
    found = loaded(tmp_path, "a.txt", "t\tF\tx\n0\t1\t2\n0.5\t3\t\n1\t\t4\n")
    assert repr(found.column("F").tolist()) == "[1.0, 3.0, nan]"
    assert repr(found.column("x").tolist()) == "[2.0, nan, 4.0]"
    assert loaded(tmp_path, "b.txt", "t\tF\tx\t\n0\t1\t2\t\n1\t3\t4\t\n").column("x").tolist() == [2.0, 4.0]
    found = loaded(tmp_path, "c.txt", "t\tF\tx\n0\t1\t2\n0.5\t\t\n1\t3\t# late\n")
    assert (
        repr(found.column("F").tolist()) == "[1.0, nan, 3.0]" and repr(found.column("x").tolist()) == "[2.0, nan, nan]"
    )
