"""Replacement of closed standard streams."""

from __future__ import annotations

import os
import sys

_LAST = 2  # standard error


def keep_standard_streams() -> None:
    """Open /dev/null in place of a standard stream that was closed at the start.

    Otherwise the next opened file would get its number, and printed text could go to a serial port.
    """
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= _LAST:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115, PTH123 - never closed
