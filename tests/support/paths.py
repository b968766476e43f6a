"""Where the tests find things."""

import gzip
from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"  # recordings of real devices; its README says where each is from
REPLAY = ROOT / "tests" / "replay" / "data"  # logs of versions before


def log_bytes(state, number):
    """A log of the state directory as it was written, compressed by now or not."""
    plain = state / "logs" / f"{number:08d}.BIN"
    try:
        return plain.read_bytes()
    except FileNotFoundError:
        return gzip.decompress(plain.with_name(f"{plain.name}.gz").read_bytes())
