"""The one family of errors that ends a command with a line on stderr."""

from __future__ import annotations


class HilError(Exception):
    """A run or a command that failed; the text is one line that names the remedy."""

    exit_code = 1


class UsageError(HilError):
    """Bad usage or configuration."""

    exit_code = 2
