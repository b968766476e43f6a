"""`rambler plan`: check plan files, load them into a state directory, and save plans from it."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from firmware_py.cli.state_owner import check_directory, check_owner, check_readable
from firmware_py.common.plan import Plan, PlanItem, PlanKind, Plans, from_text, to_text
from firmware_py.files.reading import read_regular
from firmware_py.files.writing import exact_modes
from firmware_py.plans.fence import Breach, find_breaches
from firmware_py.plans.items import ROWS, Command, has_position, markdown
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.qgc_file import write_plan
from firmware_py.plans.read_file import MAX_BYTES, read_plan_file
from firmware_py.plans.text_files import write_text
from firmware_py.system.directory_lock import StoreError
from firmware_py.system.slots import examine
from firmware_py.system.state_directory import PLAN_FILES, load_plans
from firmware_py.system.store import Store

KINDS: Mapping[str, PlanKind] = {kind.name.lower(): kind for kind in PlanKind}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    commands = parser.add_subparsers(dest="plan_command", metavar="WHAT", required=True)
    check = commands.add_parser("check", help="check a plan file and summarize it")
    load = commands.add_parser("load", help="copy the plans of a file into the state directory of a stopped autopilot")
    show = commands.add_parser("show", help="list the plans of a state directory")
    save = commands.add_parser("save", help="write the plans of a state directory to a file")
    commands.add_parser("items", help="print the table of supported plan items as Markdown")
    for command in (check, load):
        command.add_argument(
            "file", metavar="FILE", type=Path, help=".plan, .waypoints, or a fence or rally file of MAVProxy"
        )
        command.add_argument(
            "--no-home", action="store_true", help="item 0 of a .waypoints mission is an item, not home"
        )
    save.add_argument(
        "file", metavar="FILE", type=Path, help="*.plan: all plans; any other name: one plan as QGC WPL 110"
    )
    save.add_argument("--kind", choices=KINDS, default="mission", help="plan to save, unless FILE is a .plan")
    for command in (load, show, save):
        command.add_argument("--state", metavar="DIR", type=Path, required=True, help="state directory")
    for command in (check, show):
        command.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Run a subcommand; return 2 with one line on standard error if it fails."""
    commands = {"check": _check, "load": _load, "show": _show, "save": _save, "items": _print_items}
    try:
        commands[arguments.plan_command](arguments)
    except (PlanFileError, StoreError) as error:
        print(f"rambler plan {arguments.plan_command}: {error}", file=sys.stderr)
        return 2
    return 0


def _print_items(_arguments: argparse.Namespace) -> None:
    print(markdown(), end="")


def _read_plans(path: Path, *, home: bool) -> tuple[Plan, ...]:
    """Read a plan file; raise PlanFileError for one that is unreadable, too large or invalid."""
    try:
        content = read_regular(path, MAX_BYTES)
    except OSError as error:
        raise PlanFileError(f"{path}: {error.strerror}; give a readable file") from None
    return read_plan_file(content, str(path), home=home, note=_print_note)


def _print_note(text: str) -> None:
    print(text, file=sys.stderr)


def _check(arguments: argparse.Namespace) -> None:
    plans = _read_plans(arguments.file, home=not arguments.no_home)
    if arguments.json:
        _print_json(plans)
        return
    all_breaches = _warn_of_breaches(arguments, arguments.file, Plans(), plans)
    for plan in plans:
        count = sum(breach.kind is plan.kind for breach in all_breaches)
        verdict = f"{count} outside the fence" if count else "all valid"
        print(f"{arguments.file}: {plan.kind.name.lower()}: {_count_text(plan)}, {verdict}")


def _load(arguments: argparse.Namespace) -> None:
    plans = _read_plans(arguments.file, home=not arguments.no_home)
    if arguments.state.exists():  # otherwise it is created
        check_directory(arguments.state)
        check_owner(arguments.state)
    with exact_modes():
        try:
            store = Store(arguments.state)
        except StoreError as error:
            raise StoreError(f"{error}, or upload the plan with a ground station") from None
        previous = load_plans(store, lambda _: None)
        for plan in plans:
            store.save(PLAN_FILES[plan.kind], to_text(plan).encode())
        store.close()
    if store.start_problem:
        print(store.start_problem, file=sys.stderr)
    if store.failure:
        raise StoreError(f"state directory {arguments.state}: {store.failure}; free space and load it again")
    for plan in plans:
        removed_count = 0 if plan.items else len(previous.of(plan.kind).items)
        removed = f", {removed_count} removed" if removed_count else ""
        print(f"{arguments.state}: {plan.kind.name.lower()}: {_count_text(plan)}{removed}")
    _warn_of_breaches(arguments, arguments.state, previous, plans)


