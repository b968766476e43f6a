"""Settings for all tests: property tests draw the same examples every time and leave no files behind."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "rambler",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("rambler")
