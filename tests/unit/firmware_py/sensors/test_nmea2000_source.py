"""Choice of one source of a quantity, and address claims."""

import pytest

from firmware_py.sensors.nmea2000_source import AUTOMATIC, SourceSelection
from hil.devices import nmea2000_frames as n2k


def name(number, maker=1851):
    return n2k.to_bytes(n2k.unsigned(number, 21) + n2k.unsigned(maker, 11))


def selection(address=AUTOMATIC):
    return SourceSelection("heading", address, 3.0)


def test_first_source_stays_until_it_is_silent_and_the_second_is_reported_once():
    sources = selection()
    assert sources.address is None
    assert sources.accepts(0x23, 1.0)
    assert not sources.accepts(0x24, 1.1)
    assert sources.take_text() == "second heading source 0x24 not used"
    assert not sources.accepts(0x24, 1.2)
    assert sources.take_text() == ""
    assert not sources.accepts(0x24, 4.0)
    assert sources.address == 0x23
    assert sources.accepts(0x24, 4.01)
    assert sources.take_text() == "heading source 0x23 silent: 0x24 used"
    assert not sources.accepts(0x23, 4.02)
    assert sources.take_text() == "second heading source 0x23 not used"


def test_configured_source_that_never_sends_is_named_with_the_one_that_does():
    sources = selection(0x55)
    assert sources.missing_text == ""
    sources.handle_claim(0x23, name(77), 0.0)
    assert not sources.accepts(0x23, 0.1)
    assert sources.take_text() == ""
    assert sources.missing_text == "no heading from source 0x55, but from 0x23"
    assert sources.accepts(0x55, 0.2)
    assert sources.missing_text == ""
    assert not sources.accepts(0x23, 0.3)
    assert sources.take_text() == "second heading source 0x23 (maker 1851, no. 77) not used"
    sources = selection(0x55)
    assert not sources.accepts(0x23, 0.1)
    sources.restart()
    assert sources.missing_text == ""


def test_configured_source_is_the_only_one():
    sources = selection(0x24)
    assert not sources.accepts(0x23, 0.0)
    assert not sources.accepts(0x23, 100.0)
    assert sources.accepts(0x24, 100.1)
    assert not sources.accepts(0x23, 200.0)


@pytest.mark.parametrize(("source", "accepted"), [(0, True), (251, True), (252, False), (254, False), (255, False)])
def test_reserved_addresses_are_no_source(source, accepted):
    assert selection().accepts(source, 0.0) is accepted


@pytest.mark.parametrize("address", [AUTOMATIC, 0x23])
def test_source_is_followed_to_a_new_address(address):
    sources = selection(address)
    sources.handle_claim(0x23, name(1), 0.0)
    sources.handle_claim(0x24, name(2), 0.0)
    assert sources.accepts(0x23, 1.0)
    sources.handle_claim(0x23, name(3), 1.1)  # another device takes the address
    assert not sources.accepts(0x23, 1.2)
    sources.handle_claim(0x30, name(1), 1.3)
    assert not sources.accepts(0x23, 1.4)
    assert not sources.accepts(0x24, 1.4)
    assert sources.accepts(0x30, 1.4)
    assert sources.address == 0x30


def test_source_that_claims_a_new_address_without_a_conflict_is_followed():
    sources = selection()
    assert sources.accepts(0x23, 1.0)
    sources.handle_claim(0x23, name(1), 1.1)  # the first claim that is received names the source
    sources.handle_claim(0x40, name(2), 1.1)
    assert sources.address == 0x23
    sources.handle_claim(0x41, name(1), 1.2)
    assert sources.address == 0x41
    for address in (252, 254):  # 254: cannot claim an address
        sources.handle_claim(address, name(1), 1.3)
        assert sources.address == 0x41
    sources.handle_claim(251, name(1), 1.4)
    assert sources.address == 251


def test_source_that_was_displaced_and_claims_no_address_is_replaced_after_the_timeout():
    sources = selection(0x23)
    sources.handle_claim(0x23, name(1), 0.0)
    assert sources.accepts(0x23, 0.1)
    sources.handle_claim(0x23, name(2), 1.0)
    assert not sources.accepts(0x23, 4.0)
    assert sources.accepts(0x23, 4.1)


def test_source_is_described_by_its_name():
    sources = selection()
    sources.handle_claim(0x24, name(77, 229), 0.0)
    sources.accepts(0x23, 1.0)
    sources.accepts(0x24, 1.0)
    assert sources.take_text() == "second heading source 0x24 (maker 229, no. 77) not used"


def test_restart_forgets_everything():
    sources = selection()
    sources.accepts(0x23, 1.0)
    sources.handle_claim(0x23, name(1), 1.0)
    sources.handle_claim(0x25, name(3), 1.0)
    assert not sources.accepts(0x25, 1.0)
    assert sources.take_text() == "second heading source 0x25 (maker 1851, no. 3) not used"
    sources.restart()
    assert sources.address is None
    assert sources.accepts(0x24, 1.1)
    assert not sources.accepts(0x25, 1.1)
    assert sources.take_text() == "second heading source 0x25 not used"
    sources.handle_claim(0x24, name(2), 1.2)
    assert sources.address == 0x24
