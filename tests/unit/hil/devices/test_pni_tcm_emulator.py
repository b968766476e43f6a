import math
import struct

import fastcrc
import numpy as np
import pytest

from hil.devices.pni_tcm import PniTcmEmulator

GET_MOD_INFO = bytes.fromhex("000501EFD4")
GET_DATA = bytes.fromhex("000504BF71")
COMPONENTS = bytes.fromhex("000A0304051819 08DACC")
START = bytes.fromhex("000515BD61")
PUSH_TENTH = bytes.fromhex("000F180000000000003DCCCCCDF971")


def command(frame, payload=b""):
    """Frame with another CRC implementation than the emulator's."""
    head = (len(payload) + 5).to_bytes(2, "big") + bytes([frame]) + payload
    return head + fastcrc.crc16.xmodem(head).to_bytes(2, "big")


def frames(data):
    """Split a stream into (id, payload), insisting on every CRC."""
    found = []
    while data:
        count = int.from_bytes(data[:2], "big")
        assert fastcrc.crc16.xmodem(data[: count - 2]) == int.from_bytes(data[count - 2 : count], "big")
        found.append((data[2], data[3 : count - 2]))
        data = data[count:]
    return found


@pytest.fixture
def tcm(boat):
    return PniTcmEmulator(boat, np.random.default_rng(1), noise_deg=0.0, tilt_noise_deg=0.0)


@pytest.fixture
def ask(run):
    def answer(device, data, now_s=1.0):
        device.receive(now_s, data)
        return frames(b"".join(output for _, output in run(device, now_s + 0.05)))

    return answer


def test_module_info(tcm, run):
    tcm.receive(1.0, GET_MOD_INFO)
    ((due_s, data),) = run(tcm, 2.0)
    assert data == bytes.fromhex("000D0254434D3531323038C787")
    assert due_s > 1.0 + 13 * 10 / 38400


def test_no_output_without_a_request(tcm, run):
    assert tcm.next_output_s() == math.inf
    assert run(tcm, 100.0) == []


def test_order_of_components(tcm, ask):
    tcm.pitch_deg, tcm.roll_deg, tcm.distorted = 3.0, -4.5, True
    assert ask(tcm, COMPONENTS) == []
    ((frame, payload),) = ask(tcm, GET_DATA)
    assert frame == 5
    assert payload[0] == 4
    assert struct.unpack(">BfBfBfBB", payload[1:]) == pytest.approx((5, 98.3, 24, 3.0, 25, -4.5, 8, 1))
    ask(tcm, command(3, bytes([2, 25, 5])))
    ((_, payload),) = ask(tcm, GET_DATA)
    assert struct.unpack(">BBfBf", payload) == pytest.approx((2, 25, -4.5, 5, 98.3))


def test_all_components(tcm, ask):
    ids = [5, 7, 8, 9, 21, 22, 23, 24, 25, 27, 28, 29]
    ask(tcm, command(3, bytes([len(ids), *ids])))
    ((_, payload),) = ask(tcm, GET_DATA)
    values = struct.unpack(">B" + "".join("BB" if i in (8, 9) else "Bf" for i in ids), payload)
    assert list(values[1::2]) == ids
    assert math.degrees(math.atan2(-values[22], values[20])) == pytest.approx(98.3, abs=1.0)


def test_continuous_output_needs_mode_components_and_start(tcm, run):
    for message in (PUSH_TENTH, COMPONENTS):
        tcm.receive(1.0, message)
    assert frames(b"".join(data for _, data in run(tcm, 2.0))) == [(26, b"")]
    tcm.receive(3.0, START)
    output = run(tcm, 4.05)
    assert len(output) == 10
    assert np.diff([due_s for due_s, _ in output]) == pytest.approx(0.1)
    assert {frame for _, data in output for frame, _ in frames(data)} == {5}
    tcm.receive(5.0, command(22))
    run(tcm, 5.0)
    assert tcm.next_output_s() == math.inf


def test_no_continuous_output_in_polled_mode(tcm, run):
    for message in (command(24, struct.pack(">BBff", 1, 0, 0.0, 0.1)), COMPONENTS, START):
        tcm.receive(1.0, message)
    assert frames(b"".join(data for _, data in run(tcm, 3.0))) == [(26, b"")]


def test_push_mode_of_later_manuals(boat, run):
    tcm = PniTcmEmulator(boat, np.random.default_rng(1), push_mode=1)
    for message in (command(24, struct.pack(">BBff", 1, 0, 0.0, 0.1)), COMPONENTS, START):
        tcm.receive(1.0, message)
    assert len(run(tcm, 2.05)) == 11


