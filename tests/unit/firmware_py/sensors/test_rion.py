"""RION and BWSENSING compasses: frames of the manuals and of real devices, requests, automatic output, recovery."""

import itertools
import math

import numpy as np
import pytest

from firmware_py.common.records import DeviceState, NorthReference
from firmware_py.devices import decode
from firmware_py.sensors.rion import RionCompass, RionOptions
from hil.devices.rion import RionEmulator

REQUEST_68, REQUEST_77 = bytes.fromhex("68 04 00 04 08"), bytes.fromhex("77 04 00 04 08")
DECLINATION_68 = bytes.fromhex("68 04 00 07 0B")
NO_DECLINATION = bytes.fromhex("68 06 00 87 00 00 8D")

# Frames of the manuals of HCM705B and HCM370B and of real compasses: of PAMGuard's RION test (HCM508B), and of public
# code for a DDM350B and another RION compass. Pitch, roll, heading.
FRAMES = {
    "68 0D 00 84 00 20 10 10 05 25 01 80 00 7C": (20.10, -5.25, 180.00),
    "68 0D 00 84 00 10 50 10 10 05 01 04 01 1C": (10.50, -10.05, 104.01),
    "68 0D 00 84 10 02 87 10 00 85 01 59 22 3B": (-2.87, -0.85, 159.22),
    "68 0D 00 84 00 00 32 10 00 44 03 31 26 71": (0.32, -0.44, 331.26),
    "68 0D 00 84 10 26 80 00 33 65 03 13 71 66": (-26.80, 33.65, 313.71),
    "68 0E 00 84 00 10 50 10 10 05 01 04 01 00 1D": (10.50, -10.05, 104.01),
}


def frame(body, identifier=0x68):
    """Return a frame from its hexadecimal bytes between the identifier and the sum."""
    data = bytes.fromhex(body)
    return bytes([identifier]) + data + bytes([sum(data) % 256])


def angles(heading="00 98 50", *, pitch="00 01 50", roll="10 02 50", status="", identifier=0x68, address="00"):
    size = "0E" if status else "0D"
    return frame(f"{size} {address} 84 {pitch} {roll} {heading} {status}", identifier)


def listening(line, **options):
    """Return a driver that has listened for 0.5 s."""
    compass = RionCompass(line, RionOptions(**options))
    compass.receive(-0.5)
    assert line.written == []
    return compass


@pytest.fixture
def compass(line):
    return listening(line)


@pytest.fixture
def exchange(line):
    """Function that delivers frames to a driver at a time and returns its requests."""

    def exchange(driver, now_s, *frames):
        sent = len(line.written)
        line.inbox += b"".join(frames)
        driver.receive(now_s)
        return line.written[sent:]

    return exchange


@pytest.fixture
def ready(exchange, compass):
    """A compass that has received its first heading at 0.1 s."""
    assert exchange(compass, 0.0) == [REQUEST_68]
    assert exchange(compass, 0.02, angles()) == [DECLINATION_68]
    assert exchange(compass, 0.04, NO_DECLINATION) == [REQUEST_68]
    assert exchange(compass, 0.06, angles()) == []
    assert len(compass.poll()) == 1
    return compass


@pytest.mark.parametrize("text", FRAMES)
def test_documented_frame_has_its_angles(text, ready, exchange, near):
    exchange(ready, 0.2, bytes.fromhex(text))
    (sample,) = ready.poll()
    pitch_deg, roll_deg, heading_deg = FRAMES[text]
    assert math.degrees(sample.heading_rad) == pytest.approx(heading_deg, abs=1e-9)
    assert near(sample.pitch_rad, pitch_deg)
    assert near(sample.roll_rad, roll_deg)
    assert (sample.t_s, sample.reference, sample.variation_rad) == (0.2, NorthReference.MAGNETIC, None)
    assert (sample.yaw_rate_rad_s, sample.temperature_c) == (None, None)


