import numpy as np
import pytest

from hil.devices.impairment import Impaired


class Talker:
    """Says what it is given, once."""

    def __init__(self):
        self.received = b""
        self.output = []

    def receive(self, now_s, data):
        self.received += data

    def next_output_s(self):
        return 0.5

    def take_output(self, now_s):
        return self.output.pop(0) if self.output else b""


@pytest.fixture
def talker():
    return Talker()


def behind(talker, seed=1, **options):
    return Impaired(talker, np.random.default_rng(seed), **options)


def test_no_change_by_default(talker):
    talker.output = [b"hello", b""]
    line = behind(talker)
    line.receive(0.0, b"abc")
    assert (talker.received, line.next_output_s(), line.take_output(1.0), line.take_output(2.0)) == (
        b"abc", 0.5, b"hello", b"",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("option", "low", "high"),
    [("drop", 8800, 9200), ("duplicate", 10_800, 11_200), ("flip", 10_000, 10_000)],
)
def test_probabilities_per_byte(talker, option, low, high):
    talker.output = [bytes(10_000)]
    line = behind(talker, **{option: 0.1})
    line.receive(0.0, bytes(10_000))
    out = line.take_output(0.0)
    assert low <= len(out) <= high
    assert low <= len(talker.received) <= high
    flipped = sum(byte != 0 for byte in out)
    assert all(byte.bit_count() <= 1 for byte in out)
    assert 800 < flipped < 1200 if option == "flip" else flipped == 0


def test_garbage_before_messages(talker):
    talker.output = [b"message"] * 200
    out = [behind_output for line in [behind(talker, garbage=0.5)] for _ in range(200)
           for behind_output in [line.take_output(0.0)]]  # fmt: skip
    assert all(data.endswith(b"message") and len(data) <= 7 + 16 for data in out)
    assert 60 < sum(len(data) > 7 for data in out) < 140


def test_silent_deaf_and_frozen(talker):
    talker.output = [b"1", b"2", b"3", b"4", b"5", b"6", b"7"]
    line = behind(talker, silent_spans=[(10.0, 11.0)], deaf_spans=[(10.0, 11.0)], frozen_spans=[(20.0, 21.0)])
    assert line.take_output(0.0) == b"1"
    line.frozen = True
    assert line.take_output(1.0) == b"1"
    line.frozen = False
    line.silent = True
    assert line.take_output(2.0) == b""
    line.silent = False
    assert line.take_output(10.5) == b""
    assert line.take_output(11.0) == b"5"
    assert line.take_output(20.0) == b"5"
    assert line.take_output(21.0) == b"7"
    line.receive(10.5, b"x")
    line.deaf = True
    line.receive(30.0, b"y")
    line.deaf = False
    line.receive(31.0, b"z")
    assert talker.received == b"z"


def test_a_seed_repeats_the_impairment():
    def spoiled(seed):
        talker = Talker()
        talker.output = [bytes(range(256))] * 5
        line = behind(talker, seed, drop=0.1, flip=0.1, duplicate=0.1, garbage=0.5)
        return [line.take_output(0.0) for _ in range(5)]

    assert spoiled(3) == spoiled(3)
    assert spoiled(3) != spoiled(4)
