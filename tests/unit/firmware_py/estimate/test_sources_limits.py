"""Limits of the checks of each compass, and the choice between them; behaviour over time: test_sources.py."""

import math

import pytest

from firmware_py.estimate import sources
from firmware_py.estimate.sources import (
    CompassState,
    CompassTurns,
    HeadingPlateau,
    Source,
    SourceState,
    TrueHeadingSample,
    update_compass,
)

NAN, DEGREE = math.nan, math.radians(1.0)
# A compass at 10 s that measures, is sound since 0 s and near the estimate of 1 rad.
SOUND = CompassState(
    10.0, 1.0, 10.0, 10.0, 0.0, 0.0, 0.0, 1.0, False, 0.0, True, 1.0, HeadingPlateau(), CompassTurns(0.1 * DEGREE, 0.0)
)
FROZEN = SOUND._replace(contradicted=True, changed_s=9.0)


def at(compass=SOUND, off_deg=0.0, t_s=10.1, raw_rad=None, gate_deg=20.0, expected_rad=1.0):
    """Return the compass after a heading that differs from 1 rad by off_deg."""
    heading_rad = 1.0 + off_deg * DEGREE
    sample = TrueHeadingSample(t_s, heading_rad, heading_rad if raw_rad is None else raw_rad, 0)
    return update_compass(compass, sample, expected_rad, gate_deg * DEGREE)


@pytest.mark.parametrize(
    ("compass", "options", "near_s"),
    [
        (SOUND, {"off_deg": 19.9}, 10.1),
        (SOUND, {"off_deg": -19.9}, 10.1),
        (SOUND, {"off_deg": 20.1}, 10.0),
        (SOUND, {"off_deg": -20.1}, 10.0),
        (SOUND, {"off_deg": 29.9, "gate_deg": 30.0}, 10.1),
        (SOUND._replace(offset_rad=-10.0 * DEGREE), {"off_deg": 29.9}, 10.1),
        (SOUND._replace(offset_rad=10.0 * DEGREE), {"off_deg": 10.1}, 10.0),
        (SOUND, {"off_deg": 50.0, "t_s": 10.9}, 10.0),
        (SOUND, {"off_deg": 50.0, "t_s": 11.2}, 10.2),  # the first heading outside counts for at most a second
        (SOUND._replace(near_s=9.0), {"off_deg": 50.0, "t_s": 11.2}, 9.0),
        (CompassState(), {"off_deg": 50.0}, 10.1),
        (SOUND, {"off_deg": 50.0, "expected_rad": NAN}, 10.1),
    ],
)
def test_heading_inside_the_gate_is_near(compass, options, near_s):
    assert at(compass, **options).near_s == pytest.approx(near_s)


@pytest.mark.parametrize(("offset_deg", "agreed"), [(8.2, True), (8.8, False), (-21.0, True), (-22.0, False)])
def test_differences_are_smoothed_over_10_s_and_the_longest_constant_reading_is_remembered(offset_deg, agreed):
    before = SOUND._replace(
        changed_s=8.0,
        difference_rad=0.1,
        steady_rad=0.11,
        offset_rad=offset_deg * DEGREE,
        longest_s=3.0,
        agreed=not agreed,
    )
    expected = before._replace(
        t_s=10.5, raw_rad=0.9, changed_s=10.5, near_s=10.5, heading_rad=1.0 + 12.0 * DEGREE, agreed=agreed,
        difference_rad=pytest.approx(0.1 + 0.05 * (12.0 * DEGREE - 0.1)), longest_s=3.0 * math.exp(-2.5 / 600.0),
        steady_rad=pytest.approx(0.11 + 0.05 * (12.0 * DEGREE - 0.11)), turns=pytest.approx(before.turns, nan_ok=True),
    )  # fmt: skip
    updated = at(before, 12.0, 10.5, raw_rad=0.9, gate_deg=40.0)
    assert updated._replace(turns=before.turns) == expected._replace(turns=before.turns)
    assert at(before._replace(longest_s=2.4), 12.0, 10.5).longest_s == 2.5
    assert at(before._replace(sound_since_s=NAN), 12.0, 10.5).longest_s == 3.0
    assert at(before, 12.0, 10.5, raw_rad=1.0)[2] == 8.0


