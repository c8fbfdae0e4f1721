#!/usr/bin/env python3
"""Installs the daemon on a Raspberry Pi, and takes it away again.

Rules of this file: standard library only; says what it does before it does it; doing it twice changes nothing more;
never overwrites the laboratory's configuration; uninstalling puts back what was there. With --root everything
happens in a folder and the running system is left alone; with --dry-run nothing happens at all.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[1]
VENV = "opt/hoopd"
COMMAND = "usr/local/bin/hoopd"
CONFIG = "etc/hoopd/hoop.yaml"
RECORDINGS = "var/lib/hoopd"
# Shipped file -> where the system looks for it.
SYSTEM_FILES = {
    "systemd/hoopd.service": "etc/systemd/system/hoopd.service",
    "systemd/hoopd.sysusers": "etc/sysusers.d/hoopd.conf",
    "systemd/hoopd.tmpfiles": "etc/tmpfiles.d/hoopd.conf",
    "systemd/99-hoopd.rules": "etc/udev/rules.d/99-hoopd.rules",
}
# Bookworm and later have the first, older systems the second.
BOOT_FOLDERS = ("boot/firmware", "boot")
BACKUP_ENDING = ".hoopd-backup"
# Pin 12. The lamp is switched by a transistor there and lit by the firmware at boot, so that the light does not
# depend on any program and the exposure can stay locked.
LAMP_GPIO = "18"
UDEV_RUNS = Path("/run/udev/control")
GPIOS = [str(number) for number in range(2, 28)]
# Wheels whose digests are locked, and nothing that would have to be built.
LOCKED = ("--require-hashes", "--only-binary=:all:")
# picamera2 is built for the distribution's numpy; what is locked here must match the numpy of the venv.
RUNTIME_LOCK, PICAMERA2_LOCK = SOURCE / "requirements.lock", SOURCE / "requirements-picamera2.lock"

BEGIN, END = "# >>> hoopd: made by the installer, taken away by its uninstall >>>", "# <<< hoopd <<<"
JOINED = "# (the line before had no end)"
_BLOCK = re.compile(rf"(\n{re.escape(JOINED)}\n)?{re.escape(BEGIN)}\n.*?{re.escape(END)}\n", re.DOTALL)
_SERIAL_CONSOLE = re.compile(r"^console=(serial0|ttyAMA0|ttyS0)(,\S*)?$")


def read(path: Path) -> str:
    """Text of a file, to the byte: line ends and whatever is not UTF-8 survive."""
    return path.read_bytes().decode("utf-8", "surrogateescape")


def boot_block(lamp_gpio: str | None) -> str:
    """Lines for config.txt, between markers."""
    lamp = [f"# Lamp: output, driven high from boot on.\ngpio={lamp_gpio}=op,dh"] if lamp_gpio else []
    lines = [
        BEGIN,
        "[all]",
        "enable_uart=1",
        "# Bluetooth off: it would take the PL011 and leave GPIO 14 and 15 the mini UART, whose baud rate follows the",
        "# core clock and which has no time-out interrupt (miniuart-bt keeps Bluetooth, but pins the clock down).",
        "dtoverlay=disable-bt",
        "camera_auto_detect=1",
        *lamp,
        "[pi5]",
        "dtparam=uart0=on",
        "[all]",
        END,
    ]
    return "\n".join(lines) + "\n"


def with_block(text: str, block: str) -> str:
    """config.txt with exactly one block of ours, at its end."""
    text = without_block(text)
    glue = f"\n{JOINED}\n" if text and not text.endswith("\n") else ""
    return text + glue + block


def without_block(text: str) -> str:
    """config.txt as it was without us."""
    return _BLOCK.sub("", text)


def without_serial_console(line: str) -> str:
    """cmdline.txt without a login console on the board's UART; the rest keeps its place."""
    end = "\n" if line.endswith("\n") else ""
    return " ".join(word for word in line.split() if not _SERIAL_CONSOLE.match(word)) + end


def with_serial_console(line: str, original: str) -> str:
    """cmdline.txt as the backup has it, or with the console put first again where it was edited since."""
    if line == without_serial_console(original):
        return original
    missing = [word for word in original.split() if _SERIAL_CONSOLE.match(word) and word not in line.split()]
    return " ".join([*missing, line.strip()]) + ("\n" if line.endswith("\n") else "")


