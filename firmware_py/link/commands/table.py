"""Table of all commands; the reference page params/MESSAGES.md is generated from it."""

from __future__ import annotations

from operator import attrgetter

from firmware_py.link.commands import maintenance, plan, requests, state, steering
from firmware_py.link.commands.server import CommandRow

_SUBJECTS = (maintenance, plan, requests, state, steering)
TABLE: tuple[CommandRow, ...] = tuple(
    sorted((row for subject in _SUBJECTS for row in subject.COMMANDS), key=attrgetter("command"))
)