@pytest.mark.parametrize(("near_s", "jumps"), [(8.5, False), (8.4, True)])
def test_compass_jumps_after_a_second_and_a_half_outside(near_s, jumps):
    assert sources.is_jumping(SOUND._replace(near_s=near_s)) is jumps


SETTLED = HeadingPlateau(2.0, 8.0, turned=True)


@pytest.mark.parametrize(
    ("compass", "off_deg", "t_s", "expected"),
    [
        # A step of 90 deg/s and 3 deg is a turn, up to 20 deg.
        (SOUND._replace(heading_rad=1.0 + 19.0 * DEGREE), 19.0 + 11.9, 10.1, (10.1, True)),
        (SOUND._replace(heading_rad=1.0 + 19.0 * DEGREE), 19.0 + 12.1, 10.1, (10.1, False)),
        (SOUND._replace(heading_rad=1.0 - 19.0 * DEGREE), -19.0 - 11.9, 10.1, (10.1, True)),
        (SOUND._replace(heading_rad=1.0 + 19.0 * DEGREE), 19.0 + 19.9, 12.0, (12.0, True)),
        (SOUND._replace(heading_rad=1.0 + 19.0 * DEGREE), 19.0 + 20.1, 12.0, (12.0, False)),
        # Settled within 15 deg of the first heading, without a jump.
        (SOUND._replace(near_s=7.0, heading_rad=2.0, plateau=SETTLED), math.degrees(1.0) + 10.0, 10.1, (8.0, True)),
        (
            SOUND._replace(near_s=7.0, heading_rad=2.0 + 10 * DEGREE, plateau=SETTLED),
            math.degrees(1) + 14.9,
            10.1,
            (8.0, True),
        ),
        (
            SOUND._replace(near_s=7.0, heading_rad=2.0 + 10 * DEGREE, plateau=SETTLED),
            math.degrees(1) + 15.1,
            10.1,
            (10.1, True),
        ),
        (
            SOUND._replace(near_s=7.0, heading_rad=2.0 - 10 * DEGREE, plateau=SETTLED),
            math.degrees(1) - 15.1,
            10.1,
            (10.1, True),
        ),
        (SOUND._replace(near_s=7.0, heading_rad=1.6, plateau=SETTLED), math.degrees(1.0), 10.1, (10.1, False)),
        (SOUND._replace(near_s=7.0, heading_rad=2.0, plateau=SETTLED._replace(turned=False)), 67.0, 10.1, (8.0, False)),
        (SOUND._replace(near_s=7.0, heading_rad=2.0, plateau=HeadingPlateau()), 60.0, 10.1, (10.1, False)),
        (SOUND._replace(heading_rad=2.0, plateau=SETTLED), 60.0, 10.1, (10.1, True)),
        (SOUND._replace(near_s=7.0, heading_rad=2.0, plateau=SETTLED), 0.0, 10.1, (NAN, False)),
        (SOUND._replace(raw_rad=NAN, heading_rad=1.0 + 19.0 * DEGREE), 25.0, 10.1, (10.1, False)),
    ],
)
def test_plateau_begins_with_a_turn_or_a_jump_and_lasts_within_15_deg(compass, off_deg, t_s, expected):
    plateau = at(compass, off_deg, t_s, raw_rad=0.5).plateau
    assert (plateau.since_s, plateau.turned) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize(
    ("changes", "has_no_source", "contradicts"),
    [
        ({"plateau": HeadingPlateau(2.0, 7.9, turned=True)}, False, True),
        ({"plateau": HeadingPlateau(2.0, 8.0, turned=True)}, False, False),
        ({"plateau": HeadingPlateau(2.0, 7.9, turned=True), "changed_s": 9.9}, False, False),
        ({"plateau": HeadingPlateau(2.0, 7.9, turned=True), "t_s": 8.9, "changed_s": 8.9}, True, False),
        ({"plateau": HeadingPlateau(2.0, -0.1, turned=False)}, True, True),
        ({"plateau": HeadingPlateau(2.0, 0.0, turned=False)}, True, False),
        ({"plateau": HeadingPlateau(2.0, -0.1, turned=False)}, False, False),
        ({"near_s": -50.1}, True, True),
        ({"near_s": -50.0}, True, False),
        ({"near_s": -50.1}, False, False),
    ],
)
def test_compass_contradicts_the_estimate_after_it_has_settled(changes, has_no_source, contradicts):
    compass, idle = SOUND._replace(**changes), CompassState()
    assert sources.contradicts(compass, 10.0, 1.0, has_no_source) is contradicts
    source = Source.NONE if has_no_source else Source.COURSE
    for pair in ((compass, idle), (idle, compass)):
        assert sources.needs_restart(SourceState(pair, source), 10.0, (1.0, 1.0)) is contradicts
        assert not sources.needs_restart(SourceState(pair, Source.COMPASS_B), 10.0, (1.0, 1.0))


