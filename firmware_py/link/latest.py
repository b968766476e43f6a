"""Bounded table of the latest values, so that peers cannot fill the memory."""

from __future__ import annotations

from collections import OrderedDict
from typing import TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


def keep_latest(table: OrderedDict[Key, Value], key: Key, value: Value, max_count: int) -> None:
    """Store a value as the latest one; remove the oldest one if the table has more than `max_count`."""
    table[key] = value
    table.move_to_end(key)
    if len(table) > max_count:
        table.popitem(last=False)
