"""Paths of test data, and reading of logs."""

import gzip
from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"  # recordings of real devices; its README states their origin
REPLAY = ROOT / "tests" / "replay" / "data"  # logs of earlier versions


def log_bytes(state, number):
    """Return the content of a log in a state directory, decompressed if necessary."""
    plain = state / "logs" / f"{number:08d}.BIN"
    try:
        return plain.read_bytes()
    except FileNotFoundError:
        return gzip.decompress(plain.with_name(f"{plain.name}.gz").read_bytes())
