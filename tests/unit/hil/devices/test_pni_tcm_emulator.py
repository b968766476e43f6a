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
EVERY_TENTH = bytes.fromhex("000F180000000000003DCCCCCDF971")


def command(frame, payload=b""):
    """Encode a frame with another CRC implementation than the emulator's."""
    body = (len(payload) + 5).to_bytes(2, "big") + bytes([frame]) + payload
    return body + fastcrc.crc16.xmodem(body).to_bytes(2, "big")


def frames(data):
    """Split a stream into (id, payload) and check the CRCs."""
    parsed = []
    while data:
        count = int.from_bytes(data[:2], "big")
        assert fastcrc.crc16.xmodem(data[: count - 2]) == int.from_bytes(data[count - 2 : count], "big")
        parsed.append((data[2], data[3 : count - 2]))
        data = data[count:]
    return parsed


@pytest.fixture
def tcm(boat):
    return PniTcmEmulator(boat, np.random.default_rng(1), noise_deg=0.0, tilt_noise_deg=0.0)


@pytest.fixture
def ask(run):
    def exchange(device, data, now_s=1.0):
        device.receive(now_s, data)
        return frames(b"".join(output for _, output in run(device, now_s + 0.05)))

    return exchange


def start(tcm, *messages):
    for message in messages or (EVERY_TENTH, COMPONENTS, START):
        tcm.receive(1.0, message)


def test_module_info_is_that_of_the_manual(tcm, run):
    tcm.receive(1.0, GET_MOD_INFO)
    ((due_s, data),) = run(tcm, 2.0)
    assert data == bytes.fromhex("000D0254434D3531323038C787")
    assert due_s > 1.0 + 13 * 10 / 38400


def test_components_are_in_the_requested_order(tcm, ask, run):
    assert tcm.next_output_s() == math.inf

    tcm.pitch_deg, tcm.roll_deg, tcm.distorted = 3.0, -4.5, True
    assert ask(tcm, COMPONENTS) == []
    ((frame, payload),) = ask(tcm, GET_DATA)
    assert frame == 5
    assert payload[0] == 4
    assert struct.unpack(">BfBfBfBB", payload[1:]) == pytest.approx((5, 98.3, 24, 3.0, 25, -4.5, 8, 1))
    ask(tcm, command(3, bytes([2, 25, 5])))
    ((_, payload),) = ask(tcm, GET_DATA)
    assert struct.unpack(">BBfBf", payload) == pytest.approx((2, 25, -4.5, 5, 98.3))


def test_all_components_are_supported(tcm, ask):
    ids = [5, 7, 8, 9, 21, 22, 23, 24, 25, 27, 28, 29]
    ask(tcm, command(3, bytes([len(ids), *ids])))
    ((_, payload),) = ask(tcm, GET_DATA)
    values = struct.unpack(">B" + "".join("BB" if i in (8, 9) else "Bf" for i in ids), payload)
    assert list(values[1::2]) == ids
    assert math.degrees(math.atan2(-values[22], values[20])) == pytest.approx(98.3, abs=1.0)


def test_continuous_output_needs_mode_components_and_start(tcm, run):
    start(tcm, EVERY_TENTH, COMPONENTS)
    assert frames(b"".join(data for _, data in run(tcm, 2.0))) == [(26, b"")]
    tcm.receive(3.0, START)
    output = run(tcm, 4.05)
    assert len(output) == 10
    assert np.diff([due_s for due_s, _ in output]) == pytest.approx(0.1)
    assert {frame for _, data in output for frame, _ in frames(data)} == {5}
    tcm.receive(5.0, command(22))
    run(tcm, 5.0)
    assert tcm.next_output_s() == math.inf


@pytest.mark.parametrize(("push_mode", "count"), [(0, 1), (1, 11)])
def test_acquisition_mode_1_is_continuous_in_later_manuals_only(boat, run, push_mode, count):
    tcm = PniTcmEmulator(boat, np.random.default_rng(1), push_mode=push_mode)
    start(tcm, command(24, struct.pack(">BBff", 1, 0, 0.0, 0.1)), COMPONENTS, START)
    assert len(run(tcm, 2.05)) == count


