"""Reads the command of the service unit and its drop-ins, as systemd does."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from firmware_py.files.reading import read_text
from firmware_py.install.bundle import UpdateError
from firmware_py.install.program_link import ProgramLink
from firmware_py.install.service_files import TRIAL, UNIT

# A drop-in in an earlier directory hides one of the same name in a later one (systemd.unit(5)).
_PLACES = tuple(
    map(
        Path, ("/etc/systemd/system", "/run/systemd/system", "/usr/local/lib/systemd/system", "/usr/lib/systemd/system")
    )
)
_MAX_BYTES = 1 << 18
_PREFIXES = "-+!:@"  # of a command (systemd.service(5))


class Installation(msgspec.Struct, frozen=True):
    """Link to the program, vehicle file and state directory of the service."""

    link: ProgramLink
    vehicle: Path
    state: Path
    watchdog: Path | None = None
    unit: str = ""
    blocked_reason: str = ""  # why it cannot be updated, and the remedy

    @property
    def service_words(self) -> list[str]:
        """Return the arguments for `rambler service print` or `install`."""
        watchdog = [] if self.watchdog is None else ["--watchdog", str(self.watchdog)]
        return [str(self.vehicle), "--state", str(self.state), *watchdog]


def installation_of(unit: Path) -> Installation:
    """Read a unit and its drop-ins; raise UpdateError if it is missing or from a version without trials.

    The starts of a trial are counted for one link and one state: with others in a drop-in
    every update would be rolled back, so that `blocked_reason` is set.
    """
    try:
        text = read_text(unit, _MAX_BYTES)
    except OSError as error:
        raise UpdateError(f"{unit}: {error.strerror}; only a service can be updated: rambler service install") from None
    commands: dict[str, list[tuple[Path, str]]] = {"ExecStart": [], "ExecStartPre": []}
    for path in (unit, *_drop_ins(unit)):
        for name, value in _settings(path):
            if name in commands:
                commands[name] = [*commands[name], (path, value)] if value else []  # an empty value resets the list
    where, command = commands["ExecStart"][-1] if commands["ExecStart"] else (unit, "")
    words = _words(command)
    counting = [_words(value) for _, value in commands["ExecStartPre"] if f"{TRIAL.parent.name}/{TRIAL.name}" in value]
    if not counting or len(counting[-1]) != 4 or words[1:2] != ["run"] or "--state" not in words[:-1]:
        raise UpdateError(f"{where} is not a current unit of rambler; repeat rambler service install VEHICLE.toml")
    link, state = words[0], words[words.index("--state") + 1]
    blocked_reason = ""
    if (counted := counting[-1][2:]) != [link, state]:
        blocked_reason = (
            f"{where} runs {link} on {state}, but the starts of a trial are counted for {' on '.join(counted)}; "
            "remove that file, and use rambler service install VEHICLE.toml (--state, --program)"
        )
    watchdog = Path(words[words.index("--watchdog") + 1]) if "--watchdog" in words[:-1] else None
    return Installation(ProgramLink(Path(link)), Path(words[2]), Path(state), watchdog, text, blocked_reason)


def _drop_ins(unit: Path) -> list[Path]:
    """Return the drop-ins of a unit in the order of systemd."""
    places = _PLACES if unit.parent == UNIT.parent else (unit.parent,)
    found: dict[str, Path] = {}
    for place in reversed(places):
        found |= {path.name: path for path in (place / f"{unit.name}.d").glob("*.conf")}
    return [found[name] for name in sorted(found) if os.path.realpath(found[name]) != os.devnull]  # masked


def _settings(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the settings of a unit file; raise UpdateError if it cannot be read."""
    try:
        lines = iter(read_text(path, _MAX_BYTES).splitlines())
    except OSError as error:
        raise UpdateError(f"{path}: {error.strerror}") from None
    for line in lines:
        whole = line
        while whole.endswith("\\") and not whole.lstrip().startswith(("#", ";")):
            whole = f"{whole[:-1]} {next(lines, '')}"
        name, equals, value = whole.partition("=")
        if equals:
            yield name.strip(), value.strip()


def _words(command: str) -> list[str]:
    """Return the words of a command; empty if systemd would expand it (%i, $NAME) or a quote is not closed."""
    words: list[str] = []
    with suppress(ValueError):
        words = shlex.split(command.lstrip(_PREFIXES))
    plain = [word.replace("%%", "").replace("$$", "") for word in words]
    if any(mark in word for word in plain for mark in "%$"):
        return []
    return [word.replace("%%", "%").replace("$$", "$") for word in words]
