"""Settings for all tests: examples drawn the same every time, no files left behind, and time for the long proofs."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.configuration import set_hypothesis_home_dir

PROOF_S = 3600.0

# What it keeps goes where pytest keeps its own, out of the sight of git.
set_hypothesis_home_dir(Path(__file__).parents[1] / ".venv" / ".pytest_cache" / "hypothesis")

settings.register_profile(
    "rambler",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("rambler")


def pytest_collection_modifyitems(items):
    """A proof that names no time of its own has an hour, however it is run."""
    for item in items:
        if item.get_closest_marker("proof") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(PROOF_S))
