#!/usr/bin/env python3
"""Counts how a checkout is built: rooms, files, long files and functions, import arrows and where they point.

A room is a folder directly in a program (firmware_py, hil), with all that is below it; a file beside the folders is
a room of its own. An arrow leads from a room to one that it imports, however many imports there are. A floor is a
room's place in the longest chain of arrows. Run it on any checkout: house.py [FOLDER] [--check].
"""

from __future__ import annotations

import argparse
import ast
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

PROGRAMS = ("firmware_py", "hil")
TESTS = "tests"
MOST_LINES = 300
MOST_FUNCTION_LINES = 60
MOST_FILES_AT_TOP = {"firmware_py": 8}
UNREAD = ("__pycache__", ".gitignore")

LAW = Path(__file__).parents[1] / "pyproject.toml"

Arrows = Mapping[str, frozenset[str]]


@dataclass(frozen=True, slots=True)
class Flow:
    """The order of the rooms of one program, highest first, and what some must not know although it is lower."""

    rows: tuple[frozenset[str], ...]
    forbidden: Mapping[str, frozenset[str]]


@dataclass(frozen=True, slots=True)
class Program:
    """What one program of the checkout comes to; offenders as `name (lines)` or `room -> room`."""

    rooms: tuple[str, ...]
    files_at_top: int
    python_files: int
    lines: int
    long_files: tuple[str, ...]
    long_functions: tuple[str, ...]
    arrows: Arrows
    floors: int
    circles: tuple[str, ...]
    against: tuple[str, ...]
    unplaced: tuple[str, ...]


def python_files(folder: Path) -> list[Path]:
    """Return the Python files below a folder, in order."""
    return sorted(path for path in folder.rglob("*.py") if "__pycache__" not in path.parts)


def long_functions(path: Path, name: str) -> list[str]:
    """Return the functions of a file that have too many lines, from `def` to the last line."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            if lines > MOST_FUNCTION_LINES:
                found.append(f"{name}:{node.name} ({lines})")
    return found


def room_of(path: Path, program: Path) -> str:
    """Return the room that a file of the program stands in."""
    return path.relative_to(program).parts[0].removesuffix(".py")


def imported_rooms(path: Path, program: Path, rooms: frozenset[str]) -> Iterator[str]:
    """Yield the rooms of the program that a file imports, inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            # From the program itself, or from here: the rooms are the names.
            module = ".".join(filter(None, (*_package(path, program, node.level), node.module)))
            names = [f"{module}.{alias.name}" for alias in node.names] if module == program.name else [module]
        for name in names:
            first, _, rest = name.partition(".")
            room = rest.partition(".")[0]
            if first == program.name and room in rooms:
                yield room


def _package(path: Path, program: Path, level: int) -> tuple[str, ...]:
    """Return the package that an import of so many dots starts from."""
    return path.relative_to(program.parent).parts[:-level] if level else ()


def arrows_of(program: Path) -> Arrows:
    """Return which rooms each room imports."""
    files = [path for path in python_files(program) if path != program / "__init__.py"]
    rooms = frozenset(room_of(path, program) for path in files)
    found: dict[str, set[str]] = {room: set() for room in sorted(rooms)}
    for path in files:
        room = room_of(path, program)
        found[room].update(set(imported_rooms(path, program, rooms)) - {room})
    return {room: frozenset(targets) for room, targets in found.items()}


def circles_of(arrows: Arrows) -> list[frozenset[str]]:
    """Return the sets of rooms that reach each other."""
    reach = {room: _reached(room, arrows) for room in arrows}
    circles = {
        frozenset(other for other in reach[room] if room in reach[other]) for room in arrows if room in reach[room]
    }
    return sorted(circles, key=sorted)


def _reached(room: str, arrows: Arrows) -> frozenset[str]:
    found: set[str] = set()
    ahead = set(arrows[room])
    while ahead:
        found |= ahead
        ahead = {target for one in ahead for target in arrows[one]} - found
    return frozenset(found)


def floors_of(arrows: Arrows, circles: list[frozenset[str]]) -> int:
    """Return the length of the longest chain of rooms; a circle is one floor."""
    home = {room: circle for circle in circles for room in circle}
    below = {room: {one for one in _reached(room, arrows) if one not in home.get(room, ())} for room in arrows}
    floor: dict[str, int] = {}
    # Who reaches the fewest rooms stands lowest: all below are placed before.
    for room in sorted(arrows, key=lambda room: len(below[room])):
        floor[room] = 1 + max((floor[one] for one in below[room]), default=0)
    return max(floor.values(), default=0)


