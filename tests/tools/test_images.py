"""The container's file and the stage for pi-gen, read and tried without docker, pi-gen or a network."""

from __future__ import annotations

import fnmatch
import os
import re
import shlex
import subprocess
import tarfile
import tomllib
from pathlib import Path

import pytest
from tools.test_supply_chain import demands_digests

from hoopd.commands.options.dashboard import DashboardOptions
from hoopd.shell.config import load

ROOT = Path(__file__).resolve().parents[2]
STAGE = ROOT / "tools" / "image" / "stage-hoopd"
KNOWN = {
    "FROM", "RUN", "WORKDIR", "COPY", "ENV", "USER", "EXPOSE", "STOPSIGNAL", "ENTRYPOINT", "CMD",
}  # fmt: skip


def instructions() -> list[tuple[str, str]]:
    """Words and arguments of the container's file; comments are out and lines joined."""
    text = (ROOT / "tools" / "container" / "Containerfile").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    rows = [line.split(None, 1) for line in "\n".join(lines).replace("\\\n", " ").splitlines()]
    return [(word, rest) for word, rest in rows]


def arguments(word: str) -> list[str]:
    return [rest for name, rest in instructions() if name == word]


def copied() -> list[str]:
    """What of the checkout is copied into the image."""
    rows = [rest.split() for rest in arguments("COPY") if not rest.startswith("--from=")]
    return [name for row in rows for name in row[:-1]]


def files(name: str) -> list[str]:
    """Files of git below a name."""
    command = ["git", "ls-files", "--", name]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=20, check=True).stdout.split("\n")[
        :-1
    ]


def is_ignored(path: str) -> bool:
    """By the rules of .dockerignore: the last one that fits a path, or a folder above it, decides."""
    parts, ignored = path.split("/"), False
    for line in (ROOT / ".dockerignore").read_text().splitlines():
        if line and not line.startswith("#"):
            rule = line.removeprefix("!").removeprefix("**/")
            names = parts if "**/" in line else ["/".join(parts[: k + 1]) for k in range(len(parts))]
            ignored = not line.startswith("!") if any(fnmatch.fnmatch(name, rule) for name in names) else ignored
    return ignored


def test_every_line_of_the_containers_file_is_an_instruction() -> None:
    assert {word for word, _ in instructions()} == KNOWN
    assert instructions()[0][0] == "FROM"


def test_bases_are_plain_names_with_a_version() -> None:
    for rest in arguments("FROM"):
        assert re.fullmatch(r"[a-z]+:[a-z0-9]+[a-z0-9.-]*( AS [a-z]+)?", rest), rest


def test_what_is_copied_is_there_and_not_ignored() -> None:
    for name in copied():
        assert files(name), name
        assert not [path for path in files(name) if is_ignored(path)]
    assert all(is_ignored(name) for name in (".git/config", "tests/conftest.py", ".venv/bin/python", "runs/run.mcap"))
    assert is_ignored("hoopd/core/__pycache__/tick.pyc")


def test_what_is_copied_is_all_that_the_package_is_built_of() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    build = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    named = {project["project"]["readme"], *project["project"]["license-files"]}
    named |= {*build["packages"], *build["force-include"], "pyproject.toml"}
    assert not [name for name in named if not any(name == top or name.startswith(f"{top}/") for top in copied())]


def test_what_runs_is_sound_shell_and_takes_nothing_without_a_digest() -> None:
    for rest in arguments("RUN"):
        subprocess.run(["sh", "-n"], input=rest, text=True, timeout=10, check=True)
    calls = [rest.split() for rest in arguments("RUN") if " pip install " in rest]
    assert len(calls) == 2
    assert all(demands_digests(call) for call in calls)


def test_it_runs_as_nobody_special_and_what_it_runs_is_understood() -> None:
    assert arguments("USER") == ["hoopd"] and "--uid 1000 hoopd" in arguments("RUN")[-1]
    assert (arguments("ENTRYPOINT"), arguments("CMD")) == (['["hoopd"]'], ['["--sim"]'])
    names = [name for name, _ in instructions()]
    assert names.index("USER") > max(k for k, name in enumerate(names) if name in ("RUN", "COPY"))


