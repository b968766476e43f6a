"""Finds other programs with an open serial port in /proc; only root sees those of other users."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

PROC = Path("/proc")


def port_users(paths: Iterable[str]) -> Mapping[str, str]:
    """Return the users of each port that is open elsewhere: "gpsd (process 812), brltty (process 90)".

    The program at the other end of a pseudo-terminal, an emulator, is not listed.
    """
    targets = {os.path.realpath(path): path for path in paths}
    users: dict[str, list[str]] = {}
    for process in _processes():
        links = set(_open_files(process))
        made_here = any(link.endswith("/ptmx") for link in links)
        for target in links & targets.keys():
            if not (made_here and target.startswith("/dev/pts/")):
                users.setdefault(targets[target], []).append(f"{_name(process)} (process {process.name})")
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


def _name(process: Path) -> str:
    try:
        name = (process / "comm").read_bytes().strip().decode("ascii", "replace")
    except OSError:
        return "?"
    return "".join(letter if letter.isprintable() else "?" for letter in name)