def test_angles_are_requested_at_the_rate(line, ready, exchange):
    times_s = []
    for millisecond in range(60, 1060):
        now_s = millisecond / 1000
        if exchange(ready, now_s) == [REQUEST_68]:
            times_s.append(now_s)
            line.inbox += angles()
    assert len(times_s) == 10
    assert all(later - earlier == pytest.approx(0.1, abs=0.003) for earlier, later in itertools.pairwise(times_s))


def test_request_without_a_reply_is_repeated_after_a_timeout(ready, exchange):
    assert exchange(ready, 0.14) == [REQUEST_68]
    assert [exchange(ready, now_s) for now_s in (0.2, 0.43, 0.45)] == [[], [], [REQUEST_68]]


def test_identifier_is_that_of_the_compass(line, compass, exchange):
    assert exchange(compass, 0.0) == [REQUEST_68]
    assert exchange(compass, 0.31) == [REQUEST_77]
    assert exchange(compass, 0.62) == [REQUEST_68]
    assert exchange(compass, 0.93) == [REQUEST_77]
    assert exchange(compass, 0.95, angles(identifier=0x77)) == [bytes.fromhex("77 04 00 07 0B")]
    assert exchange(compass, 1.0, frame("06 00 87 00 00", 0x77)) == [REQUEST_77]
    exchange(compass, 1.02, angles(identifier=0x77))
    assert len(compass.poll()) == 1
    assert [exchange(compass, now_s) for now_s in (1.11, 1.42)] == [[REQUEST_77], [REQUEST_77]]


def test_driver_listens_and_tries_both_identifiers_after_six_missing_replies(ready, exchange):
    requests = [request for step in range(230) for request in exchange(ready, 0.1 + step / 100)]
    assert requests == [REQUEST_68] * 6
    assert [exchange(ready, now_s) for now_s in (2.4, 2.5, 2.81)] == [[], [REQUEST_68], [REQUEST_77]]


@pytest.mark.parametrize(
    ("options", "request_text", "reply"),
    [
        ({"identifier": "77"}, "77 04 00 04 08", angles(identifier=0x77)),
        ({"identifier": "68", "address": 5}, "68 04 05 04 0D", angles(address="05")),
    ],
)
def test_frames_of_other_devices_are_not_used(line, exchange, options, request_text, reply):
    compass = listening(line, **options)
    assert exchange(compass, 0.0) == [bytes.fromhex(request_text)]
    assert exchange(compass, 0.31, angles(identifier=0x68, address="00")) == [bytes.fromhex(request_text)]
    assert compass.health(0.31).text == "compass 68 with address 0: not that of the vehicle file"
    assert exchange(compass, 0.35, reply) != []  # the declination
    assert (compass.health(0.35).state, compass.health(0.35).text) == (
        DeviceState.STARTING, "connected, no heading yet",
    )  # fmt: skip


def test_set_declination_makes_the_headings_true(compass, exchange, near):
    exchange(compass, 0.0)
    exchange(compass, 0.02, angles())
    exchange(compass, 0.04, bytes.fromhex("68 06 00 87 02 08 97"))  # the example of the manual: +20.8 degrees
    exchange(compass, 0.06, angles())
    (sample,) = compass.poll()
    assert sample.reference is NorthReference.TRUE
    assert near(sample.variation_rad, 20.8)
    assert near(sample.heading_rad, 98.5)


def test_late_reply_with_the_declination_is_used_and_sends_no_request(ready, exchange, near):
    assert exchange(ready, 0.14) == [REQUEST_68]
    assert exchange(ready, 0.15, bytes.fromhex("68 06 00 87 02 08 97")) == []
    exchange(ready, 0.16, angles())
    assert near(ready.poll()[0].variation_rad, 20.8)


def test_negative_declination(compass, exchange, near):
    exchange(compass, 0.0)
    exchange(compass, 0.02, angles())
    exchange(compass, 0.04, frame("06 00 87 10 35"))
    exchange(compass, 0.06, angles())
    assert near(compass.poll()[0].variation_rad, -3.5)


