"""Variation sent by a compass and configured declination, from the NMEA sentence to the heading."""

import math
from functools import reduce

import pytest
from msgspec.structs import replace

from firmware_py.common.angles import radians
from firmware_py.common.parameters import ParameterSet
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample
from firmware_py.core.state import State, heading_timeouts_of, settings_of
from firmware_py.estimate import heading_estimator
from firmware_py.estimate.declination import declination_rad
from firmware_py.estimate.variation import apply, find_unused, find_variation
from firmware_py.sensors.nmea_compass import NmeaCompass, NmeaCompassOptions
from hil.devices.nmea_text import whole_sentence
from support.line import FakeLine

UTC_S = 1_767_225_600.0
PLACE = PositionSample(0.0, FixType.FIX_3D, radians(36.0), radians(121.0), utc_s=UTC_S)
MODEL_DEG = math.degrees(declination_rad(radians(36.0), radians(121.0), UTC_S))  # 7.7 W
MODEL, CONFIGURED, NOT_CONFIGURED = {"CMP_DECL_AUTO": 1}, {"CMP_DECL_DEG": MODEL_DEG}, {}


def estimate_heading(body, settings, *bodies):
    """Return the true heading [deg] after 3 s with these sentences, and the reports; `settings`: parameters."""
    values = reduce(lambda result, item: result.replaced(*item), settings.items(), ParameterSet())
    state, line, texts = State.at_start(values), FakeLine(), []
    compass, settings = NmeaCompass(line, NmeaCompassOptions()), settings_of(values)
    estimate, timeouts = state.heading_estimator, heading_timeouts_of(settings, state.devices)
    for second in range(1, 4):
        line.inbox += b"".join(map(whole_sentence, (body, *bodies)))
        compass.receive(float(second))
        headings = compass.poll()
        estimate, events = heading_estimator.update(
            settings.heading_estimator, estimate, headings, [PLACE], 0.0, timeouts, float(second)
        )
        texts += [event.text for event in events if "states" in event.text]
    return math.degrees(estimate.heading.heading_rad), texts


@pytest.mark.parametrize("settings", [MODEL, CONFIGURED])
@pytest.mark.parametrize(
    ("fields", "texts"),
    [
        ("100.0,0.0,E,0.0,E", []),
        ("100.0,,,0.0,E", []),
        ("100.0,0.0,E,0.0,W", []),
        ("100.0,,,,", []),
        ("100.0,0.0,E,12.0,E", ["Compass A states variation 12.0 E: 7.7 W is used"]),
        ("100.0,,,7.6,E", ["Compass A states variation 7.6 E: 7.7 W is used"]),
        ("100.0,7.6,W,,", ["Compass A states deviation 7.6 W: used as variation"]),
        ("100.0,7.6,W,0.0,E", ["Compass A states deviation 7.6 W: used as variation"]),
        ("100.0,20.0,E,,", ["Compass A states deviation 20.0 E: 7.7 W is used"]),
    ],
)
def test_configured_declination_replaces_an_implausible_variation(settings, fields, texts):
    assert estimate_heading(f"HCHDG,{fields}", settings) == (pytest.approx(100.0 + MODEL_DEG, abs=0.1), texts)


@pytest.mark.parametrize(
    ("fields", "settings", "true_deg"),
    [
        ("100.0,0.0,E,0.0,E", NOT_CONFIGURED, 100.0),
        ("100.0,0.0,E,12.0,E", NOT_CONFIGURED, 112.0),
        ("100.0,0.0,E,6.0,W", CONFIGURED, 94.0),  # close to the declination, and more accurate
        ("100.0,2.0,E,6.0,W", MODEL, 96.0),
        ("100.0,4.0,E,,", CONFIGURED, 104.0 + MODEL_DEG),  # a deviation
        ("100.0,4.0,E,6.0,W", CONFIGURED, 98.0),
    ],
)
def test_plausible_variation_is_used_and_not_reported(fields, settings, true_deg):
    assert estimate_heading(f"HCHDG,{fields}", settings) == (pytest.approx(true_deg, abs=0.1), [])


def test_true_heading_without_a_variation_is_unchanged():
    assert estimate_heading("HEHDT,100.0,T", CONFIGURED) == (pytest.approx(100.0), [])


@pytest.mark.parametrize("order", [1, -1])
def test_true_heading_of_the_same_instrument_is_corrected(order):
    first, second = ["HCHDG,100.0,,,12.0,E", "HCHDT,112.0,T"][::order]
    true_deg, texts = estimate_heading(first, CONFIGURED, second)
    assert true_deg == pytest.approx(100.0 + MODEL_DEG, abs=2.0)
    assert len(texts) == 1