def flow_of(program: str) -> Flow:
    """Read the flow of a program from the contracts of import-linter, the one place that says it."""
    rows: tuple[frozenset[str], ...] = ()
    forbidden: dict[str, frozenset[str]] = {}
    for contract in tomllib.loads(LAW.read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers" and contract["containers"] == [program]:
            rows = tuple(frozenset(room.strip(" ()") for room in row.split("|")) for row in contract["layers"])
        if contract["type"] == "forbidden":
            targets = frozenset(_rooms_named(contract["forbidden_modules"], program))
            for room in _rooms_named(contract["source_modules"], program):
                forbidden[room] = forbidden.get(room, frozenset()) | targets
    return Flow(rows, forbidden)


def _rooms_named(modules: list[str], program: str) -> list[str]:
    return [name.removeprefix(f"{program}.") for name in modules if name.startswith(f"{program}.")]


def against_the_flow(arrows: Arrows, flow: Flow) -> tuple[list[str], list[str]]:
    """Return the arrows that the flow does not allow, and the rooms that it does not place."""
    place = {room: number for number, rooms in enumerate(flow.rows) for room in rooms}
    against = [
        f"{room} -> {target}"
        for room, targets in arrows.items()
        for target in sorted(targets)
        if room in place and target in place
        if place[target] <= place[room] or target in flow.forbidden.get(room, ())
    ]
    return against, [room for room in arrows if room not in place]


def count(program: Path, flow: Flow | None = None) -> Program:
    """Count one program of a checkout."""
    files = python_files(program)
    names = {path: str(path.relative_to(program.parent)) for path in files}
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in files}
    arrows = arrows_of(program)
    circles = circles_of(arrows)
    against, unplaced = against_the_flow(arrows, flow) if flow is not None else ([], [])
    return Program(
        rooms=tuple(arrows),
        files_at_top=sum(path.is_file() and path.name not in UNREAD for path in program.iterdir()),
        python_files=len(files),
        lines=sum(lines.values()),
        long_files=tuple(f"{names[path]} ({lines[path]})" for path in files if lines[path] > MOST_LINES),
        long_functions=tuple(text for path in files for text in long_functions(path, names[path])),
        arrows=arrows,
        floors=floors_of(arrows, circles),
        circles=tuple(" - ".join(sorted(circle)) for circle in circles),
        against=tuple(against),
        unplaced=tuple(unplaced),
    )


def table(counted: Mapping[str, Program], tests: Program) -> str:
    """Return the counts as a markdown table; tests have no rooms of their own."""
    columns = list(counted.values())
    rows: list[tuple[str, list[object], object]] = [
        ("rooms", [len(one.rooms) for one in columns], "-"),
        ("files at the top, beside folders", [one.files_at_top for one in columns], "-"),
        ("Python files", [one.python_files for one in columns], tests.python_files),
        ("lines", [one.lines for one in columns], tests.lines),
        (f"files over {MOST_LINES} lines", [len(one.long_files) for one in columns], len(tests.long_files)),
        (
            f"functions over {MOST_FUNCTION_LINES} lines",
            [len(one.long_functions) for one in columns],
            len(tests.long_functions),
        ),
        ("arrows between rooms", [sum(map(len, one.arrows.values())) for one in columns], "-"),
        ("floors", [one.floors for one in columns], "-"),
        ("circles", [len(one.circles) for one in columns], "-"),
        ("arrows against the flow", [len(one.against) for one in columns], "-"),
        ("rooms that the flow does not place", [len(one.unplaced) for one in columns], "-"),
    ]
    lines = [f"| | {' | '.join(counted)} | {TESTS} |", f"| --- |{' ---: |' * (len(columns) + 1)}"]
    lines += [f"| {name} | {' | '.join(map(str, cells))} | {last} |" for name, cells, last in rows]
    return "\n".join(lines)


def findings(counted: Mapping[str, Program]) -> list[str]:
    """Return what --check refuses, one line each."""
    found = []
    for name, one in counted.items():
        most = MOST_FILES_AT_TOP.get(name, one.files_at_top)
        if one.files_at_top > most:
            found.append(f"{name}: {one.files_at_top} files beside folders, {most} at most; move some into a room")
        found += [f"over {MOST_LINES} lines, to be divided: {text}" for text in one.long_files]
        found += [f"over {MOST_FUNCTION_LINES} lines, to be divided: {text}" for text in one.long_functions]
        found += [f"{name}: a circle of imports: {text}" for text in one.circles]
        found += [f"{name}: against the flow: {text}" for text in one.against]
        found += [f"{name}: the flow has no place for the room {text}" for text in one.unplaced]
    return found


def main() -> int:
    """Print the table and what is too much; with --check exit 1 when there is any such thing."""
    parser = argparse.ArgumentParser(description="count how a checkout is built")
    parser.add_argument("folder", type=Path, nargs="?", default=Path(__file__).parents[1], help="this one unless told")
    parser.add_argument("--check", action="store_true", help="print only what is too much; exit 1 when there is any")
    arguments = parser.parse_args()
    missing = [name for name in PROGRAMS if not (arguments.folder / name).is_dir()]
    if missing:
        parser.error(f"{arguments.folder} has no folder {missing[0]}; name a checkout")
    counted = {name: count(arguments.folder / name, flow_of(name)) for name in PROGRAMS}
    tests = count(arguments.folder / TESTS)
    found = findings(counted)
    if not arguments.check:
        print(table(counted, tests))
        print()
        print("\n".join(found + [f"tests: {text}" for text in (*tests.long_files, *tests.long_functions)]))
    elif found:
        print("\n".join(found))
    return int(arguments.check and bool(found))


if __name__ == "__main__":
    sys.exit(main())
