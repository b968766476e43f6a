"""Settings for all tests: property tests draw the same examples every time and leave no files behind."""

from pathlib import Path

from hypothesis import HealthCheck, settings
from hypothesis.configuration import set_hypothesis_home_dir

# What it keeps goes where pytest keeps its own, out of the sight of git.
set_hypothesis_home_dir(Path(__file__).parents[1] / ".pytest_cache" / "hypothesis")

settings.register_profile(
    "rambler",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("rambler")
