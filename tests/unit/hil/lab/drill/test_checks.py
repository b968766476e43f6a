"""Checks of the drills, on a scripted boat."""

import pytest

from hil.lab.drill import checks


class Boat:
    """Turns by 1 deg/s toward `turns_to`; sends the `texts` at their times, and is in the last of its `modes`."""

    def __init__(self, **what):
        self.now_s, self.goal_s, self.goal_deg, self.heading_deg = 100.0, 90.0, 0.0, 0.0
        self.turns_to, self.texts, self.modes, self.mode_before = None, {}, ["GUIDED"], "GUIDED"
        self.final_rudder_deg = self.max_rudder_deg = 0.0
        self.orders, self.by_course = [], False
        for name, value in what.items():
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

    def until(self, text, within_s, since_s):
        while self.report_time(text, since_s) is None and self.now_s < since_s + within_s:
            self.run(0.5)
        return self.report_time(text, since_s)

    def steer(self, goal_deg):
        self.orders.append(goal_deg)

    def set_mode(self, mode):
        self.orders.append(mode)


@pytest.mark.parametrize(
    ("off_deg", "by_course", "wrong"), [(20.0, False, True), (20.0, True, False), (40.0, True, True)]
)
def test_the_limit_on_course_depends_on_the_heading_source(off_deg, by_course, wrong):
    assert bool(checks.on_course(Boat(heading_deg=off_deg, by_course=by_course), 95.0)) is wrong


@pytest.mark.parametrize(
    ("boat", "wrong"),
    [
        (Boat(), ""),
        (Boat(heading_deg=60.0, turns_to=0.0), ""),
        (Boat(heading_deg=60.0), "+60 deg off"),
        (Boat(modes=["HOLD"]), "mode HOLD, not GUIDED, after the fault"),
        (Boat(modes=["LOITER"], mode_before="LOITER", heading_deg=60.0), ""),
    ],
)
def test_mode_and_goal_after_the_fault(boat, wrong):
    found = checks.as_before(boat, 95.0)
    assert found.startswith(wrong)
    assert bool(found) is bool(wrong)


def test_a_heading_that_only_crosses_the_goal_has_not_returned_to_it():
    boat = Boat(heading_deg=-300.0, turns_to=300.0)
    assert boat.error_deg() == -300.0
    boat.run = lambda seconds: (setattr(boat, "now_s", boat.now_s + seconds), setattr(
        boat, "heading_deg", boat.heading_deg + 20.0 * seconds))  # fmt: skip
    assert "off the goal" in checks.as_before(boat, 95.0)


def test_an_early_recovery_is_a_deviation():
    done = []
    check = checks.not_over("right again", done.append, 10.0)
    assert check(Boat(texts={"right again": 99.0}), 95.0) == ""
    assert check(Boat(texts={"right again": 111.0}), 95.0) == ""
    assert "reported after 4 s" in check(Boat(texts={"right again": 104.0}), 95.0)
    assert len(done) == 3


def test_the_next_leg_is_reached_in_time():
    assert checks.turns_to(90.0, 100.0)(Boat(turns_to=90.0), 95.0) == ""
    assert "-90 deg off" in checks.turns_to(90.0, 100.0)(Boat(), 95.0)


def test_a_failsafe_acts_and_the_operator_overrides_it():
    class Obeying(Boat):
        def set_mode(self, mode):
            super().set_mode(mode)
            self.modes.append("GUIDED")

    assert checks.operator_overrides(Obeying(modes=["HOLD"]), 95.0) == ""
    assert checks.operator_overrides(Boat(modes=["HOLD"]), 95.0) == "mode HOLD, not GUIDED"
    assert checks.operator_overrides(Boat(modes=["GUIDED"]), 95.0) == "mode GUIDED, not HOLD"


def test_combined_checks_return_all_deviations():
    boat = Boat(final_rudder_deg=-29.0)
    deviations = checks.both(checks.centred_at_end, checks.in_mode("HOLD"), checks.in_mode("GUIDED"))(boat, 95.0)
    assert deviations == "rudder left at -29.0 deg; mode GUIDED, not HOLD"
    assert checks.also_reported("Heading source: compass B")(boat, 95.0)
    assert not checks.also_reported("Heading")(Boat(texts={"Heading": 96.0}), 95.0)


def test_the_rudder_stays_within_its_limit():
    assert checks.within_limit(Boat(max_rudder_deg=30.4)) == ""
    assert "at 45.0 deg" in checks.within_limit(Boat(max_rudder_deg=45.0))