OSCILLATED = SOUND.turns._replace(swings=3.0)


@pytest.mark.parametrize(
    ("changes", "other", "is_contradicted"),
    [
        ({"changed_s": -20.1, "turns": OSCILLATED}, {}, True),
        ({"changed_s": -20.1, "turns": OSCILLATED._replace(swings=2.9)}, {}, False),
        ({"changed_s": -20.0, "turns": OSCILLATED}, {}, False),
        ({"changed_s": -20.1}, {"steady_rad": 15.1 * DEGREE}, True),
        ({"changed_s": -20.1}, {"steady_rad": -15.1 * DEGREE}, True),
        ({"changed_s": -20.1}, {"steady_rad": 14.9 * DEGREE}, False),
        ({"changed_s": -20.0}, {"steady_rad": 15.1 * DEGREE}, False),
        ({"changed_s": -20.1, "turns": CompassTurns(0.1 * DEGREE)}, {"steady_rad": 15.1 * DEGREE}, False),
        ({"changed_s": -20.1}, {"steady_rad": 15.1 * DEGREE, "near_s": 9.0}, False),
        ({"changed_s": -20.1}, {"steady_rad": 15.1 * DEGREE, "near_s": 9.0, "plateau": SETTLED}, True),
        # With a resolution of 8 deg, 2.5 steps are 20 deg.
        ({"changed_s": -20.1, "turns": CompassTurns(8.0 * DEGREE, 0.0)}, {"steady_rad": 19.9 * DEGREE}, False),
        ({"changed_s": -20.1, "turns": CompassTurns(8.0 * DEGREE, 0.0)}, {"steady_rad": 20.1 * DEGREE}, True),
        ({"changed_s": -20.1, "turns": CompassTurns(0.1 * DEGREE, 5.0 * DEGREE)}, {"steady_rad": 10.1 * DEGREE}, True),
        ({"changed_s": -20.1, "turns": CompassTurns(0.1 * DEGREE, 5.0 * DEGREE)}, {"steady_rad": 9.9 * DEGREE}, False),
        ({"contradicted": True}, {}, True),
    ],
)
def test_constant_reading_is_contradicted_by_waves_or_by_a_turn_of_the_other_compass(changes, other, is_contradicted):
    compass = SOUND._replace(**changes)
    result = sources.compare_compasses(compass, SOUND._replace(**other), 30.0)
    assert result == compass._replace(contradicted=is_contradicted, turns=result.turns)
    is_constant = compass.changed_s < compass.t_s and not math.isnan(compass.turns.apart_rad)
    apart_rad = compass.turns.apart_rad if is_constant else -other.get("steady_rad", 0.0)
    assert result.turns == compass.turns._replace(apart_rad=pytest.approx(apart_rad))


@pytest.mark.parametrize(
    ("changes", "now_s", "frozen_s", "since_s", "raw_rad", "steady_rad"),
    [
        ({}, 10.0, 30.0, 0.0, 1.0, 0.0),
        ({}, 11.0, 30.0, 0.0, 1.0, 0.0),
        ({}, 11.1, 30.0, NAN, NAN, NAN),
        ({"contradicted": True}, 11.1, 30.0, NAN, 1.0, NAN),
        ({"contradicted": True}, 11.1, 0.0, NAN, NAN, NAN),
        ({"contradicted": True}, 10.0, 30.0, NAN, 1.0, NAN),
        ({"contradicted": True}, 10.0, 0.0, 0.0, 1.0, 0.0),
        ({"near_s": 8.4}, 10.0, 30.0, NAN, 1.0, 0.0),
        ({"sound_since_s": NAN}, 10.5, 30.0, 10.5, 1.0, 0.0),
        ({"sound_since_s": NAN, "near_s": 8.4}, 10.5, 30.0, NAN, 1.0, 0.0),
    ],
)
def test_compass_is_sound_while_it_sends_measures_and_does_not_jump(
    changes, now_s, frozen_s, since_s, raw_rad, steady_rad
):
    compass = SOUND._replace(**changes)
    expected = compass._replace(sound_since_s=since_s, raw_rad=raw_rad, steady_rad=steady_rad)
    assert repr(sources.judge_soundness(compass, now_s, frozen_s, 1.0)) == repr(expected)


