"""The link sends the recorded numbers: telemetry of voyages, and replies to every command with usual and odd numbers.

Texts are not compared, nor fields that only one of the two has. After an intended change, run link_sessions.py.
"""

import gzip
import json
import math

import pytest

from replay.link_sessions import LINKS, SESSIONS


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
    recorded = [json.loads(line) for line in gzip.decompress((LINKS / f"{name}.jsonl.gz").read_bytes()).splitlines()]
    sent = json.loads(json.dumps(SESSIONS[name]()))
    for number, (one, other) in enumerate(zip(recorded, sent, strict=False)):
        assert is_same(one, other), f"line {number + 1}: {one}, sent {other}"
    assert len(sent) == len(recorded)
