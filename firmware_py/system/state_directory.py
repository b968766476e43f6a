"""The state that is stored over restarts: parameters, plans, resume record, signing key.

Unusable parts are reported and omitted.
"""

from __future__ import annotations

import math
import re
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Protocol

import msgspec

from firmware_py.common.parameter_row import ParameterError
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.parameters import ParameterSet, format_file, parse_file
from firmware_py.common.plan import Plan, PlanKind, Plans
from firmware_py.common.plan import from_text as plan_from_text
from firmware_py.common.plan import to_text as plan_to_text
from firmware_py.common.records import Stored
from firmware_py.plans.validation import problem_of
from firmware_py.system.endings import ENDINGS_FILE
from firmware_py.system.slots import SLOTS, examine, slot_path
from firmware_py.system.store import Store

PARAMETER_FILE: Final = "parameters.param"
PLAN_FILES: Final = {PlanKind.MISSION: "mission.plan", PlanKind.FENCE: "fence.plan", PlanKind.RALLY: "rally.plan"}
RESUME_FILE: Final = "resume.record"
SIGNING_FILE: Final = "signing.key"
SATELLITE_FILE: Final = "satellite.record"
RECORD_FILES: Final = (RESUME_FILE, ENDINGS_FILE, SATELLITE_FILE)
LOG_DIRECTORY: Final = "logs"
UPLOAD_DIRECTORY: Final = "uploads"
BOOT_COUNT: Final = "STAT_BOOTCNT"
MAX_UNUSABLE_PARAMETERS: Final = 200  # more than one version adds
# Consequences if a name has no valid version.
_CONSEQUENCES: Final = {
    PARAMETER_FILE: "the vehicle file's parameters are used",
    PLAN_FILES[PlanKind.MISSION]: "there is no mission",
    PLAN_FILES[PlanKind.FENCE]: "there is no fence",
    PLAN_FILES[PlanKind.RALLY]: "there are no rally points",
    RESUME_FILE: "not resumed",
    ENDINGS_FILE: "records of earlier runs are lost",
    SATELLITE_FILE: "message budget reset, earlier messages are ignored",
}
STATE_NAMES: Final = (*_CONSEQUENCES, SIGNING_FILE)
OTHER_SLOT: Final = "the other slot is used, perhaps an older version"
_LINE = re.compile(r"([A-Z][A-Z0-9_]{0,15}) (-?[0-9]+(?:\.[0-9]+)?(?:e[-+]?[0-9]+)?)")


class StateReader(Protocol):
    """Interface for reading a state directory: the store, or `StateFiles` without the lock."""

    def load(self, name: str) -> bytes | None:
        """Return the newest valid version, or None."""

    def examine(self, name: str) -> Stored:
        """Return the newest valid version and the problems of the slots."""


class StateFiles(msgspec.Struct, frozen=True):
    """A StateReader of a directory without its lock; safe while an autopilot is writing."""

    directory: Path

    def load(self, name: str) -> bytes | None:
        """Return the newest valid version, or None."""
        return self.examine(name).content

    def examine(self, name: str) -> Stored:
        """Return the newest valid version and the problems of the slots."""
        is_key = name == SIGNING_FILE and self.directory.is_dir()
        return read_key(self.directory) if is_key else examine(self.directory, name)


def report_damage(store: StateReader, report: Callable[[str], None]) -> None:
    """Report damaged, unreadable and missing slots and the consequences; call it before the first write.

    `firmware_py.assemble.stored_state` reports the slots of the signing key.
    """
    for name, consequence in _CONSEQUENCES.items():
        stored = store.examine(name)
        if stored.damage:
            effect = consequence if stored.content is None else OTHER_SLOT
            report(f"{stored.damage}: {effect}")


