"""How the site is built from these pages: `make docs`, then open build/docs/index.html.

Rules of this file: nothing that a page needs is fetched, neither while it is built nor while it is read: the theme
brings its own style and takes the system's fonts, search is an index beside the pages, a drawing is text or a picture
of ours. A link or an anchor that leads nowhere is a warning, and `make docs` takes a warning for an error.
"""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent

project = "hoopd"
author = "the hoopd authors"
project_copyright = "the hoopd authors, Apache-2.0"
version = release = version_of("hoopd")
language = "en"
smartquotes = False  # two hyphens begin an option

extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
generated = "reference/generated"  # of the code, by tools/docpages
myst_heading_anchors = 4  # links of the form page.md#heading, as code hosts make them
myst_enable_extensions = ["colon_fence", "dollarmath"]
highlight_language = "none"  # a block without a language is a terminal's

html_theme = "furo"
html_title = f"hoopd {version}"
html_copy_source = False
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_theme_options = {"navigation_with_keys": True}


def setup(app: Any) -> None:
    """Make the pages that come from the code before any page is read."""
    sys.path.insert(0, str(HERE.parent / "tools"))
    from docpages import written

    app.connect("builder-inited", lambda app: written(Path(app.srcdir) / generated))
