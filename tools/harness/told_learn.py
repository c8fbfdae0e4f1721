"""`hoopd learn` whose diagnoses are told, as a process that can be killed at any moment.

    python tools/harness/told_learn.py OUT TORQUE_LOG_FOLDER

Recording, designing and comparing are the real commands; a diagnosis is a process of its own, too, which takes a while
and writes its files as the real one does. Dry friction is likely after the first run and sure after the second.

Rules of this file: it is a program; what must hold of it is judged by `learn_kills`.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import msgspec  # noqa: E402

from harness.told_diagnosis import said  # noqa: E402
from hoopd.commands import learn  # noqa: E402
from hoopd.commands.learn_steps import Steps  # noqa: E402
from hoopd.commands.options.learn import LearnOptions  # noqa: E402
from hoopd.diagnose.record_file import to_json_bytes  # noqa: E402
from hoopd.files.model import EffectEntry, Parameter, model_text  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.files.whole_files import replace_file  # noqa: E402
from hoopd.learn.campaign import RunFiles  # noqa: E402
from hoopd.plants.model_file import load_model  # noqa: E402

TAKES_S = 2.0
SURE = (0.6, 0.92)
FC = 0.006
HIDDEN = f"sim.effects=[{{name: hoop.coulomb_friction, parameters: {{Fc: {FC}}}}}]"


class ToldSteps(Steps):
    """Its diagnosis is this file as a program."""

    def diagnose(self, files: RunFiles, recordings: Sequence[Path | str], number: int) -> None:
        if files.diagnosis.exists():
            return
        self.say(f"run {number}: diagnosing")
        self.told(files.folder, number)

    def told(self, folder: Path, number: int) -> None:
        """A process that ends with this one."""
        import subprocess

        from hoopd.shell.child import end_with_parent

        subprocess.run([*end_with_parent("TERM"), sys.executable, __file__, "tell", folder, str(number)], check=True)


def tell(folder: Path, number: int) -> None:
    """Model and report first, what ends the step last, as `hoopd diagnose` does."""
    time.sleep(TAKES_S)
    files = RunFiles(folder)
    entry = EffectEntry(name="hoop.coulomb_friction", parameters={"Fc": Parameter(value=FC, unit="N m")})
    model = msgspec.structs.replace(load_model(defaults_folder() / "models" / "hoop.yaml"), effects=[entry])
    replace_file(files.model, model_text(model).encode())
    replace_file(files.report, b"<!DOCTYPE html>")
    replace_file(files.diagnosis, to_json_bytes(said(SURE[min(number, len(SURE)) - 1])))


def main() -> None:
    """A campaign, or one diagnosis of it."""
    if sys.argv[1] == "tell":
        tell(Path(sys.argv[2]), int(sys.argv[3]))
        return
    out, rig = Path(sys.argv[1]), Path(sys.argv[2])
    learn.Steps = ToldSteps  # type: ignore[misc]
    options = LearnOptions(sim=True, out=out, budget="60s", sets=(HIDDEN, f"sim.directory={rig}"))
    result = learn.run(options)
    print(os.getpid(), result["ended_because"])


if __name__ == "__main__":
    main()
