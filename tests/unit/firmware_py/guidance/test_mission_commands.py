from firmware_py.common.plan import PlanKind
from firmware_py.guidance.mission_commands import TABLE
from firmware_py.plans.items import TABLE as ITEMS


def test_the_table_has_all_items_that_take_time():
    assert TABLE.keys() == {row.command for row in ITEMS if row.kind is PlanKind.MISSION and row.lasts}
