"""How a command says that it cannot do what was asked."""

from __future__ import annotations

import sys

USAGE = 2  # the exit code of bad usage or configuration


def refused(command: str, reason: Exception | str, code: int = USAGE) -> int:
    """Print each line of the reason on standard error, and return the exit code."""
    for line in str(reason).splitlines() or [""]:
        print(f"rambler {command}: {line}", file=sys.stderr)
    return code