def test_true_north(boat, ask):
    tcm = PniTcmEmulator(boat, np.random.default_rng(1), noise_deg=0.0, declination_deg=12.0)
    ask(tcm, command(3, bytes([1, 5])))

    def heading():
        return struct.unpack(">f", ask(tcm, GET_DATA)[0][1][2:])[0]

    assert heading() == pytest.approx(86.3)
    assert ask(tcm, command(6, b"\x01" + struct.pack(">f", 10.0))) == [(19, b"")]
    assert heading() == pytest.approx(86.3)
    assert ask(tcm, command(6, b"\x02\x01")) == [(19, b"")]
    assert heading() == pytest.approx(96.3)
    assert ask(tcm, command(7, b"\x01")) == [(8, b"\x01" + struct.pack(">f", 10.0))]


def test_mils(boat, ask):
    tcm = PniTcmEmulator(boat, np.random.default_rng(1), noise_deg=0.0, declination_deg=12.0)
    ask(tcm, command(3, bytes([1, 5])))
    assert ask(tcm, command(6, b"\x0f\x01")) == [(19, b"")]
    assert struct.unpack(">f", ask(tcm, GET_DATA)[0][1][2:])[0] == pytest.approx(86.3 * 6400 / 360)


def test_little_endian_numbers(tcm, ask):
    ask(tcm, command(3, bytes([1, 5])))
    assert ask(tcm, command(6, b"\x06\x00")) == [(19, b"")]
    ((_, payload),) = ask(tcm, GET_DATA)
    assert struct.unpack("<f", payload[2:])[0] == pytest.approx(98.3)


@pytest.mark.parametrize(
    "bad",
    [
        GET_MOD_INFO[:-1] + b"\x00",  # CRC
        command(99),  # unknown frame
        command(3, bytes([2, 5])),  # wrong count
        command(3, bytes([1, 99])),  # unknown component
        command(6, b"\x01" + struct.pack(">f", math.nan)),
        command(6, b"\x01" + struct.pack(">f", 1e30)),
        command(6, b"\x02\x07"),  # a boolean must be 0 or 1
        command(24, struct.pack(">BBff", 0, 0, 0.0, -1.0)),
        command(24, struct.pack(">BBff", 0, 0, 0.0, math.inf)),
        command(24, b"\x00"),
        command(1, b"x"),
        b"\xff" * 200,
    ],
)
def test_invalid_frames_are_ignored(tcm, ask, bad):
    assert ask(tcm, bad) == []
    assert ask(tcm, GET_MOD_INFO, now_s=2.0)[0][0] == 2


def test_frame_in_pieces_and_after_garbage(tcm, ask):
    for at in range(len(GET_MOD_INFO) - 1):
        tcm.receive(1.0 + at * 1e-3, GET_MOD_INFO[at : at + 1])
    assert ask(tcm, GET_MOD_INFO[-1:], now_s=1.005)[0][0] == 2
    assert ask(tcm, b"\x37\xff\xff" + GET_MOD_INFO, now_s=2.0)[0][0] == 2
    # Garbage that looks like a byte count of 255 swallows one frame; a pause on the line ends that.
    assert ask(tcm, b"\x00\xff" + GET_MOD_INFO, now_s=3.0) == []
    assert ask(tcm, GET_MOD_INFO, now_s=4.0)[0][0] == 2


def test_power_cycle_without_saving(tcm, ask, run):
    for message in (PUSH_TENTH, COMPONENTS, START):
        tcm.receive(1.0, message)
    assert run(tcm, 2.0)
    tcm.power_cycle(2.0, off_s=1.0)
    assert tcm.next_output_s() == math.inf
    assert ask(tcm, GET_MOD_INFO, now_s=2.5) == []  # off
    assert ask(tcm, GET_MOD_INFO, now_s=3.1) == []  # booting
    assert ask(tcm, GET_DATA, now_s=4.0) == [(5, b"\x00")]


def test_power_cycle_after_saving(tcm, ask, run):
    for message in (PUSH_TENTH, COMPONENTS, START):
        tcm.receive(1.0, message)
    tcm.receive(1.0, command(9))
    assert (16, b"\x00\x00") in frames(b"".join(data for _, data in run(tcm, 1.5)))
    tcm.power_cycle(2.0, off_s=1.0)
    output = run(tcm, 5.0)
    assert output[0][0] > 3.3
    assert len(output) == 16


def test_sleep_and_wake_up(tcm, ask, run):
    assert ask(tcm, command(15)) == [(28, b"")]
    tcm.receive(5.0, GET_MOD_INFO)
    output = b"".join(data for _, data in run(tcm, 6.0))
    assert output[:1] == b"\x00"
    assert frames(output[1:]) == [(23, b"")]
    assert ask(tcm, GET_MOD_INFO, now_s=7.0)[0][0] == 2


def test_a_seed_repeats_the_output(boat, run):
    def talk(seed):
        tcm = PniTcmEmulator(boat, np.random.default_rng(seed))
        for message in (PUSH_TENTH, COMPONENTS, START):
            tcm.receive(1.0, message)
        return run(tcm, 4.0)

    assert talk(1) == talk(1)
    assert talk(1) != talk(2)