@pytest.mark.parametrize(
    ("digits", "text"),
    [
        ("09 00", ""),
        ("09 01", "declination 90.1 out of range"),
        ("19 01", "declination -90.1 out of range"),
        ("0A 00", "declination is not a decimal number"),
    ],
)
def test_impossible_declination_is_rejected(compass, exchange, digits, text):
    exchange(compass, 0.0)
    exchange(compass, 0.02, angles())
    exchange(compass, 0.04, frame(f"06 00 87 {digits}"))
    assert (compass.health(0.04).text if text else compass.health(0.04).rejected) == (text or 0)


def test_compass_without_a_reply_about_its_declination_is_used_after_three_requests(line, compass, exchange):
    requests = []
    for step in range(200):
        now_s = step / 100
        new = exchange(compass, now_s)
        requests += new
        line.inbox += angles() if REQUEST_68 in new else b""
    assert requests.count(DECLINATION_68) == 3
    assert len(compass.poll()) >= 8


def test_automatic_output_is_read_without_requests(line, compass, exchange):
    requests = []
    for step in range(500):
        line.inbox += angles() if step % 20 == 0 else b""
        requests += exchange(compass, -0.4 + step / 100)
    assert requests == [DECLINATION_68] * 3
    assert len(compass.poll()) == 19
    # The output ends: requests begin again after 1.5 s.
    assert [exchange(compass, now_s) for now_s in (5.89, 5.91, 6.22)] == [[], [REQUEST_68], [REQUEST_68]]
    assert exchange(compass, 6.25, angles()) == []
    assert exchange(compass, 6.33) == [REQUEST_68]


def test_rare_automatic_output_is_read_without_requests_of_angles(line, compass, exchange):
    requests = []
    for step in range(500):
        line.inbox += angles() if step % 100 == 0 else b""
        requests += exchange(compass, -0.4 + step / 100)
    assert requests == [DECLINATION_68] * 3


def test_only_the_declination_is_requested_of_a_compass_with_automatic_output(line, compass, exchange):
    requests = []
    for step in range(200):
        line.inbox += angles() if step % 20 == 19 else b""
        sent = exchange(compass, -0.4 + step / 100)
        line.inbox += NO_DECLINATION if sent else b""
        requests += sent
    assert requests == [DECLINATION_68]
    assert len(compass.poll()) == 8


def test_output_that_begins_later_ends_the_requests(ready, exchange):
    frames = (b"", angles(), angles())
    requests = [exchange(ready, 0.1 + step / 100, frames[step % 3]) for step in range(100)]
    assert requests[-50:] == [[]] * 50


def test_third_angle_without_a_request_within_two_and_a_half_seconds_shows_automatic_output(line, exchange, ready):
    def poll_for(start_s, seconds, *frames):
        """Reply to all requests from a time on, after the frames; return their number."""
        count = 0
        line.inbox += b"".join(frames)
        for step in range(round(seconds * 100)):
            if exchange(ready, start_s + step / 100) == [REQUEST_68]:
                count += 1
                line.inbox += angles()
        return count

    assert poll_for(0.1, 1.0, angles()) in (10, 11)
    assert poll_for(1.1, 2.7, angles()) in (26, 27, 28)  # the second
    assert poll_for(3.8, 1.0, angles()) in (9, 10, 11)  # the first is forgotten
    assert poll_for(4.8, 1.0, angles()) in (9, 10, 11)
    assert poll_for(5.8, 1.0, angles()) == 0


def test_late_replies_do_not_stop_the_requests(ready, exchange):
    assert exchange(ready, 0.14) == [REQUEST_68]
    assert exchange(ready, 0.45) == [REQUEST_68]
    assert exchange(ready, 0.46, angles()) == []
    assert exchange(ready, 0.47, angles()) == []
    assert exchange(ready, 0.56) == [REQUEST_68]


