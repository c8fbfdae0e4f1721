"""Pages of the reference that are made from the code: `python tools/docpages FOLDER` writes them.

They are made whenever the site is built (docs/conf.py) and are not committed: what changes with an option, a key, an
effect or a docstring would otherwise stand in every change twice, and could be old.

Rules of this package: a module makes one kind of page, as text; nothing but `written` here touches a file.
"""

from __future__ import annotations

from pathlib import Path

from docpages import api, command_line, effects, file_keys, imports, messages, plants

PAGES = {
    "command_line.md": command_line.page,
    "configuration.md": file_keys.configuration,
    "files.md": file_keys.files,
    "effects_library.md": effects.page,
    "imports.md": imports.page,
    **plants.pages(),
    "messages.md": messages.page,
    "python_lab.md": api.lab,
    "python_ident.md": api.ident,
    "python_plants.md": api.plants,
}


def written(folder: Path) -> list[Path]:
    """All pages, in `folder`; a page that is right already keeps its time of change."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in set(folder.glob("*.md")) - {folder / name for name in PAGES}:
        old.unlink()
    for name, page in PAGES.items():
        path, text = folder / name, page()
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    return [folder / name for name in PAGES]
