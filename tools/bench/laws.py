"""The laws in the full rig: settling, hoop speed, limit cycle, limits; and the figures of the documentation.

Usage: python tools/bench/laws.py [--figures FOLDER] [--json FILE]
Every row is a run of the whole daemon in lock-step (bytes, board, camera two frames late, default noise), judged by
the plant's true state and the board's own log of its torque. Times count from the release, the disturbance
or the new reference; `off` is psi minus reference.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.rigrun import RigRun, run_rig  # noqa: E402

DEGREE = math.radians(1.0)
THESIS = ("device.model=models/thesis.yaml", "sim.model=models/thesis.yaml", "sim.delay_frames=1")
REST = "sim.psi_rad=0"
WRONG_ZERO = f"sim.angle_offset_rad={DEGREE}"
DISTURBED = (REST, "sim.disturbance_rad=0.4", "sim.disturbance_at_s=3.0")
PID, LEAD, ARX = (f"control.file=controllers/{name}.yaml" for name in ("pid", "lead", "arx"))
END_S = 5.0  # what "at the end" means


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    name: str
    sets: tuple[str, ...] = ()
    duration_s: float = 8.0
    pictures: bool = False


def open_gate(folder: Path, name: str) -> str:
    """A shipped controller whose filter believes every picture."""
    file = yaml.safe_load((ROOT / "config" / "controllers" / f"{name}.yaml").read_text(encoding="utf-8"))
    file["estimator"]["gate_nis"] = 1e12
    path = folder / f"{name}-open.yaml"
    path.write_text(yaml.safe_dump(file), encoding="utf-8")
    return f"control.file={path}"


def reference(value_rad: float) -> str:
    """Asked for three seconds into the run."""
    return f"sim.commands=[{{at_s: 3, name: reference, value: {value_rad}}}]"


def cases(folder: Path) -> list[Case]:
    """All rows."""
    return [
        Case("LQG, released at 0.4 rad, pictures", (), 8.0, True),
        Case("LQG, released at 0.4 rad, angles direct"),
        Case("LQG on ARX, released at 0.4 rad, pictures", (ARX,), 8.0, True),
        Case("LQG, one sample of 0.4 rad, as shipped (gate refuses it)", DISTURBED, 9.0, True),
        Case("LQG, one sample of 0.4 rad, gate open", (*DISTURBED, open_gate(folder, "lqg")), 9.0, True),
        Case("LQG on ARX, one sample of 0.4 rad, gate open", (*DISTURBED, open_gate(folder, "arx")), 9.0, True),
        Case("LQG, reference 0.1 rad", (REST, reference(0.1)), 14.0),
        Case("LQG, reference 0.3 rad", (REST, reference(0.3)), 14.0),
        Case("LQG, released at 1.2 rad, limit 0.05 N m", ("sim.psi_rad=1.2", "limits.torque_nm=0.05")),
        Case("LQG on ARX, released at 0.4 rad, slew 0.01 N m", (ARX, "limits.slew_nm_per_tick=0.01")),
        Case("thesis, 1 frame: PID, 1 deg of zero-angle error", (*THESIS, PID, REST, WRONG_ZERO), 25.0),
        Case("thesis, 1 frame: PID, released at 0.4 rad", (*THESIS, PID), 25.0),
        Case("thesis, 1 frame: LQG, 1 deg of zero-angle error", (*THESIS, REST, WRONG_ZERO), 15.0),
        Case("thesis, 2 frames and phase: PID", (*THESIS, "sim.delay_frames=2", PID, REST), 25.0),
        Case(
            "thesis, no delay: lead, released at 0.4 rad", (*THESIS, "sim.delay_frames=0", "sim.camera_phase=0", LEAD)
        ),
        Case("thesis, 1 frame: lead", (*THESIS, LEAD, REST), 15.0),
        Case("thesis, 2 frames and phase: lead", (*THESIS, "sim.delay_frames=2", LEAD, REST), 15.0),
    ]


def row(case: Case, run: RigRun) -> dict[str, Any]:
    """What a run was."""
    off = run.psi - run.reference
    start = 0.0
    if DISTURBED[1] in case.sets:
        start = float(run.t[np.nanargmax(run.psi_seen)])
    elif run.reference.any():
        start = float(run.t[np.argmax(run.reference != 0.0)])
    end = run.after(float(run.t[-1]) - END_S)
    return {
        "case": case.name,
        "off_below_0.05_rad_after_s": run.settled_s(off, 0.05, start),
        "hoop_below_1_rad_s_after_s": run.settled_s(run.dtheta, 1.0, start),
        "largest_psi_rad": float(np.abs(run.psi).max()),
        "largest_hoop_rad_s": float(np.abs(run.dtheta).max()),
        "largest_torque_nm": run.torque.max_abs(),
        "largest_torque_change_nm": float(np.abs(np.diff([0.0, *run.u])).max()),
        "end_hoop_rad_s": float(run.dtheta[end].mean()),
        "end_psi_rad": float(run.psi[end].mean()),
        "end_psi_seen_rad": float(np.nanmean(run.psi_seen[end])),
        "end_psi_amplitude_rad": float(np.ptp(run.psi[end]) / 2),
        "end_torque_amplitude_nm": float(np.ptp(run.u[end]) / 2),
        "end_mode": run.summary["final_mode"],
    }


COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("off_below_0.05_rad_after_s", "off<.05 s", "9.2f"),
    ("hoop_below_1_rad_s_after_s", "hoop<1 s", "8.2f"),
    ("largest_psi_rad", "max psi", "8.2f"),
    ("largest_hoop_rad_s", "max hoop", "8.2f"),
    ("largest_torque_nm", "max u", "6.3f"),
    ("largest_torque_change_nm", "max du", "6.3f"),
    ("end_hoop_rad_s", "end hoop", "8.2f"),
    ("end_psi_rad", "end psi", "8.4f"),
    ("end_psi_seen_rad", "as seen", "8.4f"),
    ("end_psi_amplitude_rad", "+-psi", "7.3f"),
    ("end_torque_amplitude_nm", "+-u", "6.3f"),
)


def table(rows: list[dict[str, Any]]) -> str:
    """Rows as text; rad, rad/s, N m, s."""
    width = max(len(r["case"]) for r in rows)

    def cell(value: float, spec: str) -> str:
        return f"{value:{spec}}" if math.isfinite(value) else f"{'never':>{spec.partition('.')[0]}}"

    head = " ".join(f"{title:>{spec.partition('.')[0]}}" for _, title, spec in COLUMNS)
    lines = [f"{'':{width}} {head}"]
    lines += [f"{r['case']:{width}} " + " ".join(cell(r[key], spec) for key, _, spec in COLUMNS) for r in rows]
    return "\n".join(lines)


# ------------------------------------------------------------------------------------------------ figures

INK, GRID = "#333333", "#dddddd"
BLUE, RED, GREEN = "#1f5fa8", "#c0392b", "#2e8b57"


def axes(count: int) -> tuple[Any, Any]:
    """Panels one above the other over the same time."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update({"font.size": 9, "axes.edgecolor": INK, "axes.labelcolor": INK, "text.color": INK})
    figure, panels = plt.subplots(count, 1, figsize=(7.2, 1.9 * count), sharex=True, layout="constrained")
    for panel in panels:
        panel.grid(color=GRID, linewidth=0.6)
        panel.spines[["top", "right"]].set_visible(False)
    panels[-1].set_xlabel("time in s")
    figure.align_ylabels(panels)
    return figure, panels


