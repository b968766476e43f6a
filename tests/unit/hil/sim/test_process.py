"""The autopilot's process, with Python itself in its place."""

import sys

import pytest

from hil.sim import process as module
from hil.sim.process import AutopilotProcess


@pytest.fixture
def script(tmp_path, monkeypatch):
    """A stand-in for the interpreter that runs a given script instead of the autopilot."""

    def write(text):
        path = tmp_path / "stand_in"
        path.write_text(f"#!{sys.executable}\n{text}\n")
        path.chmod(0o755)
        monkeypatch.setattr(module.sys, "executable", str(path))
        return tmp_path / "log"

    return write


def test_last_words_and_exit_code_of_one_that_dies(script):
    log = script("import sys\nprint('one')\nprint('no compass', file=sys.stderr)\nsys.exit(3)")
    with AutopilotProcess([], log) as process:
        assert process.wait(10.0)
        assert process.exit_code() == 3
        assert not process.running()
        assert "no compass" in process.last_words()
        assert "\n" not in process.last_words()


def test_nothing_is_left_behind_even_when_it_will_not_go(script, monkeypatch):
    monkeypatch.setattr(module, "GRACE_S", 0.1)
    log = script(
        "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('up', flush=True)\ntime.sleep(60)"
    )
    with AutopilotProcess([], log) as process:
        while not process.last_words():
            assert process.running()
        process.terminate()
        assert not process.wait(0.1)
    assert not process.running()
    assert process.exit_code() == -9


def test_an_interrupt_while_one_looks_for_the_end_does_not_hang_the_end(script):
    """Whoever is interrupted inside of Popen.poll may leave its lock taken: one run in thousands never ended."""
    log = script("import time\ntime.sleep(60)")

    def look_until_interrupted(frame, event, called):
        if event == "c_return" and called.__name__ in {"acquire", "waitid"}:
            sys.setprofile(None)
            raise KeyboardInterrupt

    with AutopilotProcess([], log) as process:
        sys.setprofile(look_until_interrupted)
        try:
            with pytest.raises(KeyboardInterrupt):
                process.running()
        finally:
            sys.setprofile(None)
        process.kill()
        assert process.exit_code() == -9
