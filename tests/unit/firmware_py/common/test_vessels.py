"""Records of other vessels: distress beacons, merged identities, vessels that can be avoided."""

import pytest
from msgspec.structs import replace

from firmware_py.common import vessels
from firmware_py.common.vessels import (
    STATUS_DISTRESS,
    Vessel,
    VesselIdentity,
    VesselKind,
    VesselPosition,
    is_distress_number,
    merge,
)
from support.stored_numbers import assert_missing_values_are_empty, assert_stored_numbers

ANNA = VesselIdentity(1.0, 7, "ANNA", "DA1", 70, (1, 2, 3, 4))
NEAR = Vessel(VesselPosition(160.0, 7, VesselKind.CLASS_A, 0.1, 0.2, status=0), beside_s=100.0)


def test_stored_kinds_keep_their_numbers():
    assert_stored_numbers(VesselKind, "CLASS_A CLASS_B BASE_STATION MARK")


def test_missing_values_of_a_vessel_are_empty_except_its_status():
    assert_missing_values_are_empty(vessels, status=15)


def test_distress_beacons_have_numbers_that_begin_with_970_972_or_974():
    first_digits = [number for number in range(1000) if is_distress_number(number * 1_000_000 + 999_999)]
    assert first_digits == [970, 972, 974]


def test_merged_identity_keeps_what_the_later_message_does_not_contain():
    assert merge(ANNA, VesselIdentity(2.0, 7)) == replace(ANNA, t_s=2.0)
    bob = VesselIdentity(2.0, 7, "BOB", "DB2", 36, (5, 6, 7, 8))
    assert merge(ANNA, bob) == bob


@pytest.mark.parametrize(
    ("vessel", "is_other", "is_avoidable"),
    [
        (NEAR, True, False),
        (replace(NEAR, beside_s=100.1), True, True),
        (replace(NEAR, beside_s=None), True, True),
        (replace(NEAR, beside_s=None, own=True), False, False),
        (replace(NEAR, beside_s=None, position=replace(NEAR.position, status=STATUS_DISTRESS)), False, False),
        (replace(NEAR, beside_s=None, position=replace(NEAR.position, mmsi=970_000_001)), False, False),
    ],
)
def test_vessel_beside_the_boat_for_a_minute_cannot_be_avoided(vessel, is_other, is_avoidable):
    assert (vessel.is_other_vessel, vessel.is_avoidable) == (is_other, is_avoidable)


def test_title_is_the_name_or_the_number():
    assert replace(NEAR, identity=ANNA).title == "ANNA"
    assert replace(NEAR, identity=replace(ANNA, name="")).title == NEAR.title == "MMSI 000000007"