@dataclass
class Target:
    """The folder that is installed into, and everything that may be done to it."""

    root: Path
    dry_run: bool = False
    reboot_for: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    @property
    def live(self) -> bool:
        """The running system itself."""
        return self.root == Path("/")

    def path(self, name: str) -> Path:
        """Place of a file under the root."""
        return self.root / name

    def say(self, text: str) -> None:
        """One line about what is done."""
        print(f"{'would ' if self.dry_run else ''}{text}")

    def write(self, path: Path, text: str, mode: int = 0o644) -> bool:
        """Write a file whole or not at all; false when it has this text already."""
        if path.is_file() and read(path) == text:
            return False
        self.say(f"write {path}")
        if not self.dry_run:
            path.parent.mkdir(parents=True, exist_ok=True)
            # Beside the target and renamed: a power cut leaves the old or the new file, never half of one.
            draft = path.with_name(path.name + ".hoopd-new")
            with draft.open("wb") as stream:
                stream.write(text.encode("utf-8", "surrogateescape"))
                stream.flush()
                os.fsync(stream.fileno())
            draft.chmod(mode)
            draft.replace(path)
        return True

    def remove(self, path: Path) -> None:
        """Remove a file, a link or a folder with all in it; nothing when it is not there."""
        if not (path.exists() or path.is_symlink()):
            return
        self.say(f"remove {path}")
        if self.dry_run:
            return
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()

    def link(self, path: Path, to: str) -> None:
        """A symbolic link."""
        if path.is_symlink() and os.readlink(path) == to:  # noqa: PTH115 - compared as text
            return
        self.remove(path)
        self.say(f"link {path} -> {to}")
        if not self.dry_run:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.symlink_to(to)

    def run(self, *command: str, needed: bool = False) -> None:
        """Run a command; a failure stops when needed, else it is told at the end."""
        self.say("run " + " ".join(command))
        if self.dry_run:
            return
        try:
            subprocess.run(command, check=True, stdin=subprocess.DEVNULL)
        except (OSError, subprocess.CalledProcessError) as error:
            if needed:
                raise SystemExit(f"install: {' '.join(command[:4])} ...: {error}") from None
            self.failures.append(f"{' '.join(command)}: {error}")

    def run_if_there(self, program: str, *arguments: str) -> None:
        """Run a system tool, or tell that this system has none."""
        if shutil.which(program) is None:
            self.say(f"skip {program}: not on this system")
            return
        self.run(program, *arguments)

    def boot_folder(self) -> Path | None:
        """Where config.txt is; None when this is not a Raspberry Pi."""
        folders = (self.path(name) for name in BOOT_FOLDERS)
        return next((folder for folder in folders if (folder / "config.txt").is_file()), None)


def install(target: Target, options: argparse.Namespace) -> None:
    """Everything, in the order in which it becomes useful."""
    if options.venv:
        install_venv(target, options.python, picamera2=options.picamera2)
    target.link(target.path(COMMAND), f"/{VENV}/bin/hoopd")
    for source, place in SYSTEM_FILES.items():
        target.write(target.path(place), read(SOURCE / source))
    install_config(target)
    set_up_boot(target, None if options.lamp_gpio == "none" else options.lamp_gpio)
    activate(target)


def install_venv(target: Target, python: str, *, picamera2: bool) -> None:
    """The interpreter's own environment with the pinned packages and the daemon."""
    venv = target.path(VENV)
    if Path(python).resolve().is_relative_to("/home") or Path(python).resolve().is_relative_to("/root"):
        print(f"careful: the service cannot see {python} (ProtectHome); better: make install PYTHON=/usr/bin/python3")
    site = ["--system-site-packages"] if picamera2 else []
    target.run(python, "-m", "venv", "--clear", *site, str(venv), needed=True)
    pip = [str(venv / "bin/python"), "-m", "pip", "install", "--no-input", "--disable-pip-version-check", "--quiet"]
    # Locked versions win over the distribution's, also where those can be seen.
    anew = ["--ignore-installed"] if picamera2 else []
    target.run(*pip, *LOCKED, *anew, "-r", str(RUNTIME_LOCK), needed=True)
    if picamera2:
        target.run(*pip, *LOCKED, *anew, "--no-deps", "-r", str(PICAMERA2_LOCK), needed=True)
    # pip knows no digest for a folder; the build backend is in the lock too, so that nothing more is fetched.
    target.run(*pip, "--no-deps", "--no-build-isolation", str(SOURCE), needed=True)
    if not (target.live or target.dry_run):
        relocate(venv, target.root)


def relocate(venv: Path, root: Path) -> None:
    """Take the staging folder out of the scripts: they will run from /opt/hoopd."""
    for path in [*(venv / "bin").iterdir(), venv / "pyvenv.cfg"]:
        if path.is_symlink() or not path.is_file():
            continue
        data = path.read_bytes()
        path.write_bytes(data.replace(os.fsencode(root / VENV), os.fsencode(f"/{VENV}")))


def install_config(target: Target) -> None:
    """The shipped configuration, only where there is none."""
    place, text = target.path(CONFIG), read(SOURCE / "config/hoop.yaml")
    if not place.exists():
        target.write(place, text)
    elif read(place) != text:
        print(f"keep {place}: it differs from the shipped one, {SOURCE / 'config/hoop.yaml'}")


def set_up_boot(target: Target, lamp_gpio: str | None) -> None:
    """UART, camera and lamp in config.txt; no login console on the UART."""
    folder = target.boot_folder()
    if folder is None:
        target.say(f"skip UART, camera and lamp: no config.txt under {target.root} (not a Raspberry Pi)")
        return
    config = folder / "config.txt"
    if target.write(config, with_block(read(config), boot_block(lamp_gpio)), _mode(config)):
        target.reboot_for.append("UART, camera and lamp")
    line = folder / "cmdline.txt"
    if line.is_file():
        free_console(target, line)


