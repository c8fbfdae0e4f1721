"""The page of imports between the rooms of the package, drawn: layers from the contract, arrows from the code.

An arrow that runs back up is red; there is none as long as `make lint` is content. Circles are looked for among all
modules, those inside a room included.
"""

from __future__ import annotations

import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

import grimp

from docpages.markdown import code, sections, table

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "hoopd"
WIDTH, ROW, BOX_WIDTH, BOX_HEIGHT, MARGIN = 760, 74, 108, 34, 30
INTRODUCTION = """# Imports, drawn

Every import between two rooms, from the code. A room imports what stands below it; the thicker an arrow, the more
modules do. What the rooms are: [architecture](../../architecture.md)."""

Pairs = Mapping[tuple[str, str], int]


def page() -> str:
    """The drawing, what was counted, and circles."""
    # What only a type checker reads is no import of the program.
    layers, graph = contract(), grimp.build_graph(PACKAGE, exclude_type_checking_imports=True, cache_dir=None)
    imports = {one: sorted(graph.find_modules_directly_imported_by(one)) for one in sorted(graph.modules)}
    pairs, level = between_rooms(imports), {room: row for row, rooms in enumerate(layers) for room in rooms}
    back = sorted(f"{a} -> {b}" for a, b in pairs if level[a] >= level[b])
    found = circles(imports)
    rows = [[code(a), ", ".join(f"`{b}` ({n})" for (one, b), n in sorted(pairs.items()) if one == a)] for a in level]
    said = [
        f"{len(imports)} modules; arrows that run back up or sideways: {', '.join(back) or 'none'};",
        f"circles of imports: {'; '.join(map(', '.join, found)) or 'none'}.",
    ]
    counted = table(["room", "imports from (modules that do)"], rows)
    return sections(INTRODUCTION, f"```{{raw}} html\n{drawing(layers, pairs)}\n```", " ".join(said), counted)


def contract() -> list[list[str]]:
    """Rooms of each layer, the upper ones first."""
    with (ROOT / "pyproject.toml").open("rb") as stream:
        contracts = tomllib.load(stream)["tool"]["importlinter"]["contracts"]
    (rooms,) = (one for one in contracts if one.get("containers") == [PACKAGE])
    return [[room.strip() for room in layer.split("|")] for layer in rooms["layers"]]


def between_rooms(imports: Mapping[str, Iterable[str]]) -> Pairs:
    """(room, imported room) -> how many imports."""
    found = Counter((_room(a), _room(b)) for a, some in imports.items() for b in some)
    return {pair: n for pair, n in found.items() if pair[0] != pair[1] and all(pair)}


def _room(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def circles(imports: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Modules that import each other in a circle: the strongly connected sets of more than one (Kosaraju, 1978)."""
    order: list[str] = []
    _walk(imports, imports, order)
    importers: dict[str, list[str]] = defaultdict(list)
    for module, some in imports.items():
        for one in some:
            importers[one].append(module)
    seen: set[str] = set()
    sets = []
    for module in reversed(order):
        if module not in seen:
            sets.append(sorted(_walk(importers, [module], [], seen)))
    return [one for one in sets if len(one) > 1]


def _walk(
    graph: Mapping[str, Iterable[str]], starts: Iterable[str], order: list[str], seen: set[str] | None = None
) -> set[str]:
    """Depth first; `order` gets every module after all that it leads to."""
    seen, mine = set() if seen is None else seen, set()
    for start in starts:
        waiting = [(start, False)]
        while waiting:
            module, left = waiting.pop()
            if left:
                order.append(module)
            elif module not in seen:
                seen.add(module)
                mine.add(module)
                waiting += [(module, True), *((one, False) for one in graph.get(module, ()) if one not in seen)]
    return mine


def drawing(layers: list[list[str]], pairs: Pairs) -> str:
    """As SVG: a row a layer, a box a room."""
    place = {
        room: (WIDTH * (column + 1) / (len(rooms) + 1), MARGIN + row * ROW + BOX_HEIGHT / 2)
        for row, rooms in enumerate(layers)
        for column, room in enumerate(rooms)
    }
    lines = [_arrow(place[a], place[b], n, (a, b)) for (a, b), n in sorted(pairs.items())]
    boxes = [_box(room, x, y) for room, (x, y) in place.items()]
    head = (
        '<marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto" '
        'markerUnits="userSpaceOnUse"><path d="M0 0 L8 4 L0 8 z" fill="context-stroke"/></marker>'
    )
    size = f'viewBox="0 0 {WIDTH} {2 * MARGIN + ROW * len(layers) - ROW + BOX_HEIGHT}"'
    title = "Imports between the rooms of hoopd"
    return f'<svg {size} role="img" aria-label="{title}"><defs>{head}</defs>{"".join(lines + boxes)}</svg>'


def _arrow(start: tuple[float, float], end: tuple[float, float], n: int, rooms: tuple[str, str]) -> str:
    (xa, ya), (xb, yb) = start, end
    colour = "#7d8ba1" if yb > ya else "#d00000"
    ya, yb = ya + BOX_HEIGHT / 2, yb - BOX_HEIGHT / 2
    # The further down, the more to a side, so that an arrow passes beside the boxes between.
    aside = (xa + xb) / 2 + (0.0 if yb - ya < ROW else 0.35 * (yb - ya) * (1 if (xa + xb) / 2 >= WIDTH / 2 else -1))
    curve = f"M{xa:.0f} {ya:.0f} C{aside:.0f} {ya + 20:.0f} {aside:.0f} {yb - 20:.0f} {xb:.0f} {yb:.0f}"
    style = f'stroke="{colour}" stroke-width="{min(0.7 + 0.08 * n, 5):.2f}" marker-end="url(#head)"'
    return (
        f'<path d="{curve}" fill="none" opacity="0.75" {style}><title>{rooms[0]} imports {rooms[1]}: {n}</title></path>'
    )


def _box(room: str, x: float, y: float) -> str:
    corner = (
        f'x="{x - BOX_WIDTH / 2:.0f}" y="{y - BOX_HEIGHT / 2:.0f}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="5"'
    )
    text = f'<text x="{x:.0f}" y="{y + 5:.0f}" text-anchor="middle" font-size="15" fill="#102030">{room}</text>'
    return f'<rect {corner} fill="#eef3fa" stroke="#5b708f"/>{text}'