def test_its_ports_are_those_of_the_page_and_of_telemetry() -> None:
    wanted = (DashboardOptions().listen, load(None, sim=True, overrides=[]).telemetry.endpoint)
    assert arguments("EXPOSE") == [" ".join(f"{address.rsplit(':', 1)[1]}/tcp" for address in wanted)]


# --- the image for a Raspberry Pi ------------------------------------------------------------------------------------


@pytest.fixture
def pi_gen(tmp_path: Path) -> Path:
    """As much of pi-gen as `prepare` looks at."""
    (tmp_path / "pi-gen" / "stage2").mkdir(parents=True)
    (tmp_path / "pi-gen" / "build.sh").touch()
    return tmp_path / "pi-gen"


def prepare(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [ROOT / "tools" / "image" / "prepare", folder]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_the_stage_is_put_beside_the_others(pi_gen: Path) -> None:
    done = prepare(pi_gen)
    assert done.returncode == 0, done.stderr
    assert (pi_gen / "stage2" / "SKIP_IMAGES").exists() and (pi_gen / "stage-hoopd" / "EXPORT_IMAGE").exists()
    assert 'STAGE_LIST="stage0 stage1 stage2 stage-hoopd"' in (pi_gen / "config").read_text()
    (pi_gen / "config").write_text("IMG_NAME=mine\n")
    again = prepare(pi_gen)
    assert again.returncode == 0 and "stage-hoopd" in again.stdout
    assert (pi_gen / "config").read_text() == "IMG_NAME=mine\n"


def test_a_folder_that_is_no_pi_gen_is_refused(tmp_path: Path) -> None:
    done = prepare(tmp_path)
    assert done.returncode == 2 and "give the folder of pi-gen" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_source_is_unpacked_and_its_installer_understands_the_call(pi_gen: Path, tmp_path: Path) -> None:
    """As pi-gen does it, but for what needs an arm64 processor: there `make check-pi` runs the installer."""
    assert prepare(pi_gen).returncode == 0
    sub_stage, root = pi_gen / "stage-hoopd" / "00-hoopd", tmp_path / "rootfs"
    assert os.access(sub_stage / "01-run.sh", os.X_OK)
    for _ in range(2):  # a stage is run again after a failure
        subprocess.run(
            ["./01-run.sh"], cwd=sub_stage, env={**os.environ, "ROOTFS_DIR": str(root)}, timeout=60, check=True
        )
    source = root / "usr" / "src" / "hoopd"
    with tarfile.open(sub_stage / "files" / "hoopd.tar") as archive:
        assert {"Makefile", "tools/install.py", "requirements.lock"} <= set(archive.getnames())
    line = next(line for line in (sub_stage / "02-run-chroot.sh").read_text().splitlines() if line.startswith("make "))
    words = shlex.split(line.replace("${LAMP_GPIO:-18}", "23").replace("/usr/src/hoopd", str(source)))
    dry = [*words, "DRY_RUN=1", f"DESTDIR={root}"]
    said = subprocess.run(dry, capture_output=True, text=True, timeout=60, check=True).stdout
    assert "would run /usr/bin/python3 -m venv" in said and "would write" in said


@pytest.mark.parametrize("script", sorted(path.name for path in STAGE.rglob("*.sh")))
def test_scripts_are_sound(script: str) -> None:
    (path,) = STAGE.rglob(script)
    subprocess.run(["bash", "-n", path], timeout=10, check=True)


def test_packages_are_those_of_the_guide() -> None:
    packages = set((STAGE / "00-hoopd" / "00-packages-nr").read_text().split())
    line = re.search(r"^sudo apt install (.*)$", (ROOT / "docs" / "guides" / "pi.md").read_text(), re.MULTILINE)
    assert line is not None and packages == set(line[1].split())