def free_console(target: Target, path: Path) -> None:
    """Take the login console off the UART; the backup is of the file before our first change."""
    original = read(path)
    changed = without_serial_console(original)
    if changed == original or changed.split() == original.split():
        return
    backup = path.with_name(path.name + BACKUP_ENDING)
    target.write(backup, original, _mode(path))
    target.write(path, changed, _mode(path))
    target.reboot_for.append("the console leaves the UART")


def activate(target: Target) -> None:
    """User, folders, device rules, unit; the service starts at the next boot, or when it is told to."""
    offline = [] if target.live else [f"--root={target.root}"]
    target.run_if_there("systemd-sysusers", *offline, "hoopd.conf")
    target.run_if_there("systemd-tmpfiles", *offline, "--create", "hoopd.conf")
    target.run_if_there("systemctl", *offline, "enable", "hoopd.service")
    if target.live:
        reload_udev(target, trigger=True)
        target.run_if_there("systemctl", "daemon-reload")


def reload_udev(target: Target, *, trigger: bool) -> None:
    """Let udev read its rules anew (and apply them to what is there); a container has devices but no udev."""
    if not UDEV_RUNS.exists():
        target.say("skip udev: it does not run here")
        return
    target.run_if_there("udevadm", "control", "--reload")
    if trigger:
        target.run_if_there("udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=video4linux")


def uninstall(target: Target, options: argparse.Namespace) -> None:
    """Undo the installation; recordings, configuration and their user stay unless purged."""
    offline = [] if target.live else [f"--root={target.root}"]
    if target.path(SYSTEM_FILES["systemd/hoopd.service"]).exists():
        if target.live:
            target.run_if_there("systemctl", "stop", "hoopd.service")
        target.run_if_there("systemctl", *offline, "disable", "hoopd.service")
    restore_boot(target)
    for place in [*SYSTEM_FILES.values(), COMMAND, VENV]:
        target.remove(target.path(place))
    if target.live:
        target.run_if_there("systemctl", "daemon-reload")
        reload_udev(target, trigger=False)
    if options.purge:
        purge(target)
    else:
        print(f"keep {target.path(CONFIG).parent} and {target.path(RECORDINGS)} (--purge removes them)")


def restore_boot(target: Target) -> None:
    """config.txt without our block, cmdline.txt with its console."""
    folder = target.boot_folder()
    if folder is None:
        return
    config, line = folder / "config.txt", folder / "cmdline.txt"
    if target.write(config, without_block(read(config)), _mode(config)):
        target.reboot_for.append("UART, camera and lamp")
    backup = line.with_name(line.name + BACKUP_ENDING)
    if line.is_file() and backup.is_file():
        restored = with_serial_console(read(line), read(backup))
        target.write(line, restored, _mode(line))
        target.reboot_for.append("the console returns to the UART")
    target.remove(backup)


def purge(target: Target) -> None:
    """Recordings, configuration and user."""
    for place in (RECORDINGS, str(Path(CONFIG).parent)):
        target.remove(target.path(place))
    passwd = target.path("etc/passwd")
    if passwd.is_file() and re.search(r"^hoopd:", read(passwd), re.MULTILINE):
        prefix = [] if target.live else ["--prefix", str(target.root)]
        target.run_if_there("userdel", *prefix, "hoopd")


def _mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Command line."""
    parser = argparse.ArgumentParser(description="Install hoopd on this machine, or take it away.")
    parser.add_argument("action", choices=["install", "uninstall"])
    parser.add_argument("--root", type=Path, default=Path("/"), help="folder to install into (default: this system)")
    parser.add_argument("--dry-run", action="store_true", help="only say what would be done")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environment")
    parser.add_argument("--no-venv", dest="venv", action="store_false", help="leave the environment alone")
    parser.add_argument("--picamera2", action="store_true", help="let the environment see the system's picamera2")
    parser.add_argument("--lamp-gpio", choices=["none", *GPIOS], default=LAMP_GPIO, metavar="N", help="2..27 or none")
    parser.add_argument("--purge", action="store_true", help="uninstall recordings, configuration and user too")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code 0, or 1 when some step failed."""
    options = parse(arguments)
    target = Target(options.root.resolve(), options.dry_run)
    if target.live and not target.dry_run and os.geteuid() != 0:
        print("install: needs root (sudo make install), or --root FOLDER", file=sys.stderr)
        return 1
    (install if options.action == "install" else uninstall)(target, options)
    for failure in target.failures:
        print(f"failed: {failure}", file=sys.stderr)
    if target.reboot_for:
        print(f"reboot needed: {'; '.join(target.reboot_for)}")
    if options.action == "install" and not target.failures:
        print("next: hoopd check (as root), then systemctl start hoopd")
    return 1 if target.failures else 0


if __name__ == "__main__":
    sys.exit(main())
