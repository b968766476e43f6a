import io

import pytest

from hil.cli import progress


class Terminal(io.StringIO):
    """A stream with isatty."""

    def isatty(self):
        return True


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


def output_of(stream, reports):
    """Make reports (seconds since the start, done, done now); return the output."""
    clock = Clock()
    with progress.progress_line(stream, clock) as report:
        for t_s, done, done_now in reports:
            clock.now = 100.0 + t_s
            report(done, 1000, done_now)
    return stream.getvalue()


def test_pipe_gets_a_line_each_30_s():
    text = output_of(io.StringIO(), [(1.0, 10, 10), (29.0, 20, 20), (31.0, 62, 40), (40.0, 70, 50), (62.0, 93, 71)])
    assert text == "62 of 1000 runs, 1 a second, 16 min left\n93 of 1000 runs, 1 a second, 15 min left\n"


def test_terminal_gets_one_line_that_is_rewritten():
    text = output_of(Terminal(), [(1.0, 500, 10), (1.1, 501, 11), (2.0, 520, 20)])
    assert text == "\r\x1b[K500 of 1000 runs\r\x1b[K520 of 1000 runs, 10 a second, 48 s left\r\x1b[K"


def test_rate_is_measured_from_the_first_report():
    text = output_of(io.StringIO(), [(60.0, 62, 62), (91.0, 682, 682)])
    assert text == "62 of 1000 runs\n682 of 1000 runs, 20 a second, 16 s left\n"


def test_line_is_truncated_to_the_width_of_the_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    stream = Terminal()
    with progress.progress_line(stream, Clock()) as report:
        report(0, 24, 0, "")
    assert stream.getvalue() == "\r\x1b[K0 of 24 runs\r\x1b[K"
    stream, clock = Terminal(), Clock()
    with progress.progress_line(stream, clock) as report:
        report(0, 24, 0)
        clock.now += 10.0
        report(5, 24, 5, "Rambler, swell, seed 2")
    assert stream.getvalue().endswith("\r\x1b[K5 of 24 runs, 0.5 a second, 38 s left; \r\x1b[K")


@pytest.mark.parametrize(("seconds", "text"), [(59.0, "59 s"), (60.0, "1 min"), (5400.0, "1.5 h")])
def test_remaining_time_has_suitable_units(seconds, text):
    assert progress._format_duration(seconds) == text


def output_of_tasks(stream, reports):
    """Make reports (seconds since the start, task, fraction); return the output."""
    clock = Clock()
    report = progress.task_progress(stream, clock)
    for t_s, task, fraction in reports:
        clock.now = 100.0 + t_s
        report(task, fraction)
    return stream.getvalue()


def test_progress_of_tasks_is_a_percentage():
    reports = [(1.0, "zigzag", 0.1), (31.0, "fish", 0.25), (40.0, "sea", 0.5), (62.0, "swell", 0.75), (99.0, "", 1.0)]
    assert output_of_tasks(io.StringIO(), reports) == " 25 %  fish\n 75 %  swell\n"
    lines = output_of_tasks(Terminal(), reports).split("\r\x1b[K")
    assert lines == ["", " 10 %  zigzag", " 25 %  fish", " 50 %  sea", " 75 %  swell", ""]
