"""The bare limits, each a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from hil.errors import HilError

MARGIN_S = 30.0


def answer_of(arguments: Sequence[str], seconds: float) -> Any:
    """Run Python with arguments for about so long and return the JSON that it prints, or raise HilError."""
    command = [sys.executable, *arguments]
    try:
        done = subprocess.run(command, capture_output=True, check=True, timeout=seconds + MARGIN_S)
        return json.loads(done.stdout)
    except subprocess.CalledProcessError as error:
        lines = error.stderr.decode(errors="replace").splitlines() or ["it says nothing"]
        raise HilError(f"a helper of the bench failed: {' '.join(arguments[:2])[:60]}: {lines[-1]}") from None
    except subprocess.TimeoutExpired:
        raise HilError(f"a helper of the bench hangs: {' '.join(arguments[:2])[:60]}") from None


@contextmanager
def background(*arguments: str) -> Iterator[tuple[int, str]]:
    """Keep Python running with arguments; yields its process number and the first line that it prints."""
    process = subprocess.Popen([sys.executable, *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE)
    try:
        if process.stdout is None:
            raise HilError("a helper of the bench has no output")
        line = process.stdout.readline().decode().strip()
        if not line:
            raise HilError(f"a helper of the bench failed: {' '.join(arguments[:2])[:60]}")
        yield process.pid, line
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()
