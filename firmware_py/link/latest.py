"""A table of the latest few: what others send must not make it grow without bound."""

from __future__ import annotations

from collections import OrderedDict
from typing import TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


def keep_latest(table: OrderedDict[Key, Value], key: Key, value: Value, most: int) -> None:
    """Keep a value as the latest; where there are more than so many, the one that was kept longest ago goes."""
    table[key] = value
    table.move_to_end(key)
    if len(table) > most:
        table.popitem(last=False)