def _show(arguments: argparse.Namespace) -> None:
    stored = _stored_plans(arguments.state)
    plans = tuple(stored.of(kind) for kind in PlanKind)
    if arguments.json:
        _print_json(plans)
        return
    for plan in plans:
        print(f"{plan.kind.name.lower()}: {_count_text(plan)}" + (f", id {plan.identity:08x}" if plan.items else ""))
        first_number = int(plan.kind is PlanKind.MISSION)  # home is item 0
        for number, item in enumerate(plan.items, start=first_number):
            print(_format_item(number, item, first_number))


def _save(arguments: argparse.Namespace) -> None:
    plans = _stored_plans(arguments.state)
    is_plan_file = arguments.file.suffix.lower() == ".plan"
    text = write_plan(plans) if is_plan_file else write_text(plans.of(KINDS[arguments.kind]))
    try:
        arguments.file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise PlanFileError(f"{arguments.file}: {error.strerror}; give another file") from None
    saved_plans = [plans.of(kind) for kind in PlanKind] if is_plan_file else [plans.of(KINDS[arguments.kind])]
    for plan in saved_plans:
        print(f"{arguments.file}: {plan.kind.name.lower()}: {_count_text(plan)}")


def _warn_of_breaches(
    arguments: argparse.Namespace, source: Path, previous: Plans, plans: Iterable[Plan]
) -> list[Breach]:
    """Print and return the breaches of the fence after these plans replace the previous ones."""
    for plan in plans:
        previous = previous.replaced(plan)
    all_breaches = [breach for breach in find_breaches(previous) if breach is not None]
    for breach in all_breaches:
        first_number = int(breach.kind is PlanKind.MISSION and not arguments.no_home)
        _print_note(f"{source}: warning: {breach.message(first_number)}")
    return all_breaches


def _stored_plans(directory: Path) -> Plans:
    """Read the stored plans as the next start would, also while an autopilot runs."""
    check_directory(directory)
    check_readable(directory)
    plans = Plans()
    for name in PLAN_FILES.values():
        stored = examine(directory, name)
        if stored.damage:
            other_slot = "the other slot is used, perhaps an older plan"
            consequence = "no plan remains" if stored.content is None else other_slot
            print(f"{directory}: {stored.damage}: {consequence}", file=sys.stderr)
        if stored.content is None:
            continue
        try:
            plan, notes = from_text(stored.content.decode("utf-8", "replace"))
        except ValueError as error:
            raise StoreError(f"{directory / name}: {error}; load the plan again") from None
        plans = plans.replaced(plan)
        for note in notes:
            print(f"{directory / name}: {note}", file=sys.stderr)
    return plans


def _count_text(plan: Plan) -> str:
    return "1 item" if len(plan.items) == 1 else f"{len(plan.items)} items"


def _item_name(item: PlanItem) -> str:
    row = ROWS.get(item.command)
    return str(item.command) if row is None else row.name


def _format_item(number: int, item: PlanItem, first_number: int) -> str:
    offset = first_number if item.command == Command.JUMP else 0  # DO_JUMP: number of the target as printed
    params = " ".join(f"{value:g}" for value in (item.params[0] + offset, *item.params[1:]))
    position = f"  {item.x * 1e-7:.7f} {item.y * 1e-7:.7f}" if has_position(item.command) else ""
    return f"{number:>5}  {_item_name(item)}  {params}{position}"


def _print_json(plans: Iterable[Plan]) -> None:
    print(json.dumps({plan.kind.name.lower(): [item_fields(item) for item in plan.items] for plan in plans}))


def item_fields(item: PlanItem) -> Mapping[str, Any]:
    """Return the fields of an item for JSON, with null for NaN."""
    params = [None if math.isnan(value) else value for value in item.params]
    fields: dict[str, Any] = {"command": item.command, "name": _item_name(item), "frame": item.frame, "params": params}
    fields["autocontinue"] = item.autocontinue
    if has_position(item.command):
        fields |= {"latitude_deg": round(item.x * 1e-7, 7), "longitude_deg": round(item.y * 1e-7, 7)}
    return fields | {"x": item.x, "y": item.y, "z": None if math.isnan(item.z) else item.z}
