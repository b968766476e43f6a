"""What a campaign needs beyond the harness: packages of an extra, which is installed only where one is sailed."""

from __future__ import annotations

import importlib
from typing import Any

from hil.errors import UsageError

EXTRA = "rambler-autopilot[campaign]"


def imported(name: str) -> Any:
    """Return a module of the extra; UsageError that names the remedy where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise UsageError(f"{name.partition('.')[0]} is not installed; pip install '{EXTRA}'") from None
