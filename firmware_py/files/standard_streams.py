"""Replaces closed standard streams."""

from __future__ import annotations

import os
import sys

_LAST_STREAM = 2  # standard error


def open_closed_streams() -> None:
    """Open /dev/null for each standard stream that was closed at the start.

    Otherwise the next opened file would get its descriptor number, and texts could be printed to a serial port.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _LAST_STREAM:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115, PTH123 - never closed
