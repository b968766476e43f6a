"""A swing that was asked for: told how far it is, proposed once there is enough, never in the way of the tick."""

import pytest

from firmware_py.common.angles import degrees
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import CalibrationState
from firmware_py.core.compass_swing import CompassSwing
from support.swing import voyage

IN_FORCE = ParameterSet().replaced("CMP_DEV_B", 2.0)


def swung(legs=20, parameters=IN_FORCE):
    """Sail the voyage with a swing; return it, its events, and the percents that it has told in between."""
    swing, events, percents = CompassSwing(), [], []
    swing.begin(parameters)
    for tick in voyage(legs=legs):
        events += swing.take(tick.inputs, parameters)
        percents.append(swing.report.percent)
    return swing, events, percents


def test_without_having_been_asked_for_it_does_nothing():
    swing = CompassSwing()
    assert not swing.running
    assert not [event for tick in voyage(legs=1) for event in swing.take(tick.inputs, IN_FORCE)]
    assert swing.report.state is CalibrationState.NONE


def test_a_proposal_is_told_once_with_what_it_is_worth():
    swing, events, percents = swung()
    report = swing.report
    assert (report.state, report.percent) == (CalibrationState.DONE, 100)
    assert degrees(report.found_rad[0]) == pytest.approx(5.0, abs=0.3)
    assert degrees(report.off_rad) == pytest.approx(7.0, abs=0.7)
    assert report.residual_after_rad < 0.2 * report.residual_before_rad
    (event,) = events
    assert event.text.startswith("Compass swing: A ")
    assert event.text.endswith("; accept with DO_ACCEPT_MAG_CAL")
    assert percents.index(100) > 0
    assert max(percents[: percents.index(100)]) <= 99


def test_too_little_is_told_as_a_part():
    swing, events, _ = swung(legs=4)
    assert (swing.report.state, events) == (CalibrationState.RUNNING, [])
    assert 0 < swing.report.percent < 60
    assert swing.report.sectors.bit_count() <= 4


def test_after_its_end_nothing_is_left_but_what_was_before():
    swing, _, _ = swung(legs=4)
    swing.end({"CMP_DEV_A": 1.0})
    assert (swing.running, swing.report.state, swing.former) == (False, CalibrationState.NONE, {"CMP_DEV_A": 1.0})
    swing.begin(IN_FORCE)
    assert (swing.running, swing.former) == (True, None)
