"""Text files of plans: waypoints, fence and rally points; errors with the line number."""

import math

import pytest

from firmware_py.common.plan import Plan, PlanItem, PlanKind
from firmware_py.plans.numbers import PlanFileError
from firmware_py.plans.text_files import read_text, write_text

WAYPOINT, JUMP = 16, 177  # MAV_CMD
HOME_LINE = "0\t1\t0\t16\t0\t0\t0\t0\t36.0\t121.0\t5.0\t1\n"
WPL_HEADER = "QGC WPL 110\n" + HOME_LINE


def wpl_text(*lines):
    """Return a waypoint file with these lines, given without index, current and autocontinue."""
    return WPL_HEADER + "".join(f"{index}\t0\t{line}\t1\n" for index, line in enumerate(lines, start=1))


def test_waypoints_are_read_with_and_without_home():
    plan = read_text(
        wpl_text("3\t16\t0\t5.5\t0\tnan\t36.1234567\t121.1\t0", "2\t177\t1\t-1\t0\t0\t0\t0\t0"), "a.waypoints"
    )
    assert repr(plan.items) == repr(
        (
            PlanItem(WAYPOINT, 3, True, (0.0, 5.5, 0.0, math.nan), 361_234_567, 1_211_000_000, 0.0),
            PlanItem(JUMP, 2, True, (0.0, -1.0, 0.0, 0.0)),
        )
    )
    home_as_item = read_text(WPL_HEADER, "a.waypoints", home=False)
    assert [(item.x, item.z) for item in home_as_item.items] == [(360_000_000, 5.0)]


def test_written_file_has_home_and_the_columns_of_the_format():
    items = [
        PlanItem(WAYPOINT, 3, False, (1.0, -0.0, math.nan, 0.1), 361_234_567, -1_211_234_567, -2.5),
        PlanItem(JUMP, 2, True, (0.0, -1.0, 0.0, 0.0), 2**31 - 1, 0),
    ]
    text = write_text(Plan.of(PlanKind.MISSION, items))
    assert text.splitlines() == [
        "QGC WPL 110",
        "0\t1\t0\t16\t0\t0\t0\t0\t0.0000000\t0.0000000\t0\t1",
        "1\t0\t3\t16\t1\t-0\tnan\t0.1\t36.1234567\t-121.1234567\t-2.5\t0",
        "2\t0\t2\t177\t1\t-1\t0\t0\t2147483647\t0\t0\t1",
    ]
    assert repr(read_text(text, "a").items) == repr(Plan.of(PlanKind.MISSION, items).items)


def test_positions_at_the_limits_and_numbers_that_are_not_a_position():
    plan = read_text(wpl_text("3\t16\t0\t0\t0\t0\t-90\t180\t0", "2\t20\t0\t0\t0\t0\t2147483648\tnan\t0"), "a")
    assert [(item.x, item.y) for item in plan.items] == [(-900_000_000, 1_800_000_000), (0, 0)]


def test_file_without_items_is_rejected():
    with pytest.raises(PlanFileError, match="a: no items, so that the kind of plan is unknown"):
        read_text("# by hand\n\nQGC WPL 110\n", "a")


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", "a: not a supported plan file"),
        ("QGC WPL 100\n", "a: not a supported plan file"),
        (WPL_HEADER + "1\t0\t3\n", "a:3: 3 columns instead of 12"),
        (WPL_HEADER + "2\t0\t3\t16\t0\t0\t0\t0\t0\t0\t0\t1\n", "a:3: item '2' instead of 1"),
        (wpl_text(f"3\t16\t{'x' * 31}\t0\t0\t0\t0\t0\t0"), f"a:3: '{'x' * 30}' is not a number"),
        (WPL_HEADER + "x" * 21 + "\t0" * 11, f"a:3: item '{'x' * 20}' instead of 1; number them from 0"),
        (wpl_text("3\t16\t1_0\t0\t0\t0\t0\t0\t0"), "a:3: '1_0' is not a number"),
        (wpl_text("3\t16\t0\t0\t0\t0\tnan\t0\t0"), "a:3: latitude nan is not within"),
        (wpl_text("3\t16\t0\t0\t0\t0\t0\t181\t0"), "a:3: longitude 181 is not within"),
        (wpl_text("256\t16\t0\t0\t0\t0\t0\t0\t0"), "a:3: '256' is not a whole number from 0 to 255"),
        (wpl_text("3\t65536\t0\t0\t0\t0\t0\t0\t0"), "a:3: '65536' is not a whole number from 0 to 65535"),
        (WPL_HEADER + "1\t0\t3\t16" + "\t0" * 7 + "\t2\n", "a:3: '2' is not a whole number from 0 to 1"),
        (wpl_text("3\t16.5\t0\t0\t0\t0\t0\t0\t0"), "a:3: '16.5' is not a whole number"),
        (wpl_text("3\t16\t1e300\t0\t0\t0\t0\t0\t0"), "a:3: param1 is too large"),
        ("RALLY 1 2 3\n", "a:1: expected RALLY"),
        ("RALLY 1 2 3 4 5 6\n7 8\n", "a:2: expected RALLY"),
        ("1 2\n1 2\n", "a: a fence needs its return point"),
        ("1 2\n1 2\n1 3\n1 2\n", "a: a fence needs its return point"),
        ("1 2\n1 2\n1 3\n2 3\n2 2\n", "a: a fence needs its return point"),
        ("1 2\n1 2 3\n", "a:2: expected LATITUDE LONGITUDE"),
    ],
)
def test_invalid_text_file_is_rejected_with_the_line_number(text, error):
    with pytest.raises(PlanFileError) as rejection:
        read_text(text, "a")
    assert str(rejection.value).startswith(error)
