"""What is looked at on a boat that something was broken on, on a boat of which every move is written down."""

import pytest

from hil.lab.drill import checks


class Boat:
    """Turns by a degree a second toward `turns_to`; says what `says` has at its time, and is in the last `modes`."""

    def __init__(self, **what):
        self.now_s, self.goal_s, self.goal_deg, self.heading_deg = 100.0, 90.0, 0.0, 0.0
        self.turns_to, self.says, self.modes, self.mode_before = None, {}, ["GUIDED"], "GUIDED"
        self.rested_deg = self.farthest_deg = 0.0
        self.orders, self.by_track = [], False
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

    def steers_by_track(self):
        return self.by_track

    def said(self, text, since_s):
        at_s = self.says.get(text)
        return at_s if at_s is not None and since_s <= at_s <= self.now_s else None

    def until(self, text, within_s, since_s):
        while self.said(text, since_s) is None and self.now_s < since_s + within_s:
            self.run(0.5)
        return self.said(text, since_s)

    def steer(self, goal_deg):
        self.orders.append(goal_deg)

    def set_mode(self, mode):
        self.orders.append(mode)


@pytest.mark.parametrize(
    ("off_deg", "by_track", "wrong"), [(20.0, False, True), (20.0, True, False), (40.0, True, True)]
)
def test_by_the_track_a_boat_steers_less_exactly_than_by_a_compass(off_deg, by_track, wrong):
    assert bool(checks.on_course(Boat(heading_deg=off_deg, by_track=by_track), 95.0)) is wrong


@pytest.mark.parametrize(
    ("boat", "wrong"),
    [
        (Boat(), ""),
        (Boat(heading_deg=60.0, turns_to=0.0), ""),
        (Boat(heading_deg=60.0), "+60 deg off"),
        (Boat(modes=["HOLD"]), "mode HOLD, not GUIDED, after it was over"),
        (Boat(modes=["LOITER"], mode_before="LOITER", heading_deg=60.0), ""),
    ],
)
def test_once_it_is_over_she_does_again_what_she_did_before(boat, wrong):
    found = checks.as_before(boat, 95.0)
    assert found.startswith(wrong)
    assert bool(found) is bool(wrong)


def test_she_who_only_swings_across_her_goal_is_not_back_on_it():
    boat = Boat(heading_deg=-300.0, turns_to=300.0)
    assert boat.error_deg() == -300.0
    boat.run = lambda seconds: (setattr(boat, "now_s", boat.now_s + seconds), setattr(
        boat, "heading_deg", boat.heading_deg + 20.0 * seconds))  # fmt: skip
    assert "off her goal" in checks.as_before(boat, 95.0)


def test_what_is_nearly_over_is_not_told_as_over():
    done = []
    check = checks.not_over("right again", done.append, 10.0)
    assert check(Boat(says={"right again": 99.0}), 95.0) == ""
    assert check(Boat(says={"right again": 111.0}), 95.0) == ""
    assert "told 4 s after" in check(Boat(says={"right again": 104.0}), 95.0)
    assert len(done) == 3


def test_the_next_leg_is_come_to_in_time():
    assert checks.turns_to(90.0, 100.0)(Boat(turns_to=90.0), 95.0) == ""
    assert "-90 deg off" in checks.turns_to(90.0, 100.0)(Boat(), 95.0)


def test_a_failsafe_must_have_acted_and_the_operator_s_order_stands():
    class Obeying(Boat):
        def set_mode(self, mode):
            super().set_mode(mode)
            self.modes.append("GUIDED")

    assert checks.obeyed(Obeying(modes=["HOLD"]), 95.0) == ""
    assert checks.obeyed(Boat(modes=["HOLD"]), 95.0) == "mode HOLD, not GUIDED"
    assert checks.obeyed(Boat(modes=["GUIDED"]), 95.0) == "mode GUIDED, not HOLD"


def test_several_things_are_looked_at_and_each_wrong_one_is_told():
    boat = Boat(rested_deg=-29.0)
    told = checks.both(checks.rested, checks.in_mode("HOLD"), checks.in_mode("GUIDED"))(boat, 95.0)
    assert told == "rudder left at -29.0 deg; mode GUIDED, not HOLD"
    assert checks.said_besides("Heading from compass B")(boat, 95.0)
    assert not checks.said_besides("Heading")(Boat(says={"Heading": 96.0}), 95.0)


def test_the_rudder_stays_within_its_limit():
    assert checks.within_limit(Boat(farthest_deg=30.4)) == ""
    assert "at 45.0 deg" in checks.within_limit(Boat(farthest_deg=45.0))