def test_true_heading_of_another_instrument_is_not_corrected():
    true_deg, _ = estimate_heading("HCHDG,100.0,,,12.0,E", CONFIGURED, "HEHDT,92.3,T")
    assert true_deg == pytest.approx(100.0 + MODEL_DEG, abs=0.2)


def test_unused_variation_is_reported_once_and_when_it_agrees_again():
    wrong, right = (HeadingSample(0.0, 1.0, NorthReference.TRUE, radians(deg), source=1) for deg in (12.0, -7.0))
    unused, events = find_unused((None, None), [wrong, wrong], radians(-7.6))
    assert [event.text for event in events] == ["Compass B states variation 12.0 E: 7.6 W is used"]
    assert find_unused(unused, [wrong], radians(-7.6)) == (unused, ())
    unused, events = find_unused(unused, [right], radians(-7.6))
    assert [event.text for event in events] == ["Compass B: stated variation agrees"]
    assert unused == (None, None)


@pytest.mark.parametrize("heading_rad", [math.nan, math.inf])
def test_heading_that_is_not_finite_is_unchanged(heading_rad):
    sample = HeadingSample(0.0, heading_rad, NorthReference.TRUE, 0.0)
    assert apply(sample, 0.1) is sample


@pytest.mark.parametrize(
    ("reference", "variation_deg", "declination_deg", "is_variation"),
    [
        (NorthReference.TRUE, 1.0, None, True),
        (NorthReference.MAGNETIC, 15.0, None, False),
        (NorthReference.MAGNETIC, 15.1, None, True),
        (NorthReference.MAGNETIC, -15.1, None, True),
        (NorthReference.MAGNETIC, 2.0, 3.1, True),
        (NorthReference.MAGNETIC, -2.0, -3.1, True),
        (NorthReference.MAGNETIC, 2.0, 3.0, False),
        (NorthReference.MAGNETIC, 7.1, 10.0, True),
        (NorthReference.MAGNETIC, 12.9, 10.0, True),
        (NorthReference.MAGNETIC, 6.9, 10.0, False),
        (NorthReference.MAGNETIC, 13.1, 10.0, False),
    ],
)
def test_deviation_is_a_variation_beyond_15_deg_or_near_the_declination(
    reference, variation_deg, declination_deg, is_variation
):
    sample = HeadingSample(0.0, 1.0, reference, radians(variation_deg))
    declination = None if declination_deg is None else radians(declination_deg)
    assert find_variation(sample, declination) == (radians(variation_deg) if is_variation else None)
    used = apply(sample, declination)
    assert used == (replace(sample, reference=NorthReference.TRUE) if is_variation else sample)


@pytest.mark.parametrize(
    ("variation_deg", "declination_deg", "is_used"),
    [
        (7.1, 10.0, True),
        (12.9, 10.0, True),
        (6.9, 10.0, False),
        (13.1, 10.0, False),
        (3.0, 0.0, True),
        (0.0, 2.0, False),
        (0.0, None, True),
    ],
)
def test_variation_within_3_deg_of_the_declination_is_used(variation_deg, declination_deg, is_used):
    sample = HeadingSample(0.0, 1.0, NorthReference.TRUE, radians(variation_deg))
    declination = None if declination_deg is None else radians(declination_deg)
    magnetic_rad = 1.0 - radians(variation_deg)
    magnetic = replace(sample, heading_rad=magnetic_rad, reference=NorthReference.MAGNETIC, variation_rad=None)
    assert apply(sample, declination) == (sample if is_used else magnetic)


@pytest.mark.parametrize(("second_deg", "is_reported"), [(14.9, False), (15.1, True), (9.1, False), (8.9, True)])
def test_unused_variation_is_reported_again_after_a_change_of_3_deg(second_deg, is_reported):
    samples = [HeadingSample(0.0, 1.0, NorthReference.TRUE, radians(deg), source=0) for deg in (12.0, second_deg)]
    unused, _ = find_unused((None, None), samples[:1], radians(-7.0))
    assert unused == (radians(12.0), None)
    unused, events = find_unused(unused, samples[1:], radians(-7.0))
    assert len(events) == is_reported
    assert unused == (radians(second_deg if is_reported else 12.0), None)
    assert find_unused(unused, [replace(samples[0], source=2)], None) == (unused, ())
