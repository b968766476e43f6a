"""Whatever comes by satellite or from the modem: what is forged, cut, repeated or noise changes nothing."""

from hypothesis import given
from hypothesis import strategies as st

from firmware_py.link.satellite.messages import KEPT_NUMBERS, Window
from firmware_py.link.satellite.modem import Modem
from firmware_py.link.satellite.record import Record, from_bytes, to_bytes
from support.satellite import KEY, SatelliteBoat, set_mode

BOAT = SatelliteBoat(key=KEY)
RIGHT = BOAT.keyed(set_mode(15))


def handed_over(*messages):
    """Return the requests to the boat from these messages of the modem."""
    boat = SatelliteBoat(key=KEY)
    boat.transport._driver.modem.imei = boat.modem.imei
    boat.transport._driver.received += list(enumerate(messages))
    boat.run(2)
    return boat


@given(st.integers(0, len(RIGHT) - 1), st.integers(1, 255))
def test_a_message_with_another_byte_changes_nothing(place, change):
    forged = RIGHT[:place] + bytes((RIGHT[place] ^ change,)) + RIGHT[place + 1 :]
    boat = handed_over(forged)
    assert boat.intents == []
    assert sum(boat.status().refused.values()) == 1


@given(st.integers(0, len(RIGHT) - 1), st.binary(max_size=4))
def test_one_that_is_cut_short_or_goes_on_differently_changes_nothing(length, more):
    boat = handed_over(RIGHT[:length] + more)
    assert boat.intents == []
    assert sum(boat.status().refused.values()) == 1


@given(st.binary(min_size=1, max_size=270))
def test_noise_changes_nothing(noise):
    assert handed_over(noise).intents == []


@given(st.lists(st.integers(0, 5), min_size=1, max_size=20))
def test_each_message_counts_once_in_whatever_order(order):
    messages = [BOAT.keyed(set_mode((0, 3, 4, 5, 10, 11)[number]), at_s=-3600.0 * number) for number in range(6)]
    boat = handed_over(*(messages[number] for number in order))
    assert len(boat.intents) == len(set(order))


@given(st.lists(st.integers(0, 10_000), max_size=400))
def test_no_number_counts_twice_however_many_come(numbers):
    window, counted = Window(), []
    for number in numbers:
        if window.admits(number):
            window = window.with_number(number)
            counted.append(number)
        assert len(window.used) <= KEPT_NUMBERS
        assert from_bytes(to_bytes(Record(window=window))) == (Record(window=window), ())
    assert len(counted) == len(set(counted))


@given(st.lists(st.tuples(st.binary(max_size=40), st.sampled_from([0.1, 5.0, 60.0])), max_size=30))
def test_any_output_of_the_modem_is_accepted(messages):
    modem, now_s = Modem(), 0.0
    for data, pause_s in messages:
        now_s += pause_s
        modem.feed(data, now_s)
        modem.update(now_s)
        modem.take_session()
        assert len(modem._held) <= 400
