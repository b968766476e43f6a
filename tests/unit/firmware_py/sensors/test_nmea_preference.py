"""Preference among messages that repeat one measurement."""

from firmware_py.sensors.nmea_preference import Preference


def test_kind_is_used_when_better_ones_are_silent_for_more_than_5_s():
    preference = Preference({"best": 0, "good": 1, "equal": 1, "poor": 2})
    assert [preference.accepts(kind, 1.0) for kind in ("poor", "good", "equal", "best")] == [True] * 4
    assert not preference.accepts("good", 6.0)
    assert preference.accepts("equal", 6.1)
    assert not preference.accepts("poor", 11.1)
    assert preference.accepts("poor", 11.2)
    assert preference.accepts("best", 11.2)
