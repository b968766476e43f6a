"""The live display, drawn to a string."""

import io

import pytest
from rich.console import Console

from hil.ship import scenarios
from hil.sim import live_display as live
from hil.sim.display import Banner, NoDisplay, make_display
from hil.sim.goals import parse_goals
from hil.sim.ground_station import GroundStation
from hil.sim.live_display import LiveDisplay, rose
from hil.sim.world import World


@pytest.fixture
def parts():
    goals = parse_goals("1:60")
    world = World(scenarios.find_scenario("calm"), 1, goals)
    banner = Banner("rambler-hil run calm", 100.0, ("udpin:[::1]:14550",), lockstep=False)
    return banner, world, GroundStation(goals)


def draw(display):
    console = Console(file=io.StringIO(), width=100)
    console.print(display.make_panel())
    return console.file.getvalue()


def test_display_shows_goal_error_time_and_texts(parts):
    banner, world, station = parts
    display = LiveDisplay(banner, world, station, Console(file=io.StringIO()))
    text = draw(display)
    assert "no goal yet" in text
    assert "no heartbeat yet" in text
    assert "udpin:[::1]:14550" in text
    station.texts.append((1.0, 2, "No heading [bold]"))
    world.advance_to(50.0)
    text = draw(display)
    assert "goal  60.0" in text
    assert "error  -60.0" in text
    assert "50 of 100 s" in text
    assert "No heading [bold]" in text


@pytest.mark.parametrize(
    ("heading_deg", "goal_deg", "column"), [(0.0, 0.0, 30), (350.0, 20.0, 40), (20.0, 350.0, 20), (0.0, 170.0, 60)]
)
def test_goal_mark_is_at_its_place_on_the_rose(heading_deg, goal_deg, column):
    plain = rose(heading_deg, goal_deg).plain
    assert len(plain) == 61
    assert plain[30] == "▲"
    assert plain[column] == ("▲" if column == 30 else "◆")


def test_points_are_at_their_places_on_the_rose():
    assert rose(0.0, None).plain.count("N") == 0  # replaced by the mark of the heading
    assert rose(30.0, None).plain[20] == "N"
    assert rose(360.0 + 60.0, None).plain[40] == "E"


def test_display_is_drawn_in_a_pause_after_the_interval(parts, monkeypatch):
    class Clock:
        now_s = 10.0

        def monotonic(self):
            return self.now_s

    clock = Clock()
    monkeypatch.setattr(live, "time", clock)
    display = LiveDisplay(*parts, Console(file=io.StringIO()))
    draw_times_s = []
    monkeypatch.setattr(display, "make_panel", lambda: draw_times_s.append(clock.now_s) or "")
    with display:
        display.update(0.001)
        display.update(0.05)
        display.update(0.05)
        clock.now_s += 0.21
        display.update()
    assert draw_times_s == [10.0, 10.21]


def test_pipe_has_no_display(parts, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdout", io.StringIO())
    with make_display(*parts) as display:
        assert isinstance(display, NoDisplay)
        display.update()
