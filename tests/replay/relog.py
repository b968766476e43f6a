"""Recompute the logs of data/ after a change of the control law: same inputs, new outputs and states.

.venv/bin/python tests/replay/relog.py
"""

import gzip
import tempfile
from pathlib import Path

from firmware_py.core.state_codec import state_from_text, state_to_text
from firmware_py.core.step import step
from firmware_py.log.reader import LogReader
from firmware_py.log.recorder import LogRecorder

DATA = Path(__file__).parent / "data"
UTC_S = 1767225600.0  # for a log without time of a fix


def recompute_log(log: bytes) -> tuple[bytes, int, tuple[str, ...]]:
    """Return the recomputed log, the number of changed rudder commands, and notes on its first state."""
    reader, changed_count = LogReader(log), 0
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
            state_before = state
            state, output = step(state_before, tick.inputs)
            changed_count += output.command != tick.command
            recorder.offer(tick.inputs, output, lambda state_before=state_before: state_to_text(state_before))
        recorder.close()
        (path,) = Path(folder).glob("*.BIN")
        return path.read_bytes(), changed_count, notes


if __name__ == "__main__":
    for path in sorted(DATA.glob("*.BIN")):
        log, changed_count, notes = recompute_log(path.read_bytes())
        if changed_count or notes:
            path.write_bytes(log)
        print(f"{path.name}: {changed_count} rudder commands changed", *notes, sep="\n  ")
    for path in sorted((DATA / "voyages").glob("*.BIN.gz")):
        log, changed_count, notes = recompute_log(gzip.decompress(path.read_bytes()))
        path.write_bytes(gzip.compress(log, mtime=0))
        print(f"{path.name}: {changed_count} rudder commands changed", *notes, sep="\n  ")
