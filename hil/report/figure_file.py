"""The file of measured figures that the documentation shows (docs/figures.json)."""

from __future__ import annotations

import fcntl
import json
import math
import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TextIO

from firmware_py.files.reading import open_regular
from hil.errors import UsageError

Entries = Mapping[str, Mapping[str, Any]]
ROOT = Path(__file__).parents[2]
UNKNOWN = "unknown"
DIGITS = 6
MAX_BYTES = 16 << 20
MAX_REPEATS = 14
COUNTED = "instructions"  # the unit of counts, which depend on the Python version but not on the machine


def key_of(*words: str) -> str:
    """Return the key of a figure in the file: lower-case letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", " ".join(words).lower()).strip("_")


def origin(command: str, machine: str) -> dict[str, str]:
    """Return date, commit, machine and command of figures measured now."""
    return {"when": datetime.now(UTC).strftime("%Y-%m-%d"), "commit": _commit(), "machine": machine, "command": command}


def entry(value: float | str, unit: str, source: Mapping[str, str], **details: Any) -> dict[str, Any]:
    """Return one entry of the file; the value is a number or a text.

    Raise ValueError for NaN and infinity, which pages cannot show.
    """
    if not _is_finite(value):
        raise ValueError(f"{value} is not a finite figure")
    valid_details = {
        name: _round(detail) for name, detail in details.items() if detail not in (None, "", []) and _is_finite(detail)
    }
    return {"value": _round(value), "unit": unit, **valid_details, **source}


def merge(path: Path, entries: Entries) -> None:
    """Merge entries into the file by name; several processes may do so at once.

    An entry with `cases`, the values of several runs by name, keeps the cases of the same commit and has the largest
    as its value. One with `repeats` appends them to the stored ones, up to the latest MAX_REPEATS, because the scatter
    from day to day is larger than that from minute to minute. Repeats of a COUNTED figure replace the stored ones,
    because counts have no scatter and old ones belong to another program.
    """
    with _locked(path) as file:
        content = _read_content(path, file)
        for name, new_entry in entries.items():
            # Figures of one measurement stay together in their order, because pages list them in tables.
            content[name] = _merge_entry(content.pop(name, {}), dict(new_entry))
        file.truncate(0)
        file.write(json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def read(option: str, path: Path) -> dict[str, Any]:
    """Return the entries of an existing file; raise UsageError if it cannot be read or is not a file of figures."""
    try:
        with os.fdopen(open_regular(path, max_bytes=MAX_BYTES), encoding="utf-8") as file:
            return _read_content(path, file)
    except OSError as error:
        raise UsageError(f"{option} {path} cannot be read: {error.strerror}; give another") from None


def check(option: str, path: Path | None) -> None:
    """Raise UsageError if figures cannot be merged into the file of an option."""
    if path is None:
        return
    try:
        with _locked(path) as file:
            _read_content(path, file)
    except OSError as error:
        raise UsageError(f"{option} {path} cannot be written: {error.strerror}; give another") from None


@contextmanager
def _locked(path: Path) -> Iterator[TextIO]:
    """Create or open the file for reading and appending, and lock it."""
    descriptor = open_regular(path, flags=os.O_RDWR | os.O_APPEND | os.O_CREAT, mode=0o666, max_bytes=MAX_BYTES)
    with os.fdopen(descriptor, "r+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file


def _read_content(path: Path, file: TextIO) -> dict[str, Any]:
    try:
        text = file.read()
        content = json.loads(text) if text else {}
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not a file of figures ({error}); give another") from None
    if not isinstance(content, dict):
        raise UsageError(f"{path} is not a file of figures by name; give another")
    return content


def _merge_entry(old_entry: Mapping[str, Any], new_entry: dict[str, Any]) -> dict[str, Any]:
    if "cases" in new_entry:
        cases = old_entry.get("cases", {}) if old_entry.get("commit") == new_entry["commit"] else {}
        new_entry["cases"] = dict(sorted({**cases, **new_entry["cases"]}.items()))
        new_entry["value"] = max(new_entry["cases"].values())
    if "repeats" in new_entry and new_entry["unit"] != COUNTED:
        new_entry["repeats"] = [*old_entry.get("repeats", []), *new_entry["repeats"]][-MAX_REPEATS:]
    return new_entry


def _round(value: Any) -> Any:
    """Round numbers to the digits of a measurement."""
    if isinstance(value, list):
        return [_round(each) for each in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _is_finite(value: object) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _commit() -> str:
    commit = _git("rev-parse", "--short=7", "HEAD")
    # The file itself changes during the measurement.
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", ":/", ":(top,exclude)docs/figures.json")
    return (commit or UNKNOWN) + ("-changed" if changed else "")


def _git(*words: str) -> str:
    command = ["git", "-C", str(ROOT), *words]
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return result.stdout.strip()
