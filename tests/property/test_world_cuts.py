"""A simulated run does not depend on how it is divided into calls."""

from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from hil.ship import scenarios
from hil.sim.world import World

END_S = 4.0
LAST_CALL_S = END_S - 0.003
TIMES_S = st.lists(st.floats(0.0, LAST_CALL_S), max_size=40)
COMMANDS = st.lists(st.tuples(st.floats(0.0, LAST_CALL_S), st.floats(-40.0, 40.0)), max_size=6).map(sorted)


def simulate(call_times_s, commands):
    """Return the true states of a run with rudder commands, and the state at its last call."""
    world = World(scenarios.find_scenario("storm"), 7, end_s=END_S)
    world.shaft.set_torque(on=True)
    events = sorted([(t_s, 0, 0.0) for t_s in call_times_s] + [(t_s, 1, angle_deg) for t_s, angle_deg in commands])
    for t_s, is_command, angle_deg in events:
        world.advance_to(t_s)
        world.heading_rad()
        if is_command:
            world.shaft.set_target(radians(angle_deg))
    world.advance_to(LAST_CALL_S)
    state = (world.heading_rad(), world.yaw_rate_rad_s(), world.latitude_deg(), world.longitude_deg())
    world.advance_to(END_S)
    return world.truth, state


@settings(max_examples=30)
@given(TIMES_S, COMMANDS)
def test_additional_calls_change_no_bit(call_times_s, commands):
    assert simulate(call_times_s, commands) == simulate([], commands)
