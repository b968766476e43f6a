import io

import pytest

from hil.cli import progress


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


class Clock:
    """Seconds that the test moves on."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def told(stream, moments):
    """Tell of moments (seconds since the beginning, done, done since); return what was written."""
    clock = Clock()
    with progress.line(stream, clock) as tell:
        for t_s, done, since in moments:
            clock.now = 100.0 + t_s
            tell(done, 1000, since)
    return stream.getvalue()


def test_a_pipe_gets_a_line_now_and_then():
    text = told(io.StringIO(), [(1.0, 10, 10), (29.0, 20, 20), (31.0, 62, 40), (40.0, 70, 50), (62.0, 93, 71)])
    assert text == "62 of 1000 runs, 1 a second, 16 min left\n93 of 1000 runs, 1 a second, 15 min left\n"


def test_a_terminal_has_one_line_that_goes_in_the_end():
    text = told(Terminal(), [(1.0, 500, 10), (1.1, 501, 11), (2.0, 520, 20)])
    assert text == "\r\x1b[K500 of 1000 runs\r\x1b[K520 of 1000 runs, 10 a second, 48 s left\r\x1b[K"


def test_what_comes_before_the_first_runs_makes_them_no_slower():
    """A twin is compiled first: for a minute nothing is done."""
    text = told(io.StringIO(), [(60.0, 62, 62), (91.0, 682, 682)])
    assert text == "62 of 1000 runs\n682 of 1000 runs, 20 a second, 16 s left\n"


def test_a_line_says_which_was_the_last_and_is_never_wider_than_the_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    with progress.line(stream, Clock()) as tell:
        tell(0, 24, 0, "")
    assert stream.getvalue() == "\r\x1b[K0 of 24 runs\r\x1b[K"
    stream, clock = Terminal(), Clock()
    with progress.line(stream, clock) as tell:
        tell(0, 24, 0)
        clock.now += 10.0
        tell(5, 24, 5, "Rambler, swell, seed 2")
    assert stream.getvalue().endswith("\r\x1b[K5 of 24 runs, 0.5 a second, 38 s left; \r\x1b[K")


@pytest.mark.parametrize(("seconds", "text"), [(59.0, "59 s"), (60.0, "1 min"), (5400.0, "1.5 h")])
def test_a_time_has_the_unit_that_suits_it(seconds, text):
    assert progress._time(seconds) == text


def parts_told(stream, moments):
    """Tell of moments (seconds since the beginning, what, which part is over); return what was written."""
    clock = Clock()
    tell = progress.part_done(stream, clock)
    for t_s, what, part in moments:
        clock.now = 100.0 + t_s
        tell(what, part)
    return stream.getvalue()


def test_of_parts_a_pipe_hears_now_and_then_and_a_terminal_at_once():
    moments = [(1.0, "zigzag", 0.1), (31.0, "fish", 0.25), (40.0, "sea", 0.5), (62.0, "swell", 0.75), (99.0, "", 1.0)]
    assert parts_told(io.StringIO(), moments) == " 25 %  fish\n 75 %  swell\n"
    lines = parts_told(Terminal(), moments).split("\r\x1b[K")
    assert lines == ["", " 10 %  zigzag", " 25 %  fish", " 50 %  sea", " 75 %  swell", ""]