@pytest.mark.parametrize(
    ("status", "state", "text", "count"),
    [
        ("00", DeviceState.RUNNING, "", 1),
        ("F6", DeviceState.RUNNING, "", 1),
        ("01", DeviceState.FAULTY, "magnetic field distorted", 1),
        ("08", DeviceState.FAULTY, "gyroscope out of range", 0),
        ("09", DeviceState.FAULTY, "gyroscope out of range", 0),
    ],
)
def test_status_of_the_long_frame(ready, exchange, status, state, text, count):
    exchange(ready, 0.2, angles(status=status))
    assert len(ready.poll()) == count
    assert (ready.health(0.2).state, ready.health(0.2).text) == (state, text)
    exchange(ready, 0.3, angles())
    assert ready.health(0.3).state is DeviceState.RUNNING


@pytest.mark.parametrize(
    ("frame_data", "text"),
    [
        (angles("0A 98 50"), "heading is not a decimal number"),
        (angles("20 98 50"), "heading is not a decimal number"),
        (angles("10 00 01"), "heading -0.01 out of range"),
        (angles("03 60 01"), "heading 360.01 out of range"),
        (angles(pitch="00 90 01"), "pitch 90.01 out of range"),
        (angles(pitch="10 90 01"), "pitch -90.01 out of range"),
        (angles(roll="01 80 01"), "roll 180.01 out of range"),
        (angles(roll="11 80 01"), "roll -180.01 out of range"),
        (angles(roll="00 0F 00"), "roll is not a decimal number"),
    ],
)
def test_impossible_angles_are_rejected(ready, exchange, frame_data, text):
    accepted = ready.health(0.1).accepted
    exchange(ready, 0.2, frame_data)
    assert ready.poll() == ()
    health = ready.health(0.2)
    assert (health.accepted, health.rejected, health.text) == (accepted, 1, text)


def test_wrong_sum_is_counted(ready, exchange):
    exchange(ready, 0.2, angles()[:-1] + bytes([angles()[-1] ^ 1]), angles())
    assert len(ready.poll()) == 1
    assert (ready.health(0.2).rejected, ready.health(0.2).text) == (1, "checksum")


def test_hundreds_of_a_negative_angle(ready, exchange, near):
    exchange(ready, 0.2, angles(roll="11 20 50"))
    assert near(ready.poll()[0].roll_rad, -120.5)


def test_limits_of_the_ranges_are_accepted(ready, exchange):
    exchange(ready, 0.2, angles("03 60 00"), angles("00 00 00"), angles(roll="11 80 00"))
    headings_rad = [sample.heading_rad for sample in ready.poll()]
    assert len(headings_rad) == 3
    assert all(0.0 <= heading_rad < 2 * math.pi for heading_rad in headings_rad)
    assert min(headings_rad[0], 2 * math.pi - headings_rad[0]) < 1e-9


def test_reopened_port_starts_again(line, ready, exchange):
    line.inbox += angles()[:6]
    ready.receive(0.2)
    line.unplug()
    ready.receive(0.3)
    assert ready.health(0.3).state is DeviceState.ABSENT
    line.plug()
    assert exchange(ready, 5.0, angles()[6:]) == []
    assert exchange(ready, 5.51) == [REQUEST_68]
    assert ready.poll() == ()
    assert ready.health(5.0).state is DeviceState.STARTING


def test_silent_compass_is_reported_and_recovers_when_its_power_returns(ready, exchange):
    for step in range(1, 100):
        exchange(ready, step / 10)
    assert ready.health(10.0).state is DeviceState.SILENT
    for step in range(100, 130):
        requests = exchange(ready, step / 10)
        exchange(
            ready, step / 10 + 0.05, *(NO_DECLINATION if item == DECLINATION_68 else angles() for item in requests)
        )
    assert len(ready.poll()) > 10
    assert ready.health(13.0).state is DeviceState.RUNNING


@pytest.mark.parametrize(("rate_hz", "timeout_s"), [(0.5, 6.0), (20.0, 2.0)])
def test_compass_is_silent_after_three_periods_and_at_least_two_seconds(line, exchange, rate_hz, timeout_s):
    compass = listening(line, rate_hz=rate_hz)
    for now_s, reply in ((0.0, b""), (0.02, angles()), (0.04, NO_DECLINATION), (1.0, angles())):
        exchange(compass, now_s, reply)
    states = [compass.health(1.0 + timeout_s + late_s).state for late_s in (-0.01, 0.01)]
    assert states == [DeviceState.RUNNING, DeviceState.SILENT]


