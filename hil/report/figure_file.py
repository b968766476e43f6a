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
    """Return the key of a figure for the pages: lower-case letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", " ".join(words).lower()).strip("_")


def origin(command: str, machine: str) -> dict[str, str]:
    """Return date, commit, machine and command of figures measured now."""
    return {
        "when": datetime.now(UTC).strftime("%Y-%m-%d"),
        "commit": _commit(),
        "machine": machine,
        "command": command,
    }


def entry(value: float | str, unit: str, source: Mapping[str, str], **more: Any) -> dict[str, Any]:
    """Return one entry of the file; a value is a number, or a text where a number is not enough.

    ValueError for NaN and infinity, which pages cannot show.
    """
    if not _finite(value):
        raise ValueError(f"{value} is not a finite figure")
    kept = {name: _rounded(detail) for name, detail in more.items() if detail not in (None, "", []) and _finite(detail)}
    return {"value": _rounded(value), "unit": unit, **kept, **source}


def merge(path: Path, entries: Entries) -> None:
    """Merge entries into the file by name; several processes may do so at once.

    An entry with `cases`, the values of several runs by name, keeps the cases of the same commit and has the largest
    as its value. One with `repeats` appends them to the stored ones, up to the latest MAX_REPEATS, because the scatter
    from day to day is larger than that from minute to minute. Repeats of a COUNTED figure replace the stored ones,
    because counts have no scatter and old ones belong to another program.
    """
    with _locked(path) as file:
        content = _content(path, file)
        for name, fresh in entries.items():
            # Figures of one measurement stay together in their order, because pages make tables of them.
            content[name] = _with_earlier(content.pop(name, {}), dict(fresh))
        file.truncate(0)
        file.write(json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def read(option: str, path: Path) -> dict[str, Any]:
    """Return the entries of an existing file; UsageError if it cannot be read or holds none."""
    try:
        with os.fdopen(open_regular(path, max_bytes=MAX_BYTES), encoding="utf-8") as file:
            return _content(path, file)
    except OSError as error:
        raise UsageError(f"{option} {path} cannot be read: {error.strerror}; give another") from None


def check(option: str, path: Path | None) -> None:
    """Raise UsageError if figures cannot be merged into a requested file."""
    if path is None:
        return
    try:
        with _locked(path) as file:
            _content(path, file)
    except OSError as error:
        raise UsageError(f"{option} {path} cannot be written: {error.strerror}; give another") from None


@contextmanager
def _locked(path: Path) -> Iterator[TextIO]:
    """Open the file, created if necessary, with a lock, to read and then to append."""
    descriptor = open_regular(path, flags=os.O_RDWR | os.O_APPEND | os.O_CREAT, mode=0o666, max_bytes=MAX_BYTES)
    with os.fdopen(descriptor, "r+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield file


def _content(path: Path, file: TextIO) -> dict[str, Any]:
    try:
        text = file.read()
        content = json.loads(text) if text else {}
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path} is not a file of figures ({error}); give another") from None
    if not isinstance(content, dict):
        raise UsageError(f"{path} is not a file of figures by name; give another")
    return content


def _with_earlier(old: Mapping[str, Any], fresh: dict[str, Any]) -> dict[str, Any]:
    if "cases" in fresh:
        kept = old.get("cases", {}) if old.get("commit") == fresh["commit"] else {}
        fresh["cases"] = dict(sorted({**kept, **fresh["cases"]}.items()))
        fresh["value"] = max(fresh["cases"].values())
    if "repeats" in fresh and fresh["unit"] != COUNTED:
        fresh["repeats"] = [*old.get("repeats", []), *fresh["repeats"]][-MAX_REPEATS:]
    return fresh


def _rounded(value: Any) -> Any:
    """Round numbers to the digits of a measurement."""
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _finite(value: object) -> bool:
    return not isinstance(value, float) or math.isfinite(value)


def _commit() -> str:
    commit = _git("rev-parse", "--short=7", "HEAD")
    # The file itself changes during the measurement.
    changed = _git("status", "--porcelain", "--untracked-files=no", "--", ":/", ":(top,exclude)docs/figures.json")
    return (commit or UNKNOWN) + ("-changed" if changed else "")


def _git(*words: str) -> str:
    command = ["git", "-C", str(ROOT), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()