LOST = SOUND._replace(sound_since_s=NAN)


@pytest.mark.parametrize(
    ("previous", "a", "b", "is_course_usable", "source"),
    [
        (Source.NONE, 10.0, 10.0, True, Source.COMPASS_A),
        (Source.NONE, NAN, 10.0, True, Source.COMPASS_B),
        (Source.NONE, NAN, NAN, True, Source.NONE),
        (Source.COURSE, NAN, NAN, True, Source.COURSE),
        (Source.COURSE, NAN, NAN, False, Source.NONE),
        (Source.COURSE, 0.1, 0.1, True, Source.COURSE),
        (Source.COURSE, 0.0, 0.0, True, Source.COMPASS_A),
        (Source.COURSE, 0.1, 0.0, True, Source.COMPASS_B),
        (Source.COMPASS_B, 0.1, 9.0, True, Source.COMPASS_B),
        (Source.COMPASS_B, 0.0, 9.0, True, Source.COMPASS_A),
        (Source.COMPASS_B, 0.1, NAN, True, Source.COURSE),
        (Source.COMPASS_A, 9.0, 0.0, True, Source.COMPASS_A),
        (Source.COMPASS_A, NAN, 0.0, False, Source.COMPASS_B),
        (Source.COMPASS_A, NAN, 0.1, False, Source.NONE),
    ],
)
def test_source_is_the_first_sound_compass_after_a_probation_of_10_s(previous, a, b, is_course_usable, source):
    compasses = tuple(SOUND._replace(sound_since_s=since_s) for since_s in (a, b))
    assert sources.choose_source(previous, *compasses, 10.0, is_course_usable) is source


@pytest.mark.parametrize(
    ("previous", "lost", "offsets_deg"),
    [(Source.COMPASS_A, 0, (0.0, -7.0)), (Source.COMPASS_B, 1, (-4.0, 0.0)), (Source.NONE, 1, (0.0, 0.0))],
)
def test_new_source_begins_with_an_offset_to_the_estimate(previous, lost, offsets_deg):
    compasses = [
        SOUND._replace(difference_rad=4.0 * DEGREE, near_s=9.0),
        SOUND._replace(difference_rad=7.0 * DEGREE, near_s=9.0),
    ]
    compasses[lost] = compasses[lost]._replace(t_s=5.0, changed_s=5.0, near_s=5.0)
    result = sources.select(SourceState(tuple(compasses), previous), 10.0, 30.0, (1.0, 1.0), True)
    assert [compass.offset_rad / DEGREE for compass in result.compasses] == pytest.approx(offsets_deg)
    changed_s = [
        10.0 if offset_deg else compass.near_s for offset_deg, compass in zip(offsets_deg, compasses, strict=True)
    ]
    assert [compass.near_s for compass in result.compasses] == changed_s


@pytest.mark.parametrize(("before_deg", "after_deg"), [(3.0, 2.5), (-3.0, -2.5), (0.4, 0.0), (-0.4, 0.0)])
def test_offset_decays_by_half_a_degree_a_second(before_deg, after_deg):
    for pair in ((before_deg, 0.0), (0.0, before_deg)):
        state = SourceState(
            tuple(SOUND._replace(offset_rad=deg * DEGREE, near_s=9.5) for deg in pair), Source.COMPASS_A
        )
        result = sources.decay_offsets(state, 1.0)
        expected = [after_deg if deg else 0.0 for deg in pair]
        assert [compass.offset_rad / DEGREE for compass in result.compasses] == pytest.approx(expected)
        assert [compass._replace(offset_rad=0.0) for compass in result.compasses] == [SOUND._replace(near_s=9.5)] * 2


