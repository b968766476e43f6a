"""A run does not depend on how it is cut into calls."""

from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.common.angles import radians
from hil.ship import scenarios
from hil.sim.world import World

END_S = 4.0
LOOK_S = END_S - 0.003
moments = st.lists(st.floats(0.0, LOOK_S), max_size=40)
commands = st.lists(st.tuples(st.floats(0.0, LOOK_S), st.floats(-40.0, 40.0)), max_size=6).map(sorted)


def sailed(cuts: list[float], orders: list[tuple[float, float]]) -> tuple[list[object], tuple[float, ...]]:
    world = World(scenarios.find_scenario("storm"), 7, end_s=END_S)
    world.shaft.set_torque(on=True)
    events = sorted([(t, 0, 0.0) for t in cuts] + [(t, 1, angle) for t, angle in orders])
    for t_s, is_order, angle_deg in events:
        world.advance_to(t_s)
        world.heading_rad()
        if is_order:
            world.shaft.set_target(radians(angle_deg))
    world.advance_to(LOOK_S)
    seen = (world.heading_rad(), world.yaw_rate_rad_s(), world.latitude_deg(), world.longitude_deg())
    world.advance_to(END_S)
    return world.truth, seen


@settings(max_examples=30)
@given(moments, commands)
def test_cuts_change_nothing_not_even_the_last_bit(cuts, orders):
    assert sailed(cuts, orders) == sailed([], orders)
