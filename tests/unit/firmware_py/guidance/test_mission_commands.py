from firmware_py.common.plan import PlanKind
from firmware_py.guidance.mission_commands import TABLE
from firmware_py.plans.items import TABLE as ITEMS


def test_every_item_that_takes_time_is_carried_out_and_no_other():
    assert TABLE.keys() == {row.command for row in ITEMS if row.kind is PlanKind.MISSION and row.lasts}
