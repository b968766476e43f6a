"""Record of the ends of runs: saved at the start, after the first minute and at the end; reports at the next start."""

from types import SimpleNamespace

import pytest

from firmware_py.assemble.supervision import Supervision, read_endings
from firmware_py.common.records import Event, Severity
from firmware_py.system.endings import Ending, Endings, from_bytes, to_bytes
from firmware_py.system.watchdogs import WatchdogError


class Run:
    """The parts of a run that starts at 5 s."""

    def __init__(self, *, notices=(), hardware=None, wait=False):
        self.saved, self.printed, self.ticks, self.notices = [], [], [], list(notices)
        self.parts = SimpleNamespace(
            store=SimpleNamespace(save=lambda name, content: self.saved.append((name, from_bytes(content)[0]))),
            notices=self.notices,
            after_tick=lambda _output, now_s: self.ticks.append(now_s),
            clock=SimpleNamespace(now_s=lambda: 5.0),
            watchdogs=None,
        )
        self.supervision = Supervision(self.parts, Endings(), self.printed.append, {}, hardware, wait=wait)

    @property
    def states(self):
        return [(ending.running, ending.is_young, ending.failed) for _, ending in self.saved]


def test_run_is_young_for_its_first_minute_and_ends_regularly():
    run = Run()
    for now_s, saved in ((64.75, 1), (65.0, 2), (66.0, 2)):
        run.parts.after_tick(None, now_s)
        assert len(run.saved) == saved
    run.supervision.end(restart=False)
    assert {name for name, _ in run.saved} == {"endings.record"}
    assert run.states == [(True, True, False), (True, False, False), (False, False, False)]
    assert run.ticks == [64.75, 65.0, 66.0]
    assert run.parts.watchdogs is not None


def test_reason_of_an_error_is_recorded(monkeypatch):
    reasons = []
    recorder = SimpleNamespace(record_reason=reasons.append)
    monkeypatch.setattr("firmware_py.assemble.supervision.EndingRecorder", lambda _directory: recorder)
    run = Run()
    run.supervision.end_with_error("ValueError: math domain error")
    assert run.states == [(True, True, False), (True, True, True)]
    assert reasons == ["ValueError: math domain error"]


def test_unexpected_end_is_printed_and_a_missing_watchdog_reported(tmp_path):
    restarted = Event(Severity.WARNING, "Started again: cut off (the first time)")
    with pytest.raises(WatchdogError):
        Run(hardware=tmp_path / "none")
    run = Run(notices=[Event(Severity.WARNING, "other"), restarted], hardware=tmp_path / "none", wait=True)
    (note,) = run.notices[2:]
    assert note.severity is Severity.WARNING
    assert note.text.startswith(f"watchdog {tmp_path}/none: ")
    assert run.printed == [restarted.text, note.text]


@pytest.mark.parametrize(
    ("content", "count", "texts"),
    [
        (None, 0, []),
        (to_bytes(Endings()), 0, []),
        (to_bytes(Endings(running=True)), 1, ["Started again: cut off (the first time)"]),
        (to_bytes(Endings({"cut off": 1}, running=True)), 2, ["Started again: cut off (2 times so far)"]),
        (b"rubbish", 0, ["stored endings.record ignored: "]),
    ],
)
def test_end_without_a_record_is_reported_as_cut_off(content, count, texts):
    notices = []
    endings = read_endings(SimpleNamespace(load=lambda _name: content), None, 1.7e9, notices)
    assert (endings.running, endings.counts.get("cut off", 0)) == (False, count)
    assert endings.last == (Ending("cut off", "", 1.7e9),) * bool(texts and count)
    assert [event.text[: len(text)] for event, text in zip(notices, texts, strict=True)] == texts


@pytest.mark.parametrize(
    ("line", "texts"), [("1 success exited 0", []), ("2 watchdog killed ABRT", ["Started again: "])]
)
def test_only_unexpected_ends_are_reported(tmp_path, line, texts):
    (tmp_path / "ended").write_text(line + "\n")
    notices = []
    endings = read_endings(
        SimpleNamespace(load=lambda _name: to_bytes(Endings(running=True))), tmp_path, 1.7e9, notices
    )
    assert len(endings.last) == 1
    assert [event.text[:15] for event in notices] == texts
