"""Checks of the drills, with a scripted boat."""

import pytest

from hil.lab.drill import checks


class Boat:
    """Turn at 1 deg/s to `turns_to`, send `texts` at their times, and be in the last of `modes`."""

    def __init__(self, **attributes):
        self.now_s, self.goal_s, self.goal_deg, self.heading_deg = 100.0, 90.0, 0.0, 0.0
        self.turns_to, self.texts, self.modes, self.mode_before = None, {}, ["GUIDED"], "GUIDED"
        self.final_rudder_deg = self.max_rudder_deg = 0.0
        self.orders, self.by_course = [], False
        for name, value in attributes.items():
            setattr(self, name, value)

    def run(self, seconds):
        self.now_s += seconds
        if self.turns_to is not None and abs(self.turns_to - self.heading_deg) > seconds:
            self.heading_deg += seconds if self.turns_to > self.heading_deg else -seconds

    def mode(self):
        return self.modes[-1]

    def error_deg(self):
        return self.heading_deg - self.goal_deg

    def steers_by_course(self):
        return self.by_course

    def report_time(self, text, since_s):
        at_s = self.texts.get(text)
        return at_s if at_s is not None and since_s <= at_s <= self.now_s else None

    def await_report(self, text, within_s, since_s):
        while self.report_time(text, since_s) is None and self.now_s < since_s + within_s:
            self.run(0.5)
        return self.report_time(text, since_s)

    def steer(self, goal_deg):
        self.orders.append(goal_deg)

    def set_mode(self, mode):
        self.orders.append(mode)


@pytest.mark.parametrize(
    ("error_deg", "by_course", "deviation"), [(20.0, False, True), (20.0, True, False), (40.0, True, True)]
)
def test_limit_of_the_heading_error_depends_on_the_heading_source(error_deg, by_course, deviation):
    assert bool(checks.is_on_course(Boat(heading_deg=error_deg, by_course=by_course), 95.0)) is deviation


@pytest.mark.parametrize(
    ("boat", "deviation"),
    [
        (Boat(), ""),
        (Boat(heading_deg=60.0, turns_to=0.0), ""),
        (Boat(heading_deg=60.0), "+60 deg off"),
        (Boat(modes=["HOLD"]), "mode HOLD, not GUIDED, after the fault"),
        (Boat(modes=["LOITER"], mode_before="LOITER", heading_deg=60.0), ""),
    ],
)
def test_mode_and_goal_are_checked_after_the_fault(boat, deviation):
    result = checks.behaves_as_before(boat, 95.0)
    assert result.startswith(deviation)
    assert bool(result) is bool(deviation)


def test_heading_that_only_crosses_the_goal_is_a_deviation():
    boat = Boat(heading_deg=-300.0, turns_to=300.0)
    assert boat.error_deg() == -300.0
    boat.run = lambda seconds: (setattr(boat, "now_s", boat.now_s + seconds), setattr(
        boat, "heading_deg", boat.heading_deg + 20.0 * seconds))  # fmt: skip
    assert "off the goal" in checks.behaves_as_before(boat, 95.0)


def test_early_recovery_is_a_deviation():
    calls = []
    check = checks.stays_active("right again", calls.append, 10.0)
    assert check(Boat(texts={"right again": 99.0}), 95.0) == ""
    assert check(Boat(texts={"right again": 111.0}), 95.0) == ""
    assert "reported after 4 s" in check(Boat(texts={"right again": 104.0}), 95.0)
    assert len(calls) == 3


def test_late_turn_to_the_next_leg_is_a_deviation():
    assert checks.reaches_heading(90.0, 100.0)(Boat(turns_to=90.0), 95.0) == ""
    assert "-90 deg off" in checks.reaches_heading(90.0, 100.0)(Boat(), 95.0)


def test_failsafe_without_action_or_override_is_a_deviation():
    class ObedientBoat(Boat):
        def set_mode(self, mode):
            super().set_mode(mode)
            self.modes.append("GUIDED")

    assert checks.operator_can_override(ObedientBoat(modes=["HOLD"]), 95.0) == ""
    assert checks.operator_can_override(Boat(modes=["HOLD"]), 95.0) == "mode HOLD, not GUIDED"
    assert checks.operator_can_override(Boat(modes=["GUIDED"]), 95.0) == "mode GUIDED, not HOLD"


def test_combined_checks_return_all_deviations():
    boat = Boat(final_rudder_deg=-29.0)
    deviations = checks.all_of(checks.was_centred_at_end, checks.has_mode("HOLD"), checks.has_mode("GUIDED"))(
        boat, 95.0
    )
    assert deviations == "rudder left at -29.0 deg; mode GUIDED, not HOLD"
    assert checks.is_also_reported("Heading source: compass B")(boat, 95.0)
    assert not checks.is_also_reported("Heading")(Boat(texts={"Heading": 96.0}), 95.0)


def test_rudder_beyond_its_limit_is_a_deviation():
    assert checks.was_within_limit(Boat(max_rudder_deg=30.4)) == ""
    assert "at 45.0 deg" in checks.was_within_limit(Boat(max_rudder_deg=45.0))