def save(figure: Any, path: Path) -> None:
    """As PNG without a date."""
    figure.savefig(path, dpi=110, metadata={"Software": None})
    print(path)


def draw_release(run: RigRun, path: Path) -> None:
    """psi, hoop speed and torque of a release."""
    figure, (top, middle, bottom) = axes(3)
    part = run.t <= 4.0
    t = run.t[part]
    top.axhspan(-0.05, 0.05, color=BLUE, alpha=0.1, linewidth=0)
    top.text(3.95, 0.06, "±0.05 rad", ha="right", va="bottom", color=BLUE)
    top.plot(t, run.psi_seen[part], ".", color="#999999", markersize=2.5, label="as the camera sees it, 40 ms late")
    top.plot(t, run.psi[part], color=BLUE, label="true")
    top.legend(frameon=False, loc="upper right")
    top.set_ylabel("ball angle psi in rad")
    middle.axhspan(-1.0, 1.0, color=GREEN, alpha=0.1, linewidth=0)
    middle.text(3.95, 1.1, "±1 rad/s", ha="right", va="bottom", color=GREEN)
    middle.plot(t, run.dtheta[part], color=GREEN)
    middle.set_ylabel("hoop speed in rad/s")
    bottom.step(t, run.u[part], where="post", color=RED)
    bottom.set_ylabel("torque in N m")
    bottom.set_xlim(0.0, 4.0)
    settled = run.settled_s(run.psi, 0.05)
    figure.suptitle(f"LQG, ball released at 0.4 rad: inside 0.05 rad after {settled:.2f} s", fontsize=10)
    save(figure, path)


