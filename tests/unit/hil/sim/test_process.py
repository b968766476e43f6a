"""AutopilotProcess with a Python script in place of the autopilot."""

import sys

import pytest

from hil.sim import process as module
from hil.sim.process import AutopilotProcess


@pytest.fixture
def script(tmp_path, monkeypatch):
    """Replace the interpreter by one that runs a given script instead of the autopilot."""

    def write(text):
        path = tmp_path / "interpreter"
        path.write_text(f"#!{sys.executable}\n{text}\n")
        path.chmod(0o755)
        monkeypatch.setattr(module.sys, "executable", str(path))
        return tmp_path / "log"

    return write


def test_exit_code_and_last_output_are_those_of_the_process(script):
    log = script("import sys\nprint('one')\nprint('no compass', file=sys.stderr)\nsys.exit(3)")
    with AutopilotProcess([], log) as process:
        assert process.wait(10.0)
        assert process.exit_code() == 3
        assert not process.running()
        assert "no compass" in process.last_output()
        assert "\n" not in process.last_output()


def test_process_that_ignores_sigterm_is_killed(script, monkeypatch):
    monkeypatch.setattr(module, "END_TIMEOUT_S", 0.1)
    log = script(
        "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\nprint('up', flush=True)\ntime.sleep(60)"
    )
    with AutopilotProcess([], log) as process:
        while not process.last_output():
            assert process.running()
        process.terminate()
        assert not process.wait(0.1)
    assert not process.running()
    assert process.exit_code() == -9


def test_interrupt_during_a_poll_does_not_block_the_end(script):
    """An interrupt within Popen.poll can leave its lock locked."""
    log = script("import time\ntime.sleep(60)")

    def interrupt_poll(frame, event, called):
        if event == "c_return" and called.__name__ in {"acquire", "waitid"}:
            sys.setprofile(None)
            raise KeyboardInterrupt

    with AutopilotProcess([], log) as process:
        sys.setprofile(interrupt_poll)
        try:
            with pytest.raises(KeyboardInterrupt):
                process.running()
        finally:
            sys.setprofile(None)
        process.kill()
        assert process.exit_code() == -9
