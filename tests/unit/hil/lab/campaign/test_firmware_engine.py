"""Runs of a campaign with the autopilot process: repeated failures, early ends and options."""

import pytest

from hil.errors import HilError, UsageError
from hil.lab.campaign import firmware_engine
from hil.lab.campaign.row import Outcome, rows
from hil.sim import run_file, runner
from hil.sim.run_directory import TRUTH_FILE
from support.campaign import read

FINISHED, ENDED_EARLY, STALLED = (
    Outcome("a", None, ()),
    Outcome("b", None, (), "ended"),
    Outcome("c", None, (), "stalled"),
)


@pytest.mark.parametrize(
    ("outcomes", "accepted", "runs"),
    [
        ([FINISHED], FINISHED, 1),
        ([ENDED_EARLY, ENDED_EARLY], ENDED_EARLY, 2),
        ([STALLED, FINISHED], FINISHED, 2),  # high CPU load
        ([STALLED, ENDED_EARLY, ENDED_EARLY], ENDED_EARLY, 3),
    ],
)
def test_failure_is_accepted_if_it_repeats(monkeypatch, outcomes, accepted, runs):
    remaining = list(outcomes)
    monkeypatch.setattr(firmware_engine, "_simulate_without_log", lambda _row: remaining.pop(0))
    assert list(firmware_engine.simulate(rows(read(), 0, 1))) == [accepted]
    assert len(outcomes) - len(remaining) == runs


def test_run_that_ends_differently_each_time_raises(monkeypatch):
    number = iter(range(100))
    monkeypatch.setattr(
        firmware_engine, "_simulate_without_log", lambda _row: Outcome(str(next(number)), None, (), "stalled")
    )
    with pytest.raises(HilError, match="run 3: ends differently at each of 5 attempts, last: stalled"):
        list(firmware_engine.simulate(rows(read(), 3, 4)))


def test_reason_of_an_early_end_contains_no_paths(tmp_path, monkeypatch):
    def fail(options):
        options.out.mkdir()
        (options.out / run_file.NAME).write_text("{}")
        (options.out / TRUTH_FILE).write_text("time_s\n")
        raise HilError(f"goal 60 deg/h refused; see {options.out}/firmware.log; at 3.5 deg/s")

    monkeypatch.setattr(runner, "run", fail)
    outcome = firmware_engine.simulate_into(next(rows(read(), 0, 1)), tmp_path / "run", with_logs=False)
    assert outcome.ended == "goal 60 deg/h refused; see ...; at 3.5 deg/s"
    assert (outcome.scores, outcome.faults) == (None, ())


def test_run_that_cannot_start_has_no_outcome(tmp_path, monkeypatch):
    def refuse(_options):
        raise UsageError("no room")

    monkeypatch.setattr(runner, "run", refuse)
    with pytest.raises(UsageError, match="no room"):
        firmware_engine.simulate_into(next(rows(read(), 0, 1)), tmp_path / "run", with_logs=False)


def test_batch_runs_have_no_display_and_no_log_by_default(tmp_path, monkeypatch):
    options_seen = []

    def record_options(options):
        options_seen.append((options.settings.get("LOG_ENABLE"), options.live_display))
        raise UsageError("end")

    monkeypatch.setattr(runner, "run", record_options)
    default, logged = read(engine="firmware"), read(engine="firmware", set={"LOG_ENABLE": 1})
    for spec, with_logs in ((default, False), (logged, False), (default, True)):
        with pytest.raises(UsageError):
            firmware_engine.simulate_into(next(rows(spec, 0, 1)), tmp_path, with_logs=with_logs)
    assert options_seen == [(0.0, False), (1.0, False), (None, True)]
