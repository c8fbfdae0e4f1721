"""The composition root: how a daemon that is asked to end early ends, and what its start costs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from hoopd.commands import cli
from hoopd.daemon.build import build_tick, mismatch, read_texts
from hoopd.files.reading import InputError
from hoopd.shell.config import defaults_folder, load
from hoopd.shell.signals import unwinding

HEAVY = (
    "scipy",
    "matplotlib",
    "control",
    "h5py",
    "hoopd.design",
    "hoopd.ident",
    "hoopd.diagnose",
    "hoopd.sim",
    "hoopd.dashboard",
    "starlette",
    "uvicorn",
)
FOUND = (
    "{name: hoop.imbalance, parameters: {A: {value: 0.008, unit: N m}, phi: {value: 0.7, unit: rad}}}, "
    "{name: hoop.coulomb_friction, parameters: {Fc: {value: 0.004, unit: N m}}}, "
    "{name: camera.latency, parameters: {d: {value: 0.02, unit: s}}}"
)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_asked_to_end_before_the_loop_listens_everything_open_is_closed(number: int) -> None:
    closed: list[str] = []
    before = signal.getsignal(number)
    with pytest.raises(SystemExit) as end, ExitStack() as stack:
        stack.enter_context(unwinding())
        stack.callback(closed.append, "camera")
        os.kill(os.getpid(), number)
    assert (closed, end.value.code) == (["camera"], 0)
    assert signal.getsignal(number) is before


def test_started_with_nohup_a_hung_up_terminal_is_no_news() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with unwinding():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("effects", ["", FOUND])
def test_the_path_of_the_daemon_imports_nothing_heavy(effects: str) -> None:
    program = (
        "import sys, hoopd.commands.cli, hoopd.daemon.app, hoopd.shell.telemetry, hoopd.shell.videodevices\n"
        "from hoopd.daemon.build import build_tick, read_texts, unused_effects\n"
        "from hoopd.shell.config import load\n"
        "config = load(None, sim=False, overrides=[])\n"
        "texts = read_texts(config, None)\n"
        f"model = texts.model.replace('effects: []', 'effects: [{effects}]')\n"
        f"assert model.count('name: ') == {1 + effects.count('name: ')}\n"
        "build_tick(config, texts._replace(model=model)), unused_effects(config, texts._replace(model=model))\n"
        f"print([m for m in sys.modules if m.startswith({HEAVY!r})])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


def test_the_narrowest_torque_limit_holds() -> None:
    config = load(None, sim=False, overrides=[])
    texts = read_texts(config, None)
    weaker = texts._replace(model=texts.model.replace("torque_limit_nm: 0.7", "torque_limit_nm: 0.3"))
    assert build_tick(config, texts).limiter.torque_nm == 0.7
    assert build_tick(config, weaker).limiter.torque_nm == 0.3


def test_a_controller_designed_on_another_model_is_named() -> None:
    config = load(None, sim=False, overrides=["device.model=models/thesis.yaml"])
    texts = read_texts(config, None)
    assert "designed on models/hoop.yaml, the filter uses models/thesis.yaml" in mismatch(config, texts)
    assert mismatch(load(None, sim=False, overrides=[]), texts) == ""


def test_the_filter_uses_the_model_that_the_controller_was_designed_on(tmp_path: Path) -> None:
    """A file beside the controller first, then the places of every file; the configuration's word goes over it."""
    mine, shipped = tmp_path / "mine.yaml", defaults_folder()
    fitted = (shipped / "models" / "thesis.yaml").read_text().replace("name: thesis", "name: fitted")
    law = (shipped / "controllers" / "lqg.yaml").read_text()
    mine.write_text(law.replace("model: models/hoop.yaml", "model: fits/fitted.yaml"))
    config = load(None, sim=False, overrides=[f"control.file={mine}"])
    with pytest.raises(InputError, match=r"fits/fitted\.yaml: no such file"):
        read_texts(config, None)
    (tmp_path / "fits").mkdir()
    (tmp_path / "fits" / "fitted.yaml").write_text(fitted)
    texts = read_texts(config, None)
    assert texts.model == fitted and mismatch(config, texts) == ""
    assert build_tick(config, texts).succession.acting.filter.estimator is not None
    told = load(None, sim=False, overrides=[f"control.file={mine}", "device.model=models/hoop.yaml"])
    assert "name: hoop" in read_texts(told, None).model
    assert "designed on fits/fitted.yaml" in mismatch(told, read_texts(told, None))


@pytest.mark.parametrize("option", [["--sim"], ["--config", "x"], ["--json", "x"], ["--seed", "1"]])
def test_an_option_of_the_daemon_before_a_command_is_refused(option: list[str]) -> None:
    with pytest.raises(InputError, match=r"belongs after the command: hoopd check"):
        cli.app([*option, "check"], standalone_mode=False)