def draw_thesis(wrong: RigRun, right: RigRun, lqg: RigRun, path: Path) -> None:
    """What a zero-angle error of one degree does to PID and to LQG on the thesis's device."""
    figure, (top, bottom) = axes(2)
    runs = (
        (wrong, RED, "PID, zero angle wrong by 1°"),
        (right, BLUE, "PID, zero angle right"),
        (lqg, GREEN, "LQG, zero angle wrong by 1°"),
    )
    for (run, colour, name), width in zip(runs, (2.4, 0.8, 0.8), strict=True):  # the two PIDs lie on each other
        seen = np.flatnonzero(np.isfinite(run.psi_seen))[::3]  # the noise of every picture is no news
        top.plot(run.t, run.dtheta, color=colour, linewidth=1.2, label=name)
        bottom.plot(run.t[seen], np.degrees(run.psi_seen[seen]), color=colour, linewidth=width)
    top.set_ylabel("hoop speed in rad/s")
    top.legend(frameon=False, loc="center right")
    bottom.set_ylabel("psi as the camera\nsees it, in degrees")
    for text, y in (("LQG: the ball is at the true bottom, so the camera reads 1°", 1.6), ("both PIDs", -0.75)):
        bottom.text(13.3, y, text, ha="right", va="bottom" if y > 0 else "top")
    bottom.set_ylim(-2.5, 4.0)
    bottom.set_xlim(0.0, 13.5)
    figure.suptitle("The thesis's device, one frame of delay, ball released at 0.1 rad", fontsize=10)
    save(figure, path)


def figures(folder: Path, scratch: Path, release: RigRun) -> None:
    """Both figures; the ball is released a little off the bottom, so that all three curves have a beginning."""
    draw_release(release, folder / "release.png")
    off = (*THESIS, "sim.psi_rad=0.1")
    wanted: tuple[tuple[str, ...], ...] = ((*off, PID, WRONG_ZERO), (*off, PID), (*off, WRONG_ZERO))
    runs = [run_rig(scratch / f"figure-{k}", *sets, duration_s=15.0) for k, sets in enumerate(wanted)]
    draw_thesis(runs[0], runs[1], runs[2], folder / "thesis_device.png")


def main() -> None:
    """Print the table; draw on request."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, help="folder for release.png and thesis_device.png")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hoopd-bench-") as name:
        scratch = Path(name)
        todo = cases(scratch)
        runs = [
            run_rig(scratch / str(k), *case.sets, duration_s=case.duration_s, pictures=case.pictures)
            for k, case in enumerate(todo)
        ]
        rows = [row(case, result) for case, result in zip(todo, runs, strict=True)]
        print(table(rows))
        if options.json is not None:
            options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
        if options.figures is not None:
            figures(options.figures, scratch, runs[0])


if __name__ == "__main__":
    main()
