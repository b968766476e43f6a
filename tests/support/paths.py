"""Where the tests find things."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"  # recordings of real devices; its README says where each is from
REPLAY = ROOT / "tests" / "replay" / "data"
