"""Error lines of the commands."""

from __future__ import annotations

import sys

USAGE = 2  # exit code: wrong usage or configuration


def print_error(command: str, reason: Exception | str, code: int = USAGE) -> int:
    """Print each line of the reason on standard error and return the exit code."""
    for line in str(reason).splitlines() or [""]:
        print(f"rambler {command}: {line}", file=sys.stderr)
    return code