@pytest.fixture
def magnetic(boat):
    return PniTcmEmulator(boat, np.random.default_rng(1), noise_deg=0.0, declination_deg=12.0)


def test_declination_is_added_for_true_north_only(magnetic, ask):
    tcm = magnetic
    ask(tcm, command(3, bytes([1, 5])))

    def heading():
        return struct.unpack(">f", ask(tcm, GET_DATA)[0][1][2:])[0]

    assert heading() == pytest.approx(86.3)
    assert ask(tcm, command(6, b"\x01" + struct.pack(">f", 10.0))) == [(19, b"")]
    assert heading() == pytest.approx(86.3)
    assert ask(tcm, command(6, b"\x02\x01")) == [(19, b"")]
    assert heading() == pytest.approx(96.3)
    assert ask(tcm, command(7, b"\x01")) == [(8, b"\x01" + struct.pack(">f", 10.0))]


@pytest.mark.parametrize(
    ("setting", "code", "heading"),
    [(b"\x0f\x01", ">f", 86.3 * 6400 / 360), (b"\x06\x00", "<f", 86.3)],
    ids=["mils", "little-endian"],
)
def test_heading_has_the_configured_format(magnetic, ask, setting, code, heading):
    ask(magnetic, command(3, bytes([1, 5])))
    assert ask(magnetic, command(6, setting)) == [(19, b"")]
    assert struct.unpack(code, ask(magnetic, GET_DATA)[0][1][2:])[0] == pytest.approx(heading)


@pytest.mark.parametrize(
    "data",
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
def test_invalid_frames_are_ignored(tcm, ask, data):
    assert ask(tcm, data) == []
    assert ask(tcm, GET_MOD_INFO, now_s=2.0)[0][0] == 2


def test_frame_in_pieces_or_after_garbage_has_a_reply(tcm, ask):
    for index in range(len(GET_MOD_INFO) - 1):
        tcm.receive(1.0 + index * 1e-3, GET_MOD_INFO[index : index + 1])
    assert ask(tcm, GET_MOD_INFO[-1:], now_s=1.005)[0][0] == 2
    assert ask(tcm, b"\x37\xff\xff" + GET_MOD_INFO, now_s=2.0)[0][0] == 2
    # A byte count of 255 in the garbage includes the next frame, until a pause on the line.
    assert ask(tcm, b"\x00\xff" + GET_MOD_INFO, now_s=3.0) == []
    assert ask(tcm, GET_MOD_INFO, now_s=4.0)[0][0] == 2


def test_power_cycle_without_saving_restores_the_settings(tcm, ask, run):
    start(tcm)
    assert run(tcm, 2.0)
    tcm.power_cycle(2.0, off_s=1.0)
    assert tcm.next_output_s() == math.inf
    assert ask(tcm, GET_MOD_INFO, now_s=2.5) == []  # off
    assert ask(tcm, GET_MOD_INFO, now_s=3.1) == []  # booting
    assert ask(tcm, GET_DATA, now_s=4.0) == [(5, b"\x00")]


def test_power_cycle_after_saving_keeps_the_settings(tcm, ask, run):
    start(tcm)
    tcm.receive(1.0, command(9))
    assert (16, b"\x00\x00") in frames(b"".join(data for _, data in run(tcm, 1.5)))
    tcm.power_cycle(2.0, off_s=1.0)
    output = run(tcm, 5.0)
    assert output[0][0] > 3.3
    assert len(output) == 16


def test_sleeping_module_wakes_up_on_any_byte(tcm, ask, run):
    assert ask(tcm, command(15)) == [(28, b"")]
    tcm.receive(5.0, GET_MOD_INFO)
    output = b"".join(data for _, data in run(tcm, 6.0))
    assert output[:1] == b"\x00"
    assert frames(output[1:]) == [(23, b"")]
    assert ask(tcm, GET_MOD_INFO, now_s=7.0)[0][0] == 2


def test_seed_determines_the_output(boat, run):
    output = []
    for seed in (1, 1, 2):
        start(tcm := PniTcmEmulator(boat, np.random.default_rng(seed)))
        output.append(run(tcm, 4.0))
    assert output[0] == output[1] != output[2]
