"""The rig beside a service: a board on a pseudo-terminal that stands for the UART, and what its camera is told.

Rules of this file: runs inside the container with the installed daemon's own interpreter, and becomes the board.
`rig.py LINK FOLDER`: LINK becomes the port; FOLDER gets board.json, camera.json, the board's log and its state ring.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import msgspec

from hoopd.daemon import world
from hoopd.plants.model_file import load_model
from hoopd.shell import config as configuration
from hoopd.sim import boardprocess, parts


def main() -> int:
    """Write both descriptions, then be the board."""
    link, folder = Path(sys.argv[1]), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    config = configuration.load(None, sim=True, overrides=[f"sim.directory={folder}", "sim.psi_rad=0.1"])
    start = time.monotonic()
    plant = parts.plant_arguments(config, load_model(configuration.find(config.sim.model, None)))
    board = parts.board_process(config, world.read_layout(config, None), plant, 0, start, folder)
    camera = parts.camera_config(config, 0, ring=board.state_ring, start=start)
    (folder / "board.json").write_bytes(msgspec.json.encode(board))
    (folder / "camera.json").write_bytes(msgspec.json.encode(camera))
    return boardprocess.main(["--link", str(link), "--config", str(folder / "board.json")])


if __name__ == "__main__":
    sys.exit(main())
