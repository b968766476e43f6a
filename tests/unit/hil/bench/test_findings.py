"""How spreads in seconds become the figures that are printed."""

import pytest

from hil.bench import lateness, load, lockstep, sense, start, trips
from hil.bench.process import Memory
from hil.bench.spread import Spread

OURS = Spread(100, 0.001, 0.002, 0.003, 0.004, 0.005)
BARE = Spread(100, 0.0001, 0.0002, 0.0003, 0.0004, 0.0005)


def rows(figures):
    return {figure.name: (figure.value, figure.bare, figure.unit) for figure in figures}


def test_lateness_is_told_in_microseconds():
    assert rows(lateness.figures_of(50, OURS, BARE)) == {
        "50 Hz, p50": (pytest.approx(1000.0), pytest.approx(100.0), "us"),
        "50 Hz, p99": (pytest.approx(3000.0), pytest.approx(300.0), "us"),
        "50 Hz, p99.9": (pytest.approx(4000.0), pytest.approx(400.0), "us"),
        "50 Hz, max": (pytest.approx(5000.0), pytest.approx(500.0), "us"),
    }


def test_the_way_to_the_servo_has_its_two_aims():
    figures = sense.figures_of(Spread(1, 0.0049, 0.006, 0, 0, 0), Spread(1, 0.0006, 0.0007, 0, 0, 0), BARE)
    assert rows(figures)["computing path, p50"] == (pytest.approx(600.0), pytest.approx(100.0), "us")
    assert rows(figures)["whole path, p95"] == (pytest.approx(6.0), pytest.approx(0.2), "ms")
    assert [figure.met for figure in figures] == [False, None, True, None]


def test_load_has_its_three_aims():
    figures = load.figures_of((0.014, 0.021), Memory(61.0, 62.0), 0.0005, Memory(8.0, 9.0))
    assert rows(figures)["CPU at 10 Hz"] == (pytest.approx(2.1), pytest.approx(0.05), "% of a core")
    assert rows(figures)["CPU at 10 Hz, one link"] == (pytest.approx(1.4), pytest.approx(0.05), "% of a core")
    assert [figure.met for figure in figures] == [False, True, False, None]


def test_lockstep_is_told_by_the_medians_of_its_speeds():
    figures = lockstep.figures_of([100.0, 160.0, 170.0], [99.0, 40.0, 300.0])
    assert [(figure.value, figure.met) for figure in figures] == [(160.0, True), (99.0, False)]


def test_starts_are_told_by_their_median():
    frame, heartbeat = start.figures_of([0.4, 3.0, 0.5], [0.4, 0.3, 9.0], [0.02, 0.01, 0.03])
    assert (frame.value, frame.bare, frame.met) == (0.5, 0.02, True)
    assert (heartbeat.value, heartbeat.met) == (0.4, None)


def test_round_trips_have_their_aim():
    figures = trips.figures_of(OURS, OURS, BARE, BARE)
    assert rows(figures)["PARAM_SET, p50"] == (pytest.approx(1.0), pytest.approx(0.2), "ms")
    assert rows(figures)["COMMAND_LONG, p50"] == (pytest.approx(1.0), pytest.approx(0.1), "ms")
    assert [figure.met for figure in figures] == [True, None, True, None]


def test_only_the_answer_to_a_question_is_taken_for_it():
    message, answers = trips.parameter_question(1)
    other, _ = trips.parameter_question(0)
    assert message.param_value != other.param_value

    class Reply:
        param_id, param_value, command = trips.PARAMETER, message.param_value, trips.dialect.MAV_CMD_DO_SET_MODE

        def __init__(self, kind, **fields):
            self.kind = kind
            self.__dict__.update(fields)

        def get_type(self):
            return self.kind

    assert answers(Reply("PARAM_VALUE"))
    assert not answers(Reply("PARAM_VALUE", param_value=other.param_value))
    assert not answers(Reply("PARAM_VALUE", param_id="CTL_K1"))
    _, acknowledged = trips.command_question(0)
    assert acknowledged(Reply("COMMAND_ACK"))
    assert not acknowledged(Reply("COMMAND_ACK", command=1))
    assert not acknowledged(Reply("HEARTBEAT"))
