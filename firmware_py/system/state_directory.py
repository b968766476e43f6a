"""What outlives a restart, by its names in the store: parameters, plans, resume record, signing key.

What cannot be used of it is said and left out.
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
MAX_UNUSABLE_PARAMETERS: Final = 200  # stored parameters: more than a version adds
# What is used of a name of which no version is left.
_INSTEAD: Final = {
    PARAMETER_FILE: "the vehicle file's parameters are used",
    PLAN_FILES[PlanKind.MISSION]: "there is no mission",
    PLAN_FILES[PlanKind.FENCE]: "there is no fence",
    PLAN_FILES[PlanKind.RALLY]: "there are no rally points",
    RESUME_FILE: "not resumed",
    ENDINGS_FILE: "how earlier runs have ended is forgotten",
    SATELLITE_FILE: "what was spent on messages is forgotten, and no message counts that was written before",
}
STATE_NAMES: Final = (*_INSTEAD, SIGNING_FILE)  # all that there is of a state
OTHER_SLOT: Final = "the other slot is used, perhaps an older version"
_LINE = re.compile(r"([A-Z][A-Z0-9_]{0,15}) (-?[0-9]+(?:\.[0-9]+)?(?:e[-+]?[0-9]+)?)")


class StateReader(Protocol):
    """What reads the names of a state directory: the store that holds it, or `StateFiles` of somebody who looks on."""

    def load(self, name: str) -> bytes | None:
        """Return the newest whole version, or None when there is none."""

    def examine(self, name: str) -> Stored:
        """Return the newest whole version, and what is wrong with what is stored."""


class StateFiles(msgspec.Struct, frozen=True):
    """A state directory that is not held: safe beside an autopilot that is writing; a StateReader."""

    directory: Path

    def load(self, name: str) -> bytes | None:
        """Return the newest whole version, or None when there is none."""
        return self.examine(name).content

    def examine(self, name: str) -> Stored:
        """Return the newest whole version, and what is wrong with what is stored."""
        secret = name == SIGNING_FILE and self.directory.is_dir()
        return stored_key(self.directory) if secret else examine(self.directory, name)


def report_damage(store: StateReader, say: Callable[[str], None]) -> None:
    """Say what is damaged, unreadable or missing, and what is used instead; before anything is kept anew.

    Of the signing key tells `firmware_py.assemble.stored_state`, which knows what one is.
    """
    for name, instead in _INSTEAD.items():
        stored = store.examine(name)
        if stored.damage:
            used = instead if stored.content is None else OTHER_SLOT
            say(f"{stored.damage}: {used}")


class StateDirectory:
    """Reads what earlier runs have left in the store, and keeps what the next one shall find; a StateWriter."""

    def __init__(self, store: Store, say: Callable[[str], None]) -> None:
        """Read the parameters; `say` takes a line on each thing that cannot be used."""
        self._store, self._say = store, say
        self._usable, unusable = load_parameters(store, say)
        self._kept = unusable | self._usable
        self._plans = Plans()  # in force, as far as they were stored
        self._set: set[PlanKind] = set()  # those of them that were set since the start
        store.on_mount((PARAMETER_FILE, *PLAN_FILES.values()), self._take_up)

    def count_start(self) -> None:
        """Count one start more."""
        count = self._usable[BOOT_COUNT] = _one_more(self._usable.get(BOOT_COUNT, 0.0))
        self.save_parameters({BOOT_COUNT: count})

    def inventory(self, plans: Plans) -> str:
        """Say in a few words what is used of what earlier runs have left."""
        counts = [f"{len(self._usable)} parameters"]
        counts += [f"{kind.name.lower()} of {len(plans.of(kind).items)} items" for kind in PlanKind]
        return ", ".join(counts)

    def parameters_over(self, base: ParameterSet) -> ParameterSet:
        """Return the parameters with the kept ones over them."""
        for name, value in self._usable.items():
            base = base.replaced(name, value)
        return base

    def plans(self) -> Plans:
        """Return the plans of earlier runs."""
        self._plans = load_plans(self._store, self._say)
        return self._plans

    def resume_record(self) -> bytes | None:
        """Return the resume record of the last run, None when there is none."""
        return self._store.load(RESUME_FILE)

    def save_parameters(self, changed: Mapping[str, float]) -> None:
        """Keep parameters that were set."""
        self._kept.update(changed)
        self._save_parameters()

    def clear_parameters(self) -> None:
        """Forget all parameters that were set, or none when this cannot be stored."""
        forgotten = dict(self._kept)
        self._kept.clear()

        def remember(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            if not stored:
                self._kept = forgotten | self._kept
                self._save_parameters()

        self._store.try_save(PARAMETER_FILE, b"", remember)

    def save_plan(self, plan: Plan, done: Callable[[bool], None]) -> None:
        """Keep a plan in place of the one of its kind, which stays when this cannot be stored; `done` says which."""

        def note(stored: bool) -> None:  # noqa: FBT001 - the store's callback
            if stored:
                self._plans = self._plans.replaced(plan)
                self._set.add(plan.kind)
            done(stored)

        self._store.try_save(PLAN_FILES[plan.kind], plan_to_text(plan).encode(), note)

    def save_resume(self, record: bytes) -> None:
        """Keep a resume record in place of the last one."""
        self._store.save(RESUME_FILE, record)

    def when_parameters_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once parameters and resume record are on disk, or cannot be (False)."""
        self._store.when_stored((PARAMETER_FILE, RESUME_FILE), call)

    def when_resume_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once the resume record is on disk (True) or cannot be (False)."""
        self._store.when_stored((RESUME_FILE,), call)

    def _take_up(self, found: Mapping[str, Stored]) -> None:
        """Keep what is in a directory that has come late, under what has been set since the start.

        Where it holds no plan of a kind, as a disk that was formatted anew, it gets the one in force.
        """
        stored = found[PARAMETER_FILE]
        values, unusable = read_parameters(stored.content, self._say)
        self._kept = unusable | values | self._kept
        if BOOT_COUNT in values:
            self._kept[BOOT_COUNT] = _one_more(values[BOOT_COUNT])
        self._say("State directory is there now; what it holds counts from the next start")
        if stored.damage:
            self._say(stored.damage)
        self._save_parameters()
        for kind, name in PLAN_FILES.items():
            plan = self._plans.of(kind)
            if kind in self._set or (plan.items and found[name].content is None):
                self._store.save_if_idle(name, plan_to_text(plan).encode())

    def _save_parameters(self) -> None:
        self._store.save(PARAMETER_FILE, format_file(self._kept).encode())


class KeyVault(msgspec.Struct, frozen=True):
    """Keeps the signing key, or what else is named, in the store; a Vault."""

    store: Store
    name: str = SIGNING_FILE

    def load(self) -> Stored:
        """Return what was saved last."""
        return self.store.examine(self.name)

    def on_mount(self, call: Callable[[Stored], None]) -> None:
        """Call back, on the loop's thread, with what a directory holds that was not there at the start."""
        self.store.on_mount((self.name,), lambda found: call(found[self.name]))

    def save(self, content: bytes, *, both_slots: bool = False) -> None:
        """Keep this instead, in the background; `both_slots`: so that nothing is left of what was kept before."""
        self.store.save(self.name, content, both_slots=both_slots)

    def when_stored(self, call: Callable[[bool], None]) -> None:
        """Call back, on the loop's thread, once this is on disk (True) or cannot be (False)."""
        self.store.when_stored((self.name,), call)


