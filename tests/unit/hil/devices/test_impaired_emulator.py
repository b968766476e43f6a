import numpy as np
import pytest

from hil.devices.impairment import Impaired


class Device:
    """An emulator that outputs a list of messages."""

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
def device():
    return Device()


def impair(device, seed=1, **options):
    return Impaired(device, np.random.default_rng(seed), **options)


def test_bytes_are_unchanged_by_default(device):
    device.output = [b"hello", b""]
    line = impair(device)
    line.receive(0.0, b"abc")
    assert (device.received, line.next_output_s()) == (b"abc", 0.5)
    assert [line.take_output(1.0), line.take_output(2.0)] == [b"hello", b""]


@pytest.mark.parametrize(
    ("option", "low", "high"), [("drop", 8800, 9200), ("duplicate", 10_800, 11_200), ("flip", 10_000, 10_000)]
)
def test_bytes_are_changed_with_their_probability(device, option, low, high):
    device.output = [bytes(10_000)]
    line = impair(device, **{option: 0.1})
    line.receive(0.0, bytes(10_000))
    output = line.take_output(0.0)
    assert low <= len(output) <= high
    assert low <= len(device.received) <= high
    flipped = sum(byte != 0 for byte in output)
    assert all(byte.bit_count() <= 1 for byte in output)
    assert 800 < flipped < 1200 if option == "flip" else flipped == 0


def test_garbage_is_inserted_before_messages(device):
    device.output = [b"message"] * 200
    line = impair(device, garbage=0.5)
    output = [line.take_output(0.0) for _ in range(200)]
    assert all(data.endswith(b"message") and len(data) <= 7 + 16 for data in output)
    assert 60 < sum(len(data) > 7 for data in output) < 140


def test_line_is_silent_deaf_and_frozen_by_switch_and_span(device):
    device.output = [b"1", b"2", b"3", b"4", b"5", b"6", b"7"]
    line = impair(device, silent_spans=[(10.0, 11.0)], deaf_spans=[(10.0, 11.0)], frozen_spans=[(20.0, 21.0)])
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
    assert device.received == b"z"


def test_seed_determines_the_impairment(device):
    device.output = [bytes(range(256))] * 15
    output = []
    for seed in (3, 3, 4):
        line = impair(device, seed, drop=0.1, flip=0.1, duplicate=0.1, garbage=0.5)
        output.append([line.take_output(0.0) for _ in range(5)])
    assert output[0] == output[1] != output[2]