TURNED = SOUND._replace(changed_s=9.0, turns=CompassTurns(1.0 * DEGREE, 0.3, 2.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("compass", "raw_deg", "expected"),
    [
        (TURNED, 0.0, TURNED.turns),
        (TURNED._replace(raw_rad=NAN), 2.0, (1.0, 0.3, 0.0, 2.0, 0.0)),
        (TURNED._replace(turns=TURNED.turns._replace(rising=0.0)), 2.0, (1.0, 0.3, 2.0, 2.0, 1.0)),
        (TURNED._replace(turns=TURNED.turns._replace(rising=0.0)), -2.0, (1.0, 0.3, 2.0, -2.0, -1.0)),
        (TURNED, 2.0, (1.0, 0.3, 2.0, 2.0, 1.0)),
        (TURNED, 0.5, (0.5, 0.3, 2.0, 0.5, 1.0)),
        (TURNED, -2.4, (1.0, 0.3, 2.0, 0.0, 1.0)),
        (TURNED, -2.6, (1.0, 0.3, 3.0, -2.6, -1.0)),
        (TURNED._replace(raw_rad=0.9, turns=TURNED.turns._replace(rising=-1.0)), 0.0, (1.0, 0.3, 2.0, 0.0, -1.0)),
        (TURNED._replace(turns=TURNED.turns._replace(rising=-1.0)), -2.0, (1.0, 0.3, 2.0, -2.0, -1.0)),
        (TURNED._replace(turns=TURNED.turns._replace(rising=-1.0)), 2.6, (1.0, 0.3, 3.0, 2.6, 1.0)),
    ],
)
def test_turns_are_counted_from_2_5_resolution_steps(compass, raw_deg, expected):
    """Resolution and farthest reading in degrees, from 1 rad; the memory of the swings is 20 s."""
    turns = at(compass, t_s=10.0, raw_rad=1.0 + raw_deg * DEGREE).turns
    if expected is not TURNED.turns:
        resolution_deg, apart_rad, swings, farthest_deg, rising = expected
        if swings:
            swings = swings - 2.0 + 2.0 * math.exp(-1.0 / 20.0)
        expected = (resolution_deg * DEGREE, apart_rad, swings, 1.0 + farthest_deg * DEGREE, rising)
    assert turns == pytest.approx(expected, rel=1e-9)


def test_no_compass_is_in_use_with_the_course():
    a, b = SOUND, SOUND._replace(heading_rad=2.0)
    for source, compass in ((Source.COMPASS_A, a), (Source.COMPASS_B, b)):
        state = SourceState((a, b), source)
        assert sources.compass_in_use(state) == compass
        assert sources.uses_compass(state)
        marks = [compass.contradicted for compass in sources.mark_contradicted(state).compasses]
        assert marks == [source is Source.COMPASS_A, source is Source.COMPASS_B]
    for source in (Source.COURSE, Source.NONE):
        state = SourceState((a, b), source)
        assert repr(sources.compass_in_use(state)) == repr(CompassState())
        assert sources.mark_contradicted(state) == state
        assert not sources.uses_compass(state)


@pytest.mark.parametrize(("other_deg", "disagree"), [(14.9, False), (15.1, True), (-15.1, True), (NAN, False)])
def test_compasses_disagree_from_15_deg_on(other_deg, disagree):
    state = SourceState((SOUND, SOUND._replace(steady_rad=other_deg * DEGREE)), Source.COMPASS_A)
    assert sources.compasses_disagree(state) is disagree


@pytest.mark.parametrize(
    ("changes", "frozen_s", "has_stood", "has_stopped"),
    [
        ({"changed_s": -20.1}, 30.0, True, False),
        ({"changed_s": -20.0}, 30.0, False, False),
        ({"changed_s": -20.1, "contradicted": True}, 30.0, True, True),
        ({"changed_s": -20.1, "contradicted": True}, 0.0, False, False),
    ],
)
def test_reading_is_constant_for_cmp_frozen_s(changes, frozen_s, has_stood, has_stopped):
    compass = SOUND._replace(**changes)
    assert sources.has_stood_still(compass, frozen_s) is has_stood
    assert sources.has_stopped_measuring(compass, frozen_s) is has_stopped
    assert [sources.is_frozen(compass, now_s, frozen_s, 1.0) for now_s in (11.0, 11.1)] == [has_stopped, False]
