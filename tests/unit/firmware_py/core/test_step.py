"""Tick as a pure function: from inputs to rudder commands and events."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from firmware_py.common.intents import (
    Arm,
    BenchRudder,
    ManualRudder,
    SetMode,
    SetParameter,
    SteerHeading,
    SteerPosition,
)
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import (
    FixType,
    HeadingSample,
    Inputs,
    NorthReference,
    PositionSample,
    RudderFeedback,
    Tick,
)
from firmware_py.common.reports import Activity
from firmware_py.core.state import State
from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.faults.table import Fault
from support.tick_boat import FIX, Boat, error_deg


def test_heading_goal_is_reached():
    boat = Boat(noise_rad=math.radians(0.3)).get_under_way()
    boat.tick(SteerHeading(5.9))
    boat.run(120.0)
    assert error_deg(boat, 5.9) < 0.5
    assert boat.outputs[-1].snapshot.goal_heading_rad == pytest.approx(5.9)


def test_rudder_is_centred_disarmed_and_in_hold_and_released_by_parameter():
    boat = Boat()
    boat.run(1.0)
    boat.tick(SetMode(Mode.GUIDED), SteerHeading(3.0))
    assert boat.run(2.0).command.shaft_rad == 0.0
    assert boat.outputs[-1].command.torque_on
    boat.tick(SetParameter("RUD_DISARMED", 1))
    assert not boat.run(0.1).command.torque_on
    boat.tick(Arm(armed=True))
    assert boat.run(3.0).command.shaft_rad > 0.4
    boat.tick(SetMode(Mode.HOLD))
    assert boat.run(2.0).command.shaft_rad == 0.0


@pytest.mark.parametrize("released", [0, 1])
def test_bench_command_moves_the_rudder_until_its_end_or_arming(released):
    boat = Boat(ParameterSet().replaced("RUD_DISARMED", released))
    boat.run(1.0)
    assert boat.outputs[-1].command.torque_on is not bool(released)
    boat.tick(BenchRudder(-0.5, 3.0))
    boat.run(2.5)
    assert boat.outputs[-1].snapshot.rudder_command_rad == pytest.approx(-0.5 * math.radians(30.0))
    assert boat.outputs[-1].command.torque_on
    boat.run(2.0)
    assert boat.outputs[-1].snapshot.rudder_command_rad == 0.0
    assert boat.outputs[-1].command.torque_on is not bool(released)
    boat.tick(BenchRudder(1.0, 60.0))
    boat.run(2.0)
    boat.tick(Arm(True))
    boat.run(2.0)
    assert boat.outputs[-1].snapshot.rudder_command_rad == 0.0  # HOLD


def test_snapshot_has_the_reason_of_an_arming_refusal():
    boat = Boat()
    boat.run(1.0)
    assert boat.outputs[-1].snapshot.prearm_refusal == ""
    boat.compass = False
    boat.run(3.0)
    assert boat.outputs[-1].snapshot.prearm_refusal == "no valid heading"


def test_manual_follows_the_stick_within_the_rate_limit_and_ignores_an_old_stick():
    boat = Boat().get_under_way(Mode.MANUAL)
    output = boat.tick(ManualRudder(-1.0))
    assert output.snapshot.rudder_command_rad == pytest.approx(math.radians(-3.0), rel=1e-6)
    assert boat.run(2.0).snapshot.rudder_command_rad == pytest.approx(math.radians(-30.0), rel=1e-6)
    assert boat.run(3.0).snapshot.rudder_command_rad == 0.0


def test_stick_turns_the_goal_in_steering():
    boat = Boat().get_under_way(Mode.STEERING)
    for _ in range(100):
        boat.tick(ManualRudder(0.5))
    boat.tick(ManualRudder(None))
    boat.run(60.0)
    # Within the deadband of the first minute, in which the filter expects waves.
    assert error_deg(boat, 0.5 + math.radians(10.0)) < 2.0


def test_turn_has_the_commanded_direction():
    boat = Boat(heading_rad=1.0).get_under_way()
    boat.tick(SteerHeading(1.5, turn=-1))
    boat.run(30.0)
    assert boat.heading_rad < 0.8  # during the turn to port
    boat.run(260.0)
    assert boat.heading_rad == pytest.approx(1.5 - 2 * math.pi, abs=0.02)


def test_guidance_has_no_place_before_the_first_fix():
    boat = Boat()
    boat.run(1.0)
    assert boat.state.guidance.fence.place is None
    boat.position = FIX
    boat.run(1.0)
    place = boat.state.guidance.fence.place
    assert (place.latitude_rad, place.longitude_rad) == pytest.approx((0.5, 0.5), abs=1e-6)


def test_position_goal_is_approached():
    boat = Boat()
    boat.position, boat.position_ticks = FIX, 10
    boat.get_under_way()
    boat.tick(SteerPosition(0.5, 0.5001))
    output = boat.run(300.0)
    assert error_deg(boat, math.pi / 2) < 2.0
    # The goal is 559 m away at the start, and the boat sails 120 m: 300 s at 0.4 m/s.
    assert output.snapshot.distance_m == pytest.approx(559.0 - 120.0, abs=20.0)
    assert output.snapshot.bearing_rad == pytest.approx(math.pi / 2, abs=0.03)
    assert abs(output.snapshot.navigation.cross_track_m) < 5.0
    assert output.snapshot.navigation.activity is Activity.LINE


def test_rudder_is_constant_then_centred_without_a_heading():
    boat = Boat().get_under_way()
    boat.tick(SteerHeading(2.5))
    boat.run(5.0)
    assert boat.outputs[-1].command.shaft_rad > 0.3
    boat.compass = False
    last_rad = boat.run(1.5).command.shaft_rad
    assert "No valid heading: rudder held, then centred" in boat.events
    assert boat.outputs[-1].snapshot.faults >> Fault.COMPASS_LOST & 1
    assert boat.run(8.0).command.shaft_rad == last_rad
    assert boat.run(4.0).command.shaft_rad == 0.0
    boat.compass = True
    boat.run(120.0)
    assert "Heading recovered" in boat.events
    assert error_deg(boat, 2.5) < 0.5


def test_shaft_angle_includes_centre_and_direction_of_the_servo():
    parameters = ParameterSet().replaced("RUD_CENTRE_DEG", 10.0).replaced("RUD_REVERSE", 1)
    boat = Boat(parameters).get_under_way(Mode.MANUAL)
    boat.tick(ManualRudder(1.0))
    output = boat.run(2.0)
    assert output.command.shaft_rad == pytest.approx(math.radians(10.0 - 30.0), rel=1e-6)
    assert output.snapshot.rudder_rad == pytest.approx(math.radians(30.0), rel=1e-3)


def test_boot_arm_and_boot_mode_set_the_initial_state():
    parameters = ParameterSet().replaced("BOOT_ARM", 1).replaced("BOOT_MODE", Mode.GUIDED)
    boat = Boat(parameters, heading_rad=2.0)
    boat.compass = False
    boat.run(1.0)
    boat.compass = True
    boat.run(60.0)
    assert error_deg(boat, 2.0) < 0.3
    assert boat.outputs[-1].snapshot.armed


def test_same_inputs_give_the_same_rudder_from_any_checkpoint():
    boat = Boat(noise_rad=0.01, seed=7).get_under_way()
    boat.tick(SteerHeading(4.0), SetParameter("CTL_K1", 35.7))
    boat.run(30.0)
    state = State.at_start(ParameterSet())
    for inputs, output in zip(boat.inputs, boat.outputs, strict=True):
        if inputs.tick.index % 50 == 0:
            state, _ = state_from_text(state_to_text(state))
        state, repeated_output = step(state, inputs)
        assert repeated_output == output
    assert state_to_text(state) == state_to_text(boat.state)


EXTREME_FLOATS = st.floats() | st.sampled_from([0.0, -0.0, 1e300, -1e300, math.nan, math.inf])


def test_invalid_position_does_not_move_the_rudder():
    boat = Boat()
    boat.position = FIX
    boat.get_under_way()
    # The bearing of the goal is 0.5 rad, the heading of the boat.
    boat.tick(SteerPosition(0.5 + 0.001 * math.cos(0.5), 0.5 + 0.001 * math.tan(0.5)))
    boat.run(60.0)
    boat.position = PositionSample(0.0, FixType.FIX_3D, math.nan, math.inf)
    assert abs(boat.run(4.0).command.shaft_rad) < 0.1


@example([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 4.7e13), (0.0, 0.0, 0.0)], True)
@given(st.lists(st.tuples(EXTREME_FLOATS, EXTREME_FLOATS, EXTREME_FLOATS), min_size=1, max_size=30), st.booleans())
def test_any_device_input_gives_a_command_within_the_limits(rows, has_angle):
    parameters = ParameterSet().replaced("BOOT_ARM", 1).replaced("BOOT_MODE", Mode.GUIDED)
    state = State.at_start(parameters)
    previous_rad = 0.0
    for index, (heading_rad, position_rad, shaft_rad) in enumerate(rows):
        t_s = 0.1 * index
        state, output = step(
            state,
            Inputs(
                Tick(index, t_s, 0.0, 0, 10.0),
                (HeadingSample(t_s, heading_rad, NorthReference.TRUE),),
                (PositionSample(t_s, FixType.FIX_2D, position_rad, position_rad, None, position_rad, position_rad),),
                (RudderFeedback(t_s, shaft_rad if has_angle else None),),
            ),
        )
        command_rad = output.snapshot.rudder_command_rad
        assert abs(command_rad) <= math.radians(30.0) + 1e-9
        assert abs(command_rad - previous_rad) <= math.radians(3.0) + 1e-9
        previous_rad = command_rad


def test_rudder_without_a_measured_angle_is_estimated():
    boat = Boat()
    boat.measures = False
    boat.get_under_way()
    boat.tick(SteerHeading(1.5))
    snapshot = boat.run(1.0).snapshot
    assert snapshot.rudder_rad is None
    assert 0.1 < snapshot.rudder_estimate_rad < snapshot.rudder_command_rad
    boat.run(120.0)
    assert error_deg(boat, 1.5) < 1.0
    assert boat.events.count("Rudder angle: estimated") == 1
    assert state_from_text(state_to_text(boat.state))[0].rudder == boat.state.rudder
