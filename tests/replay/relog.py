"""Compute the logs of data/ again where a changed law gives other rudder commands: same inputs, new outputs and states.

.venv/bin/python tests/replay/relog.py
"""

import tempfile
from pathlib import Path

from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.log.reader import LogReader
from firmware_py.log.recorder import LogRecorder

DATA = Path(__file__).parent / "data"
UTC_S = 1767225600.0  # of a log without a fix that has the time


def relogged(log: bytes) -> tuple[bytes, int, tuple[str, ...]]:
    """Return a log computed again, how many rudder commands have changed, and notes on its first state."""
    reader, changed = LogReader(log), 0
    ticks = list(reader)
    state, notes = state_from_text(ticks[0].checkpoint)
    utc_s = next((fix.utc_s for tick in ticks for fix in tick.inputs.positions if fix.utc_s), UTC_S)
    with tempfile.TemporaryDirectory() as folder:
        recorder = LogRecorder(
            Path(folder),
            parameters=state.parameters,
            plans=state.plans,
            file_bytes=1 << 26,
            max_total_bytes=1 << 28,
            utc_s=utc_s,
            software=reader.reading.software,
            background=False,
        )
        for tick in ticks:
            before = state
            state, output = step(before, tick.inputs)
            changed += output.command != tick.command
            recorder.offer(tick.inputs, output, lambda before=before: state_to_text(before))
        recorder.close()
        (path,) = Path(folder).glob("*.BIN")
        return path.read_bytes(), changed, notes


if __name__ == "__main__":
    for path in sorted(DATA.glob("*.BIN")):
        log, changed, notes = relogged(path.read_bytes())
        if changed or notes:
            path.write_bytes(log)
        print(f"{path.name}: {changed} rudder commands changed", *notes, sep="\n  ")
