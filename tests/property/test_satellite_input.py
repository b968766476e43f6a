"""Forged, truncated or repeated satellite messages and noise have no effect; any modem output is accepted."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_py.common.mode_table import Mode
from firmware_py.link.satellite.messages import Window
from firmware_py.link.satellite.modem import Modem
from firmware_py.link.satellite.record import Record, from_bytes, to_bytes
from support.satellite import KEY, SatelliteBoat, set_mode

MAX_STORED_NUMBERS = 128

BOAT = SatelliteBoat(key=KEY)
VALID_MESSAGE = BOAT.keyed(set_mode(Mode.GUIDED.value))
MODES = (Mode.MANUAL, Mode.STEERING, Mode.HOLD, Mode.LOITER, Mode.AUTO, Mode.RTL)


def receive_from_modem(*messages):
    """Return a boat whose modem has received these messages."""
    boat = SatelliteBoat(key=KEY)
    boat.transport._driver.modem.imei = boat.modem.imei
    boat.transport._driver.received += list(enumerate(messages))
    boat.run(2)
    return boat


@given(st.integers(0, len(VALID_MESSAGE) - 1), st.integers(1, 255))
def test_message_with_a_changed_byte_is_refused(position, change):
    forged = VALID_MESSAGE[:position] + bytes((VALID_MESSAGE[position] ^ change,)) + VALID_MESSAGE[position + 1 :]
    boat = receive_from_modem(forged)
    assert boat.intents == []
    assert sum(boat.status().refused.values()) == 1


@given(st.integers(0, len(VALID_MESSAGE) - 1), st.binary(max_size=4))
def test_message_with_another_end_is_refused(length, tail):
    boat = receive_from_modem(VALID_MESSAGE[:length] + tail)
    assert boat.intents == []
    assert sum(boat.status().refused.values()) == 1


@given(st.binary(min_size=1, max_size=270))
def test_noise_has_no_effect(noise):
    assert receive_from_modem(noise).intents == []


@given(st.lists(st.integers(0, 5), min_size=1, max_size=20))
def test_each_message_is_executed_once_in_any_order(order):
    messages = [BOAT.keyed(set_mode(MODES[number].value), at_s=-3600.0 * number) for number in range(6)]
    boat = receive_from_modem(*(messages[number] for number in order))
    assert len(boat.intents) == len(set(order))


@given(st.lists(st.integers(0, 10_000), max_size=400))
def test_no_number_is_admitted_twice(numbers):
    window, accepted = Window(), []
    for number in numbers:
        if window.admits(number):
            window = window.with_number(number)
            accepted.append(number)
        assert len(window.used) <= MAX_STORED_NUMBERS
        assert from_bytes(to_bytes(Record(window=window))) == (Record(window=window), ())
    assert len(accepted) == len(set(accepted))


@given(st.lists(st.tuples(st.binary(max_size=40), st.sampled_from([0.1, 5.0, 60.0])), max_size=30))
def test_any_output_of_the_modem_is_accepted(messages):
    modem, now_s = Modem(), 0.0
    for data, pause_s in messages:
        now_s += pause_s
        modem.feed(data, now_s)
        modem.update(now_s)
        modem.take_session()
        assert len(modem._buffer) <= 400
