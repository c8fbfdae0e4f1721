"""Command line: the pages into a folder."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from docpages import written

if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tools/docpages FOLDER")
    for path in written(Path(sys.argv[1])):
        print(path)
