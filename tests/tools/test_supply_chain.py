"""What may be installed: pinned, with digests, by commands that demand them; and the lock files say what is missing."""

from __future__ import annotations

import hashlib
import importlib
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("requirements.lock", "requirements-dev.lock", "requirements-picamera2.lock")
DEMANDED = ("--require-hashes", "--only-binary=:all:")


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The tools in reach, and a pip that knows no index but the one that a test hands it."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    (tmp_path / "pip.conf").write_text("[global]\nno-index = true\n")
    for name in ("PIP_FIND_LINKS", "PIP_INDEX_URL", "PIP_EXTRA_INDEX_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", str(tmp_path / "pip.conf"))


def tool(name: str) -> ModuleType:
    return importlib.import_module(name)


def wheel(folder: Path, tags: str = "py3-none-any", *, text: str = "WHAT = 'original'\n") -> Path:
    """A wheel with one line of Python in it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"tiny_package-1.0-{tags}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("tiny_package.py", text)
        archive.writestr(
            "tiny_package-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: tiny-package\nVersion: 1.0\n"
        )
        archive.writestr(
            "tiny_package-1.0.dist-info/WHEEL", f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tags}\n"
        )
        archive.writestr("tiny_package-1.0.dist-info/RECORD", "")
    return path


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("name", NAMES)
def test_every_line_of_a_lock_file_is_pinned_and_has_digests(name: str) -> None:
    text = (ROOT / name).read_text().replace("\\\n", " ")
    lines = [line for line in text.splitlines() if not line.startswith(("#", "-r requirements.lock"))]
    assert lines
    for line in lines:
        assert re.fullmatch(r"[a-z0-9-]+==[\w.]+( +--hash=sha256:[0-9a-f]{64})+", line), line
    assert [pin.name for pin in tool("lockfile").read(ROOT / name)] == [line.split("==")[0] for line in lines]


def test_what_the_project_names_is_locked_and_so_is_its_build_backend() -> None:
    lockfile = tool("lockfile")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]
    for path, lines in {
        lockfile.RUNTIME: project["project"]["dependencies"],
        lockfile.DEVELOPMENT: extras["dev"],
        lockfile.PICAMERA2: extras["picamera2"],
    }.items():
        named = {lockfile.canonical(re.match(r"[\w-]+", line).group()) for line in lines}
        assert named <= set(lockfile.versions([path]))
    for line in project["build-system"]["requires"]:
        name, version = line.split("==")
        assert lockfile.versions([lockfile.RUNTIME])[name] == version


@pytest.mark.parametrize(
    "line",
    [
        "numpy>=2.1 --hash=sha256:" + 64 * "0",
        "numpy==2.4.6",
        "numpy==2.4.6 --hash=md5:" + 32 * "0",
        "numpy==2.4.6 --hash=sha256:" + 63 * "0",
        "https://example.invalid/numpy.whl",
    ],
)
def test_a_line_without_pin_or_digest_is_refused(line: str, tmp_path: Path) -> None:
    lockfile = tool("lockfile")
    (tmp_path / "bad.lock").write_text(f"# comment\n{line}\n")
    with pytest.raises(lockfile.LockError, match=r"^bad\.lock: "):
        lockfile.read(tmp_path / "bad.lock")


def demands_digests(command: list[str]) -> bool:
    """A call of pip that takes nothing without a digest; only the checkout itself has none and brings nothing along."""
    if "-r" in command:
        return all(word in command for word in DEMANDED)
    return {"--no-deps", "--no-build-isolation"} <= set(command) and command[-1] in (".", str(ROOT))


def test_make_installs_nothing_without_a_digest(tmp_path: Path) -> None:
    make = ["make", "--dry-run", "--always-make", f"VENV={tmp_path}/venv", f"{tmp_path}/venv/.development"]
    said = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, timeout=30, check=True).stdout
    commands = [line.split() for line in said.splitlines() if "pip install" in line]
    assert len(commands) == 3
    assert all(demands_digests(command) for command in commands), said


@pytest.mark.parametrize("picamera2", [False, True])
def test_the_installer_installs_nothing_without_a_digest(
    picamera2: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installer, calls = tool("install"), []
    monkeypatch.setattr(installer.Target, "run", lambda target, *command, needed: calls.append(list(command)))
    monkeypatch.setattr(installer, "relocate", lambda venv, root: None)
    installer.install_venv(installer.Target(tmp_path), "python3", picamera2=picamera2)
    commands = [command for command in calls if "pip" in command]
    assert len(commands) == 2 + picamera2
    assert all(demands_digests(command) for command in commands), commands


@pytest.mark.timeout(240)  # two calls of pip: 3 s each, a minute on a machine that is busy
def test_pip_refuses_a_wheel_that_was_changed(tmp_path: Path) -> None:
    lockfile, path = tool("lockfile"), wheel(tmp_path / "wheels")
    lock = tmp_path / "tiny.lock"
    lockfile.write(lock, {"tiny-package": "1.0"}, {"tiny-package": [sha256(path)]})
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        *DEMANDED,
        "--no-deps",
        "--no-compile",
        "--find-links",
        str(path.parent),
        "-r",
        str(lock),
    ]

    def install(name: str) -> subprocess.CompletedProcess[str]:
        command = [*pip, "--target", str(tmp_path / name)]
        return subprocess.run(command, capture_output=True, text=True, timeout=115, check=False)

    done = install("original")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "original/tiny_package.py").is_file()
    wheel(path.parent, text="WHAT = 'changed'\n")
    done = install("changed")
    assert done.returncode != 0
    assert "DO NOT MATCH THE HASHES" in done.stderr
    assert not (tmp_path / "changed/tiny_package.py").exists()


def test_digests_are_the_index_s_own_or_those_of_its_files(tmp_path: Path) -> None:
    index = tool("packageindex")
    path = wheel(tmp_path / "wheels")
    (file,) = index.Index("--find-links", str(path.parent)).files("tiny-package", "1.0")
    assert (file.name, file.sha256, file.wheel) == (path.name, sha256(path), True)
    page = tmp_path / "page.html"
    page.write_text(f'<!DOCTYPE html><a href="wheels/{path.name}#sha256={64 * "a"}">{path.name}</a>')
    (file,) = index.Index("--find-links", str(page)).files("tiny-package", "1.0")
    assert file.sha256 == 64 * "a"
    assert index.Index("--find-links", str(page)).files("tiny-package", "2.0") == []


def test_a_package_without_a_wheel_for_one_target_is_an_error(tmp_path: Path) -> None:
    lock, index, lockfile = tool("lock"), tool("packageindex"), tool("lockfile")
    for machine in ("x86_64", "aarch64"):
        for python in ("cp311", "cp312", "cp313"):
            wheel(tmp_path / "wheels", f"{python}-{python}-manylinux_2_28_{machine}")
    every = index.Index("--find-links", str(tmp_path / "wheels"))
    assert len(lock.digests({"tiny-package": "1.0"}, every)["tiny-package"]) == 6
    fewer = tmp_path / "fewer"  # another folder: pip looks into one but once
    shutil.copytree(tmp_path / "wheels", fewer)
    (fewer / "tiny_package-1.0-cp313-cp313-manylinux_2_28_aarch64.whl").unlink()
    wheel(fewer, "cp313-cp313-manylinux_2_39_aarch64")  # for a newer C library than bookworm's
    (fewer / "tiny_package-1.0.tar.gz").write_bytes(b"a source distribution does not count")
    with pytest.raises(lockfile.LockError, match=r"tiny-package==1\.0 for cp313 aarch64$"):
        lock.digests({"tiny-package": "1.0"}, index.Index("--find-links", str(fewer)))


def test_two_files_of_one_name_are_an_error(tmp_path: Path) -> None:
    index, lockfile = tool("packageindex"), tool("lockfile")
    one, other = wheel(tmp_path / "one"), wheel(tmp_path / "other", text="WHAT = 'rebuilt'\n")
    both = index.Index("--find-links", str(one.parent), "--find-links", str(other.parent))
    with pytest.raises(lockfile.LockError, match=f"{one.name}: the indexes offer two files"):
        both.files("tiny-package", "1.0")


def test_an_offered_wheel_that_is_not_the_locked_one_is_told(tmp_path: Path) -> None:
    check, index, lockfile = tool("check_wheels"), tool("packageindex"), tool("lockfile")
    path = wheel(tmp_path / "wheels", "cp311-cp311-manylinux_2_28_x86_64")
    offered = index.Index("--find-links", str(path.parent)).files("tiny-package", "1.0")
    states = {
        check.state(lockfile.Pin("tiny-package", "1.0", (digest,)), target, offered)
        for digest in (sha256(path), 64 * "0")
        for target in (index.Target((3, 11), "x86_64"), index.Target((3, 11), "aarch64"))
    }
    assert states == {"manylinux_2_28_x86_64", check.UNKNOWN, check.MISSING}


@pytest.mark.parametrize("page", ["SECURITY.md", "docs/reference/supply_chain.md"])
def test_pages_lead_to_what_is_there(page: str) -> None:
    path = ROOT / page
    text = path.read_text()
    for target in re.findall(r"\]\((?!https:)([^)#]+)", text):
        assert (path.parent / target).is_file(), target
    make = (ROOT / "Makefile").read_text()
    for name in re.findall(r"`make ([a-z-]+)", text):
        assert re.search(rf"^{name}:", make, re.MULTILINE), name