def _one_more(count: float) -> float:
    return min(count + 1.0, TABLE[INDEX[BOOT_COUNT]].maximum)


def stored_key(directory: Path) -> Stored:
    """Return what a state directory holds of a signing key, for its owner: safe beside an autopilot that is writing."""
    return examine(directory, SIGNING_FILE, directory.stat().st_uid)


def exposed_key_files(directory: Path) -> tuple[str, ...]:
    """Return the names of the files of the signing key that others may read."""
    exposed = []
    for path in (slot_path(directory, SIGNING_FILE, slot) for slot in SLOTS):
        try:
            mode = path.stat().st_mode
        except OSError:  # what cannot be looked at is told elsewhere
            continue
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            exposed.append(path.name)
    return tuple(exposed)


def load_parameters(store: StateReader, say: Callable[[str], None]) -> tuple[dict[str, float], dict[str, float]]:
    """Return what `read_parameters` does of what is stored."""
    return read_parameters(store.load(PARAMETER_FILE), say)


def read_parameters(content: bytes | None, say: Callable[[str], None]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the values that ground stations have set in earlier runs, and those that this version cannot use.

    The latter are said. They stay in the store for the version that knows them, until all are forgotten or
    the parameter is set anew; a line that is no name and value is said and left out for good. What comes after the
    first MAX_UNUSABLE_PARAMETERS lines of either kind is not read.
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
            say(f"stored parameter left out{', and kept for another version' if name else ''}: {error}")
            if (problems := problems + 1) == MAX_UNUSABLE_PARAMETERS:
                say(f"stored {PARAMETER_FILE}: what comes after line {number} is left out")
                break
    return values, {name: value for name, value in unusable.items() if name not in values}


def _name_and_value(line: str) -> tuple[str, float]:
    """Split a stored line; an empty name for what may not be the parameter of another version."""
    match = _LINE.fullmatch(line)
    value = float(match[2]) if match else math.nan
    return (match[1], value) if match and math.isfinite(value) else ("", value)


def load_plans(store: StateReader, say: Callable[[str], None]) -> Plans:
    """Return the plans of earlier runs; an unusable one is said and left out."""
    plans = Plans()
    for kind, name in PLAN_FILES.items():
        content = store.load(name)
        if content is None:
            continue
        try:
            plan, notes = checked_plan(kind, content.decode("ascii", "replace"))
        except ValueError as error:
            say(f"stored {name} ignored: {error}")
            continue
        plans = plans.replaced(plan)
        for note in notes:
            say(f"stored {name}: {note}")
    return plans


def checked_plan(kind: PlanKind, text: str) -> tuple[Plan, tuple[str, ...]]:
    """Read the stored plan of a kind, and notes on what another version has made of it; ValueError."""
    plan, notes = plan_from_text(text)
    if plan.kind is not kind:
        raise ValueError(f"it is a {plan.kind.name.lower()}")
    if problem := problem_of(plan):
        raise ValueError(problem.message(int(kind is PlanKind.MISSION)))  # home is item 0
    return plan, notes
