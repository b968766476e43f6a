"""Compass swing: progress and proposal."""

import pytest

from firmware_py.common.angles import degrees
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import CalibrationState
from firmware_py.core.compass_swing import CompassSwing
from support.swing import voyage

PARAMETERS = ParameterSet().replaced("CMP_DEV_B", 2.0)


def sail_swing(legs=20, parameters=PARAMETERS):
    """Sail a voyage with a swing; return the swing, its events with their reports, and its percentages."""
    swing, events, percents = CompassSwing(), [], []
    swing.begin(parameters)
    for tick in voyage(legs=legs):
        events += [(event, swing.report) for event in swing.take(tick.inputs, parameters)]
        percents.append(swing.report.percent)
    return swing, events, percents


def test_idle_swing_has_no_effect():
    swing = CompassSwing()
    assert not swing.is_running
    assert not [event for tick in voyage(legs=1) for event in swing.take(tick.inputs, PARAMETERS)]
    assert swing.report.state is CalibrationState.NONE


def test_proposal_is_reported_once_with_its_uncertainty():
    swing, events, percents = sail_swing()
    report = swing.report
    assert (report.state, report.percent) == (CalibrationState.DONE, 100)
    assert degrees(report.estimated_rad[0]) == pytest.approx(5.0, abs=0.3)
    assert degrees(report.max_change_rad) == pytest.approx(7.0, abs=0.7)
    assert report.residual_after_rad < 0.2 * report.residual_before_rad
    ((event, first),) = events
    coefficients = " ".join(
        f"{letter} {degrees(value):.1f}" for letter, value in zip("ABCDE", first.estimated_rad, strict=True)
    )
    assert event.text == (
        f"Compass swing: {coefficients} deg, sd {degrees(first.sd_rad):.1f}, "
        f"error now {degrees(first.max_change_rad):.1f}, residual {degrees(first.residual_before_rad):.1f} to "
        f"{degrees(first.residual_after_rad):.1f}; accept with DO_ACCEPT_MAG_CAL"
    )
    assert percents.index(100) > 0
    assert max(percents[: percents.index(100)]) <= 99


def test_progress_is_reported_while_data_are_insufficient():
    swing, events, _ = sail_swing(legs=4)
    assert (swing.report.state, events) == (CalibrationState.RUNNING, [])
    assert 0 < swing.report.percent < 60
    assert swing.report.sectors.bit_count() <= 4


def test_only_former_parameters_remain_after_the_end():
    swing, _, _ = sail_swing(legs=4)
    swing.end({"CMP_DEV_A": 1.0})
    assert (swing.is_running, swing.report.state, swing.former) == (False, CalibrationState.NONE, {"CMP_DEV_A": 1.0})
    swing.begin(PARAMETERS)
    assert (swing.is_running, swing.former) == (True, None)
