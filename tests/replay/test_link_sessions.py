"""The link sends the recorded numbers: telemetry of voyages, and replies to every command with usual and odd numbers.

Texts are not compared, nor fields and kinds of messages that only one of the two has: a new message or named value
changes no session. After an intended change, run link_sessions.py.
"""

import gzip
import json
import math

import pytest

from replay.link_sessions import LINKS, SESSIONS


def by_kind(lines):
    """Return the lines by the kind of the message: its name, and that of a named value, or the number of a command."""
    kinds = {}
    for t_s, fields in lines:
        details = (fields.get(name) for name in ("mavpackettype", "intent", "command", "name", "param_id"))
        kinds.setdefault(tuple(map(str, details)), []).append([t_s, fields])
    return kinds


def is_same(one, other):
    if isinstance(one, dict) and isinstance(other, dict):
        return all(is_same(one[name], other[name]) for name in one.keys() & other.keys())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(is_same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-7)
    return one == other


@pytest.mark.parametrize("name", SESSIONS)
def test_link_sends_the_recorded_messages(name):
    text = gzip.decompress((LINKS / f"{name}.jsonl.gz").read_bytes())
    recorded = by_kind(json.loads(line) for line in text.splitlines())
    sent = by_kind(json.loads(json.dumps(SESSIONS[name]())))
    for kind, lines in recorded.items():
        for one, other in zip(lines, sent.get(kind, ()), strict=False):
            assert is_same(one, other), f"recorded {one}, sent {other}"
        assert len(sent.get(kind, ())) == len(lines), kind
