"""A compass that shows one and the same number while she turns: it has stopped measuring.

As long as the compass in use repeats itself, the filter is carried on besides without what it repeats. Once the number
has stood for longer than is its way, and is not what she can show by that filter, whose uncertainty of rudder, waves
and turning grows meanwhile, or has stood for a whole wave in waves that swing her, it is not believed any more; and she
goes on with the filter that has not listened, as if the compass had been silent. A coarse one may stand still for long
on a straight course in a calm: nothing contradicts it there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from firmware_py.common.angles import radians, wrap_pi
from firmware_py.estimate import kalman, sources, wave_filter
from firmware_py.estimate.sources import CompassState, SourceState, TrueHeadingSample
from firmware_py.estimate.wave_filter_state import WaveFilterSettings, WaveFilterState

LEAST_RAD: Final = radians(5.0)  # several steps of the coarsest compass
SPREADS, LEAST_SPREADS = 3.0, 1.5  # that contradict: the fewer, the longer beyond its way it stands
SWINGING_RAD: Final = radians(3.0)  # waves that no compass can show one number in
LEARNT_S: Final = 60.0  # they are known by then, where the filter begins with some


def deaf_filter(
    settings: WaveFilterSettings, deaf: WaveFilterState | None, heard: WaveFilterState, state: SourceState, now_s: float
) -> WaveFilterState | None:
    """Return the filter without what the compass in use repeats, carried to now_s; None where it has changed.

    `heard` is the filter of the tick before, which such a filter begins with.
    """
    compass = sources.compass_in_use(state)
    if math.isnan(compass.t_s) or compass.t_s == compass.changed_s or not heard.x:
        return None
    return wave_filter.carry_on(settings, heard if deaf is None else deaf, now_s)


def contradicted(
    state: SourceState, samples: Sequence[TrueHeadingSample], deaf: WaveFilterState | None
) -> SourceState | None:
    """Return the sources with the compass in use found to stand still by its last sample; None where it is not."""
    compass = sources.compass_in_use(state)
    said, ratio = [sample for sample in samples if sample.source == state.in_use], sources.standstill_ratio(compass)
    if not said or deaf is None or not deaf.x or ratio <= 1.0:
        return None
    spreads = max(SPREADS / math.sqrt(ratio), LEAST_SPREADS)
    if not (_shown_otherwise(deaf, said[-1].heading_rad + compass.offset_rad, spreads) or _swinging(deaf, compass)):
        return None
    return sources.contradict(state)


def _shown_otherwise(deaf: WaveFilterState, shown_rad: float, spreads: float) -> bool:
    """Whether a compass cannot show this by the filter without it."""
    off_rad = wrap_pi(shown_rad - deaf.x[kalman.FLOAT] - deaf.x[kalman.WAVE])
    variance = (
        deaf.covariance(kalman.FLOAT, kalman.FLOAT)
        + 2.0 * deaf.covariance(kalman.FLOAT, kalman.WAVE)
        + deaf.covariance(kalman.WAVE, kalman.WAVE)
        + math.exp(deaf.noise_model.log_noise)
    )
    return abs(off_rad) > max(LEAST_RAD, spreads * math.sqrt(variance))


def _swinging(deaf: WaveFilterState, compass: CompassState) -> bool:
    """Whether a compass that stands still has done so for a whole wave that swung her."""
    model = deaf.noise_model
    learnt = compass.changed_s - compass.sound_since_s >= LEARNT_S
    stands_s = compass.t_s - compass.changed_s
    return learnt and model.wave_spread_rad >= SWINGING_RAD and stands_s > 2.0 * math.pi / model.omega_rad_s