class StateDirectory:
    """StateWriter that reads the state of earlier runs from the store and saves the new state."""

    def __init__(self, store: Store, report: Callable[[str], None]) -> None:
        """Read the parameters; `report` is called for each unusable item."""
        self._store, self._report = store, report
        self._usable_values, unusable = load_parameters(store, report)
        self._saved_values = unusable | self._usable_values
        self._plans = Plans()  # the plans in the store
        self._changed_kinds: set[PlanKind] = set()  # kinds of plans that were replaced since the start
        store.on_mount((PARAMETER_FILE, *PLAN_FILES.values()), self._merge_late_state)

    def count_start(self) -> None:
        """Increment the boot count."""
        count = self._usable_values[BOOT_COUNT] = _increment_boot_count(self._usable_values.get(BOOT_COUNT, 0.0))
        self.save_parameters({BOOT_COUNT: count})

    def inventory(self, plans: Plans) -> str:
        """Return a summary of the loaded parameters and plans."""
        counts = [f"{len(self._usable_values)} parameters"]
        counts += [f"{kind.name.lower()} of {len(plans.of(kind).items)} items" for kind in PlanKind]
        return ", ".join(counts)

    def apply_parameters(self, base: ParameterSet) -> ParameterSet:
        """Return the parameters with the stored values in place of those of `base`."""
        for name, value in self._usable_values.items():
            base = base.replaced(name, value)
        return base

    def plans(self) -> Plans:
        """Load and return the plans of earlier runs."""
        self._plans = load_plans(self._store, self._report)
        return self._plans

    def resume_record(self) -> bytes | None:
        """Return the resume record of the last run, or None."""
        return self._store.load(RESUME_FILE)

    def save_parameters(self, changed: Mapping[str, float]) -> None:
        """Save changed parameters."""
        self._saved_values.update(changed)
        self._save_parameters()

    def clear_parameters(self) -> None:
        """Remove all stored parameters; after an error all are still stored."""
        removed = dict(self._saved_values)
        self._saved_values.clear()

        def restore(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            if not stored:
                self._saved_values = removed | self._saved_values
                self._save_parameters()

        self._store.try_save(PARAMETER_FILE, b"", restore)

    def save_plan(self, plan: Plan, done: Callable[[bool], None]) -> None:
        """Replace the stored plan of the same kind; after an error the old one remains. `done` receives the result."""

        def store_result(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            if stored:
                self._plans = self._plans.replaced(plan)
                self._changed_kinds.add(plan.kind)
            done(stored)

        self._store.try_save(PLAN_FILES[plan.kind], plan_to_text(plan).encode(), store_result)

    def save_resume(self, record: bytes) -> None:
        """Replace the resume record."""
        self._store.save(RESUME_FILE, record)

    def when_parameters_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when parameters and resume record are on disk, with False on an error."""
        self._store.when_stored((PARAMETER_FILE, RESUME_FILE), call)

    def when_resume_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when the resume record is on disk, with False on an error."""
        self._store.when_stored((RESUME_FILE,), call)

    def _merge_late_state(self, contents: Mapping[str, Stored]) -> None:
        """Merge the content of a directory that was mounted late with the values set since the start.

        A plan that was replaced since the start, or that is missing in the directory, is saved.
        """
        stored = contents[PARAMETER_FILE]
        values, unusable = read_parameters(stored.content, self._report)
        self._saved_values = unusable | values | self._saved_values
        if BOOT_COUNT in values:
            self._saved_values[BOOT_COUNT] = _increment_boot_count(values[BOOT_COUNT])
        self._report("State directory mounted: its content is used from the next start")
        if stored.damage:
            self._report(stored.damage)
        self._save_parameters()
        for kind, name in PLAN_FILES.items():
            plan = self._plans.of(kind)
            if kind in self._changed_kinds or (plan.items and contents[name].content is None):
                self._store.save_if_idle(name, plan_to_text(plan).encode())

    def _save_parameters(self) -> None:
        self._store.save(PARAMETER_FILE, format_file(self._saved_values).encode())


class KeyVault(msgspec.Struct, frozen=True):
    """Vault in the store for a secret, by default the signing key."""

    store: Store
    name: str = SIGNING_FILE

    def load(self) -> Stored:
        """Return the last saved content."""
        return self.store.examine(self.name)

    def on_mount(self, call: Callable[[Stored], None]) -> None:
        """Call back on the loop's thread with the content of a directory that was mounted after the start."""
        self.store.on_mount((self.name,), lambda contents: call(contents[self.name]))

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Save the content in the background; with `both_slots`, overwrite all earlier content."""
        self.store.save(self.name, content, both_slots=both_slots)

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back on the loop's thread when the content is on disk, with False on an error."""
        self.store.when_stored((self.name,), call)


def _increment_boot_count(count: float) -> float:
    return min(count + 1.0, TABLE[INDEX[BOOT_COUNT]].maximum)


def read_key(directory: Path) -> Stored:
    """Return the signing key of a state directory; safe while an autopilot is writing."""
    return examine(directory, SIGNING_FILE, directory.stat().st_uid)


def find_exposed_key_files(directory: Path) -> tuple[str, ...]:
    """Return the names of the slots of the signing key that other users may read."""
    exposed_names = []
    for path in (slot_path(directory, SIGNING_FILE, slot) for slot in SLOTS):
        try:
            mode = path.stat().st_mode
        except OSError:  # reported elsewhere
            continue
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            exposed_names.append(path.name)
    return tuple(exposed_names)


def load_parameters(store: StateReader, report: Callable[[str], None]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the result of `read_parameters` for the stored parameters."""
    return read_parameters(store.load(PARAMETER_FILE), report)


def read_parameters(content: bytes | None, report: Callable[[str], None]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the stored parameter values, and those that this version cannot use.

    Unusable values are reported. They stay in the store for the version that can use them, until all parameters are
    cleared or the parameter is set again. A line without name and value is reported and removed. After
    MAX_UNUSABLE_PARAMETERS unusable lines, the rest is ignored.
    """
    values: dict[str, float] = {}
    unusable: dict[str, float] = {}
    problems = 0
    if content is None:
        return values, unusable
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), start=1):
        try:
            values.update(parse_file(line, f"{PARAMETER_FILE} line {number}"))
        except ParameterError as error:
            name, value = _name_and_value(line)
            if name:
                unusable[name] = value
            report(f"stored parameter ignored{', kept for another version' if name else ''}: {error}")
            if (problems := problems + 1) == MAX_UNUSABLE_PARAMETERS:
                report(f"stored {PARAMETER_FILE}: lines after {number} are ignored")
                break
    return values, {name: value for name, value in unusable.items() if name not in values}


def _name_and_value(line: str) -> tuple[str, float]:
    """Split a stored line; the name is empty if the line cannot be a parameter of another version."""
    match = _LINE.fullmatch(line)
    value = float(match[2]) if match else math.nan
    return (match[1], value) if match and math.isfinite(value) else ("", value)


def load_plans(store: StateReader, report: Callable[[str], None]) -> Plans:
    """Return the stored plans; report and omit unusable ones."""
    plans = Plans()
    for kind, name in PLAN_FILES.items():
        content = store.load(name)
        if content is None:
            continue
        try:
            plan, notes = parse_stored_plan(kind, content.decode("ascii", "replace"))
        except ValueError as error:
            report(f"stored {name} ignored: {error}")
            continue
        plans = plans.replaced(plan)
        for note in notes:
            report(f"stored {name}: {note}")
    return plans


def parse_stored_plan(kind: PlanKind, text: str) -> tuple[Plan, tuple[str, ...]]:
    """Parse a stored plan of a kind; return it with notes on differences of another version. Raises ValueError."""
    plan, notes = plan_from_text(text)
    if plan.kind is not kind:
        raise ValueError(f"it is a {plan.kind.name.lower()}")
    if problem := problem_of(plan):
        raise ValueError(problem.message(int(kind is PlanKind.MISSION)))  # home is item 0
    return plan, notes
