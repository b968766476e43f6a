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
_UNIT_DIRECTORIES = (
    *(Path("/etc/systemd/system"), Path("/run/systemd/system")),
    *(Path("/usr/local/lib/systemd/system"), Path("/usr/lib/systemd/system")),
)
_MAX_BYTES = 1 << 18
_PREFIXES = "-+!:@"  # of a command (systemd.service(5))


class Installation(msgspec.Struct, frozen=True):
    """Link to the program, vehicle file, state directory, watchdog device and unit text of the installed service."""

    link: ProgramLink
    vehicle: Path
    state: Path
    watchdog: Path | None = None
    unit: str = ""
    blocked_reason: str = ""  # why it cannot be updated, with the remedy; empty if it can

    @property
    def service_arguments(self) -> list[str]:
        """Return the arguments for `rambler service print` or `install`."""
        watchdog = [] if self.watchdog is None else ["--watchdog", str(self.watchdog)]
        return [str(self.vehicle), "--state", str(self.state), *watchdog]


def read_installation(unit: Path) -> Installation:
    """Read a unit and its drop-ins; raise UpdateError if it is missing or from a version without trials.

    ExecStartPre counts the starts of a trial for one link and one state directory. If a drop-in changes these in
    ExecStart, every update would be rolled back; then `blocked_reason` is set.
    """
    try:
        text = read_text(unit, _MAX_BYTES)
    except OSError as error:
        raise UpdateError(f"{unit}: {error.strerror}; only a service can be updated: rambler service install") from None
    commands: dict[str, list[tuple[Path, str]]] = {"ExecStart": [], "ExecStartPre": []}
    for path in (unit, *_find_drop_ins(unit)):
        for name, value in _read_settings(path):
            if name in commands:
                commands[name] = [*commands[name], (path, value)] if value else []  # an empty value resets the list
    path_of_command, command = commands["ExecStart"][-1] if commands["ExecStart"] else (unit, "")
    words = _split_command(command)
    trial_commands = [
        _split_command(value) for _, value in commands["ExecStartPre"] if f"{TRIAL.parent.name}/{TRIAL.name}" in value
    ]
    if not trial_commands or len(trial_commands[-1]) != 4 or words[1:2] != ["run"] or "--state" not in words[:-1]:
        raise UpdateError(
            f"{path_of_command} is not a current unit of rambler; repeat rambler service install VEHICLE.toml"
        )
    link, state = words[0], words[words.index("--state") + 1]
    blocked_reason = ""
    if (counted_for := trial_commands[-1][2:]) != [link, state]:
        blocked_reason = (
            f"{path_of_command} runs {link} on {state}, but the starts of a trial are counted for "
            f"{' on '.join(counted_for)}; remove that file, "
            "and use rambler service install VEHICLE.toml (--state, --program)"
        )
    watchdog = Path(words[words.index("--watchdog") + 1]) if "--watchdog" in words[:-1] else None
    return Installation(ProgramLink(Path(link)), Path(words[2]), Path(state), watchdog, text, blocked_reason)


def _find_drop_ins(unit: Path) -> list[Path]:
    """Return the drop-ins of a unit in the order of systemd."""
    directories = _UNIT_DIRECTORIES if unit.parent == UNIT.parent else (unit.parent,)
    paths: dict[str, Path] = {}
    for directory in reversed(directories):
        paths |= {path.name: path for path in (directory / f"{unit.name}.d").glob("*.conf")}
    return [paths[name] for name in sorted(paths) if os.path.realpath(paths[name]) != os.devnull]


def _read_settings(path: Path) -> Iterator[tuple[str, str]]:
    """Yield the settings of a unit file; raise UpdateError if it cannot be read."""
    try:
        lines = read_text(path, _MAX_BYTES).splitlines()
    except OSError as error:
        raise UpdateError(f"{path}: {error.strerror}") from None
    begin = ""  # of a setting that continues in the next line
    for line in [*lines, ""]:
        full_line = begin + line
        is_continued = full_line.endswith("\\") and not full_line.lstrip().startswith(("#", ";"))
        begin = f"{full_line[:-1]} " if is_continued else ""
        name, equals, value = full_line.partition("=")
        if equals and not is_continued:
            yield name.strip(), value.strip()


def _split_command(command: str) -> list[str]:
    """Split a command; return an empty list if systemd would expand it (%i, $NAME) or a quote is not closed."""
    words: list[str] = []
    with suppress(ValueError):
        words = shlex.split(command.lstrip(_PREFIXES))
    without_escapes = [word.replace("%%", "").replace("$$", "") for word in words]
    if any(character in word for word in without_escapes for character in "%$"):
        return []
    return [word.replace("%%", "%").replace("$$", "$") for word in words]
