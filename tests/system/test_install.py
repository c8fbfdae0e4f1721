"""Installing into a folder and taking everything away again, without touching the machine."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tools/install.py"
CMDLINE = "console=serial0,115200 console=tty1 root=PARTUUID=2a7e8b1c-02 rootfstype=ext4 fsck.repair=yes rootwait\n"
CONFIG_TXT = b"# For more options see the manual\r\ndtparam=audio=on\n\n[cm4]\notg_mode=1\n\n[all]\n"


def load(path: Path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


installer = load(SCRIPT)


def run(root: Path, action: str, *more: str) -> str:
    result = subprocess.run(
        [sys.executable, SCRIPT, action, "--root", root, *([] if action == "uninstall" else ["--no-venv"]), *more],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def snapshot(root: Path) -> dict[str, bytes | str]:
    """Every file and link under a folder with its content."""
    return {
        str(path.relative_to(root)): str(path.readlink()) if path.is_symlink() else path.read_bytes()
        for path in sorted(root.rglob("*"))
        if (path.is_symlink() or path.is_file()) and path.name != ".pwd.lock"  # comes and goes with systemd-sysusers
    }


@pytest.fixture(params=["boot/firmware", "boot"])
def pi(request, tmp_path) -> Path:
    """The root of a fresh Raspberry Pi, as far as the installer looks at it."""
    boot = tmp_path / request.param
    boot.mkdir(parents=True)
    (boot / "config.txt").write_bytes(CONFIG_TXT)
    (boot / "cmdline.txt").write_text(CMDLINE)
    return tmp_path


def boot_of(root: Path) -> Path:
    return next(root / name for name in ("boot/firmware", "boot") if (root / name / "config.txt").is_file())


def test_everything_is_in_its_place(pi):
    said = run(pi, "install")
    for source, place in installer.SYSTEM_FILES.items():
        assert (pi / place).read_bytes() == (ROOT / source).read_bytes()
    assert (pi / "etc/hoopd/hoop.yaml").read_bytes() == (ROOT / "config/hoop.yaml").read_bytes()
    assert str((pi / "usr/local/bin/hoopd").readlink()) == "/opt/hoopd/bin/hoopd"
    lines = (boot_of(pi) / "config.txt").read_text().splitlines()
    for wanted in ("enable_uart=1", "dtoverlay=disable-bt", "camera_auto_detect=1", "gpio=18=op,dh"):
        assert lines.count(wanted) == 1
    assert (boot_of(pi) / "cmdline.txt").read_text() == CMDLINE.replace("console=serial0,115200 ", "")
    assert "reboot needed" in said
    assert "hoopd check" in said


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="no systemd here")
def test_user_folder_and_enabled_unit_in_the_root(pi):
    run(pi, "install")
    passwd = (pi / "etc/passwd").read_text()
    assert "hoopd:" in passwd
    assert "/usr/sbin/nologin" in passwd
    groups = {line.split(":")[0]: line.split(":")[3] for line in (pi / "etc/group").read_text().splitlines()}
    assert groups["dialout"] == groups["video"] == "hoopd"
    assert (pi / "var/lib/hoopd").is_dir()
    assert (pi / "etc/systemd/system/multi-user.target.wants/hoopd.service").is_symlink()


def test_twice_is_once(pi):
    run(pi, "install")
    before = snapshot(pi)
    said = run(pi, "install")
    assert snapshot(pi) == before
    assert "write" not in said
    assert "reboot" not in said


def test_uninstall_puts_back_what_was_there(pi):
    before = snapshot(pi / "boot")
    run(pi, "install")
    (pi / "var/lib/hoopd").mkdir(parents=True, exist_ok=True)
    (pi / "var/lib/hoopd/run.mcap").write_bytes(b"data")
    (pi / "opt/hoopd/bin").mkdir(parents=True)
    run(pi, "uninstall")
    assert snapshot(pi / "boot") == before
    assert not (pi / "opt/hoopd").exists()
    assert not any((pi / place).exists() for place in installer.SYSTEM_FILES.values())
    assert not (pi / "etc/systemd/system/multi-user.target.wants/hoopd.service").is_symlink()
    assert (pi / "var/lib/hoopd/run.mcap").exists()
    assert (pi / "etc/hoopd/hoop.yaml").exists()
    run(pi, "uninstall", "--purge")
    assert not (pi / "var/lib/hoopd").exists()
    assert not (pi / "etc/hoopd").exists()


def test_the_laboratory_s_configuration_is_never_overwritten(pi):
    own = "serial: {port: /dev/ttyUSB0}\n"
    (pi / "etc/hoopd").mkdir(parents=True)
    (pi / "etc/hoopd/hoop.yaml").write_text(own)
    assert "keep" in run(pi, "install")
    assert (pi / "etc/hoopd/hoop.yaml").read_text() == own


def test_dry_run_changes_nothing(pi):
    before = snapshot(pi)
    said = run(pi, "install", "--dry-run")
    assert snapshot(pi) == before
    assert all(line.startswith(("would ", "keep", "next", "reboot")) for line in said.splitlines())


def test_another_lamp_replaces_the_first(pi):
    run(pi, "install")
    run(pi, "install", "--lamp-gpio", "23")
    text = (boot_of(pi) / "config.txt").read_text()
    assert "gpio=23=op,dh" in text
    assert "gpio=18" not in text
    run(pi, "install", "--lamp-gpio", "none")
    assert "gpio=" not in (boot_of(pi) / "config.txt").read_text()


def test_cmdline_edited_meanwhile_keeps_the_edit(pi):
    run(pi, "install")
    path = boot_of(pi) / "cmdline.txt"
    path.write_text(path.read_text().replace("rootwait", "rootwait quiet"))
    run(pi, "uninstall")
    assert path.read_text() == CMDLINE.replace("rootwait", "rootwait quiet")


def test_not_a_raspberry_pi(tmp_path):
    assert "not a Raspberry Pi" in run(tmp_path, "install")
    assert (tmp_path / "etc/systemd/system/hoopd.service").is_file()
    run(tmp_path, "uninstall")


@pytest.mark.parametrize("text", ["", "a=1\n", "a=1", "a=1\r\n\r\n", "[pi4]\nx=1\n\n\n"])
def test_block_comes_and_goes_without_a_trace(text):
    block = installer.boot_block("18")
    once = installer.with_block(text, block)
    assert once.count(installer.BEGIN) == 1
    assert installer.with_block(once, block) == once
    assert installer.without_block(once) == text
    assert installer.without_block(text) == text


@pytest.mark.parametrize(
    ("line", "freed"),
    [
        (CMDLINE, CMDLINE.replace("console=serial0,115200 ", "")),
        ("console=tty1 console=ttyAMA0,115200", "console=tty1"),
        ("console=tty1 quiet\n", "console=tty1 quiet\n"),
    ],
)
def test_console_leaves_the_uart(line, freed):
    assert installer.without_serial_console(line) == freed
    assert installer.with_serial_console(freed, line) == line


def test_environment_is_built_from_the_lock_and_moved_to_its_place(tmp_path, monkeypatch):
    """With an interpreter that only notes what it is asked for."""
    target = installer.Target(tmp_path)
    calls = []

    def run_instead(*command: str, needed: bool = False) -> None:
        calls.append(command)
        if "venv" in command:
            (tmp_path / "opt/hoopd/bin").mkdir(parents=True)
            (tmp_path / "opt/hoopd/pyvenv.cfg").write_text(f"command = python3 -m venv {tmp_path}/opt/hoopd\n")
            (tmp_path / "opt/hoopd/bin/hoopd").write_text(f"#!{tmp_path}/opt/hoopd/bin/python\n")

    monkeypatch.setattr(target, "run", run_instead)
    installer.install_venv(target, "python3.11", picamera2=True)
    assert calls[0] == ("python3.11", "-m", "venv", "--clear", "--system-site-packages", str(tmp_path / "opt/hoopd"))
    assert str(ROOT / "requirements.lock") in calls[1]
    assert calls[-1][-3:] == ("--no-deps", "--no-build-isolation", str(ROOT))
    assert (tmp_path / "opt/hoopd/bin/hoopd").read_text() == "#!/opt/hoopd/bin/python\n"


@pytest.mark.parametrize("runs", [True, False])
def test_udev_is_told_only_where_it_runs(runs, tmp_path, monkeypatch):
    """A container has no udev: that is no failure of an installation."""
    calls = []
    monkeypatch.setattr(installer, "UDEV_RUNS", tmp_path if runs else tmp_path / "none")
    monkeypatch.setattr(installer.Target, "run_if_there", lambda target, *words: calls.append(words[:2]))
    installer.reload_udev(installer.Target(Path("/")), trigger=True)
    assert calls == ([("udevadm", "control"), ("udevadm", "trigger")] if runs else [])


def test_live_system_needs_root(monkeypatch, capsys):
    monkeypatch.setattr(installer.os, "geteuid", lambda: 1000)
    assert installer.main(["install"]) == 1
    assert "sudo" in capsys.readouterr().err
