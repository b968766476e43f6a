"""Finds other programs that have a serial port open, in /proc; only root sees programs of other users."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

PROC = Path("/proc")


def find_port_users(paths: Iterable[str]) -> Mapping[str, str]:
    """Return the users of each port that other programs have open: "gpsd (process 812), brltty (process 90)".

    The program at the other end of a pseudo-terminal, such as an emulator, is not listed.
    """
    paths_by_target = {os.path.realpath(path): path for path in paths}
    users: dict[str, list[str]] = {}
    for process in _processes():
        links = set(_open_files(process))
        is_emulator = any(link.endswith("/ptmx") for link in links)
        for target in links & paths_by_target.keys():
            if not (is_emulator and target.startswith("/dev/pts/")):
                users.setdefault(paths_by_target[target], []).append(
                    f"{_process_name(process)} (process {process.name})"
                )
    return {path: ", ".join(names) for path, names in users.items()}


def _processes() -> Iterator[Path]:
    own = str(os.getpid())
    return (entry for entry in PROC.iterdir() if entry.name.isdecimal() and entry.name != own)


def _open_files(process: Path) -> Iterator[str]:
    try:
        entries = os.listdir(process / "fd")  # noqa: PTH208 - names alone
    except OSError:
        return  # of another user, or ended
    for entry in entries:
        try:
            yield os.readlink(process / "fd" / entry)  # noqa: PTH115 - a text: not every link is a path
        except OSError:
            continue


def _process_name(process: Path) -> str:
    try:
        name = (process / "comm").read_bytes().strip().decode("ascii", "replace")
    except OSError:
        return "?"
    return "".join(character if character.isprintable() else "?" for character in name)
