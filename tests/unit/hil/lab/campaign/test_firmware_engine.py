import pytest

from hil.errors import HilError, UsageError
from hil.lab.campaign import firmware_engine
from hil.lab.campaign.outcome import Outcome
from hil.lab.campaign.row import rows
from hil.sim import run_file, runner
from hil.sim.run_directory import TRUTH_FILE
from support.campaign import read

DONE, SANK, STALLED = Outcome("a", None, ()), Outcome("b", None, (), "she sank"), Outcome("c", None, (), "stalled")


@pytest.mark.parametrize(
    ("comes", "believed", "sailed"),
    [
        ([DONE], DONE, 1),
        ([SANK, SANK], SANK, 2),  # so it is
        ([STALLED, DONE], DONE, 2),  # a busy machine
        ([STALLED, SANK, SANK], SANK, 3),
    ],
)
def test_a_failure_is_believed_when_it_comes_again(monkeypatch, comes, believed, sailed):
    left = list(comes)
    monkeypatch.setattr(firmware_engine, "_sailed_unlogged", lambda _row: left.pop(0))
    assert list(firmware_engine.sail(rows(read(), 0, 1))) == [believed]
    assert len(comes) - len(left) == sailed


def test_a_run_that_ends_differently_each_time_ends_the_campaign(monkeypatch):
    number = iter(range(100))
    monkeypatch.setattr(
        firmware_engine, "_sailed_unlogged", lambda _row: Outcome(str(next(number)), None, (), "stalled")
    )
    with pytest.raises(HilError, match="run 3 ends differently each time: stalled"):
        list(firmware_engine.sail(rows(read(), 3, 4)))


def test_what_ended_a_run_names_no_place_of_this_computer(tmp_path, monkeypatch):
    def fail(options):
        options.out.mkdir()
        (options.out / run_file.NAME).write_text("{}")
        (options.out / TRUTH_FILE).write_text("time_s\n")
        raise HilError(f"goal 60 deg/h refused; see {options.out}/firmware.log; at 3.5 deg/s")

    monkeypatch.setattr(runner, "run", fail)
    found = firmware_engine.sail_into(next(rows(read(), 0, 1)), tmp_path / "run", full=False)
    assert found.ended == "goal 60 deg/h refused; see ...; at 3.5 deg/s"
    assert (found.scores, found.faults) == (None, ())


def test_a_run_that_cannot_begin_is_no_outcome(tmp_path, monkeypatch):
    def refuse(_options):
        raise UsageError("no room")

    monkeypatch.setattr(runner, "run", refuse)
    with pytest.raises(UsageError, match="no room"):
        firmware_engine.sail_into(next(rows(read(), 0, 1)), tmp_path / "run", full=False)


def test_among_others_a_run_shows_nothing_and_writes_no_log_unless_it_is_asked_for(tmp_path, monkeypatch):
    seen = []

    def note(options):
        seen.append((options.settings.get("LOG_ENABLE"), options.shown))
        raise UsageError("enough")

    monkeypatch.setattr(runner, "run", note)
    plain, logged = read(engine="firmware"), read(engine="firmware", set={"LOG_ENABLE": 1})
    for spec, full in ((plain, False), (logged, False), (plain, True)):
        with pytest.raises(UsageError):
            firmware_engine.sail_into(next(rows(spec, 0, 1)), tmp_path, full=full)
    assert seen == [(0.0, False), (1.0, False), (None, True)]
