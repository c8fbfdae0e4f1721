"""A filter made ready in a process of its own: CasADi holds the interpreter for longer than a tick may wait.

The child gets the configuration and the text of a controller, makes the filter as a replay does, and sends it back
with its compiled functions: the same instructions, so the same bits.

Rules of this file: the child is of this program, sees nothing but what it is sent, and is waited for with a bound.
"""

from __future__ import annotations

import pickle
import subprocess
import sys

from hoopd.linear_algebra import settle

settle()

from hoopd.core.installed import Filter  # noqa: E402
from hoopd.daemon.build import filter_of  # noqa: E402
from hoopd.files.loaded_controller import parse_loaded  # noqa: E402
from hoopd.files.reading import InputError  # noqa: E402
from hoopd.shell.child import end_with_parent  # noqa: E402
from hoopd.shell.config import Config  # noqa: E402
from hoopd.shell.cores import off_isolated_cores  # noqa: E402
from hoopd.shell.descriptors import opened  # noqa: E402

# An interpreter with numpy and CasADi, and the filter: some seconds on a Raspberry Pi, more on one that is busy.
PATIENCE_S = 20.0
DESCRIPTORS = 8  # two pipes and one for errors of the start


def prepared_filter(config: Config, text: str, limit_nm: float) -> Filter:
    """The filter of a loaded controller; InputError when it was not ready in time or cannot be made."""
    command = [*end_with_parent(), *off_isolated_cores(), sys.executable, "-m", __name__]
    asked = pickle.dumps((config, text, limit_nm))

    def run() -> subprocess.CompletedProcess[bytes]:
        return subprocess.run(
            command, input=asked, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=PATIENCE_S, check=True
        )

    try:
        answer = pickle.loads(opened(run, DESCRIPTORS).stdout)
    except (OSError, subprocess.SubprocessError, pickle.UnpicklingError, EOFError) as error:
        raise InputError("model", "", f"could not be made ready: {type(error).__name__}") from None
    if isinstance(answer, Filter):
        return answer
    raise InputError("model", "", str(answer))


def main() -> None:
    """Make one filter: what is wrong with it goes back as a line."""
    config, text, limit_nm = pickle.load(sys.stdin.buffer)
    loaded = parse_loaded(text)
    answer: Filter | str
    try:
        answer = filter_of(config, loaded.model, loaded.controller, limit_nm)
    except ValueError as error:
        answer = str(error)
    sys.stdout.buffer.write(pickle.dumps(answer))


if __name__ == "__main__":
    main()
