"""Errors that end a command with a line on stderr."""

from __future__ import annotations


class HilError(Exception):
    """A run or a command failed; the text is one line with the remedy."""

    exit_code = 1


class UsageError(HilError):
    """The usage or the configuration is invalid."""

    exit_code = 2