def test_full_line_is_tried_again(line, ready, exchange):
    line.full = True
    assert exchange(ready, 0.2) == []
    line.full = False
    assert exchange(ready, 0.51) == [REQUEST_68]


def test_vertical_boat_has_no_heading(line, exchange):
    compass = listening(line, mounting="roll_90")
    exchange(compass, 0.0)
    exchange(compass, 0.02, angles(roll="00 90 00"))
    exchange(compass, 0.04, NO_DECLINATION)
    exchange(compass, 0.06, angles(roll="00 90 00"))
    assert math.degrees(compass.poll()[0].roll_rad) == pytest.approx(0.0, abs=1e-9)
    exchange(compass, 0.2, angles(pitch="00 85 00"))
    assert compass.poll() == ()
    assert compass.health(0.2).state is DeviceState.FAULTY
    assert compass.health(0.2).text == "attitude near vertical: check the mounting"


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        ({"identifier": "69"}, "identifier: '69' is not known"),
        ({"address": 240}, "address: 240 is out of range; allowed: 0 to 239"),
        ({"mounting": "yaw_30"}, "mounting: 'yaw_30' is not known; use one of none, yaw_45"),
    ],
)
def test_invalid_options_are_named(values, problem):
    with pytest.raises(ValueError, match=problem):
        RionOptions(**values)


class Boat:
    heading_deg = 98.5

    def heading_rad(self):
        return math.radians(self.heading_deg)

    def yaw_rate_rad_s(self):
        return 0.0


@pytest.mark.parametrize("mounting", ["none", "yaw_90", "roll_180_yaw_270"])
@pytest.mark.parametrize("emulated", [{}, {"identifier": 0x77}, {"output_mode": 1}, {"with_status": True}])
def test_driver_and_emulator_give_the_attitude_of_the_boat(line, mounting, emulated):
    device = RionEmulator(
        Boat(), np.random.default_rng(1), noise_deg=0.0, tilt_noise_deg=0.0, mounting=mounting,
        declination_deg=10.0, set_declination_deg=2.0, **emulated,
    )  # fmt: skip
    device.pitch_deg, device.roll_deg = 12.0, -7.0
    compass = RionCompass(line, RionOptions(mounting=mounting))
    samples = []
    for step in range(500):
        now_s = step / 100
        line.inbox += device.take_output(now_s)
        compass.receive(now_s)
        for data in line.written:
            device.receive(now_s, data)
        line.written.clear()
        samples += compass.poll()
    assert len(samples) >= (20 if "output_mode" in emulated else 35)
    last = samples[-1]
    assert last.reference is NorthReference.TRUE
    angles_deg = [
        math.degrees(value) for value in (last.heading_rad, last.pitch_rad, last.roll_rad, last.variation_rad)
    ]
    assert angles_deg == pytest.approx([90.5, 12.0, -7.0, 2.0], abs=0.02)


def test_capture_is_decoded():
    texts = "68 0E 00 84 00 10 50 10 10 05 01 04 01 01 1E", "68 06 00 87 02 08 97", "68 05 00 8C 00 91"
    results = list(decode("rion", b"\x00" + b"".join(map(bytes.fromhex, texts)) + angles("0A 00 00")))
    assert [result["type"] for result in results] == ["error", "heading", "other", "other", "error"]
    assert results[1] == {
        "line": 2, "offset": 1, "type": "heading", "identifier": "68", "address": 0, "command": "84",
        "heading_magnetic_deg": 104.01, "pitch_deg": 10.5, "roll_deg": -10.05, "magnetic_deg": 104.01, "status": "01",
    }  # fmt: skip
    assert results[2]["declination_deg"] == 20.8
    assert (results[3]["command"], results[3]["result"]) == ("8C", 0)
    assert results[4]["detail"] == "heading is not a decimal number"
