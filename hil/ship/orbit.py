"""Wave orbital motion of the float, and so of the GNSS receiver on it.

The waves of a short-crested sea spread about their mean direction, so the velocity has a component along it and one
across, independent at a point. The yaw comes from the same waves: a slender float at an angle chi to a wave is turned
in proportion to sin(2 chi). So the component along the waves turns the float in a quartering sea, the component across
with the waves ahead, abeam or astern, and a combination in between. The yaw rate is proportional to the water velocity,
because the water damps the yaw of the float.
"""

from __future__ import annotations

import math

from firmware_py.common.angles import TWO_PI
from hil.ship.noise import NormalNumbers
from hil.ship.waves import DAMPING, WaveYaw


class Orbit:
    """The horizontal orbital motion at the surface, along the direction of the waves.

    `velocity_m_s` is its standard deviation; a wave of height H and period T gives pi H / T at its crest.
    """

    def __init__(
        self, velocity_m_s: float, period_s: float, toward_rad: float, step_s: float, numbers: NormalNumbers
    ) -> None:
        """Start in the stationary state; without a velocity or a period there are no waves."""
        is_calm = velocity_m_s <= 0.0 or period_s <= 0.0
        # Narrow band: displacement = velocity / angular frequency. The process is linear: metres in place of radians.
        spread_m = 0.0 if is_calm else velocity_m_s * period_s / TWO_PI
        self._process = WaveYaw(spread_m, period_s, step_s, numbers)
        self._north, self._east = math.cos(toward_rad), math.sin(toward_rad)

    def step(self) -> None:
        """Advance one grid step."""
        self._process.step()

    def position_m(self, offset_s: float) -> tuple[float, float]:
        """Return the displacement north and east."""
        along_m = self._process.angle_rad(offset_s)
        return along_m * self._north, along_m * self._east

    def velocity_m_s(self, offset_s: float) -> tuple[float, float]:
        """Return the velocity north and east."""
        along_m_s = self._process.rate_rad_s(offset_s)
        return along_m_s * self._north, along_m_s * self._east


class ShortCrestedOrbit:
    """The horizontal orbital motion of waves that spread about their direction, correlated with the yaw of the hull.

    `velocity_m_s` is the rms of the velocity vector, `spread_rad` the spread of the wave directions (wrapped normal:
    the component across has (1 - exp(-2 spread^2)) / 2 of the energy). `yaw` is the hull's wave yaw process and its
    standard deviation; with a deviation of 0 the motion is independent. Both must have the same period.
    """

    def __init__(
        self,
        velocity_m_s: float,
        spread_rad: float,
        period_s: float,
        toward_rad: float,
        step_s: float,
        yaw: tuple[WaveYaw, float],
        numbers: tuple[NormalNumbers, NormalNumbers],
        damping: float = DAMPING,
    ) -> None:
        """Start in the stationary state.

        `numbers`: for the component that is independent of the yaw, and for the other one if there is no wave yaw.
        """
        displacement_m = velocity_m_s * period_s / TWO_PI  # rms
        across = math.sqrt(0.5 * -math.expm1(-2.0 * spread_rad * spread_rad))
        self._along_m, self._across_m = displacement_m * math.sqrt(1.0 - across * across), displacement_m * across
        self._toward_rad = toward_rad
        process, deviation_rad = yaw
        self._independent = None if deviation_rad > 0.0 else WaveYaw(1.0, period_s, step_s, numbers[1], damping)
        self._yaw, self._per_yaw = (
            (process, 1.0 / deviation_rad) if self._independent is None else (self._independent, 1.0)
        )
        self._uncorrelated = WaveYaw(1.0, period_s, step_s, numbers[0], damping)

    def step(self) -> None:
        """Advance one grid step; the owner of the yaw process advances that one."""
        self._uncorrelated.step()
        if self._independent is not None:
            self._independent.step()

    def position_m(self, offset_s: float, heading_rad: float) -> tuple[float, float]:
        """Return the displacement north and east of a hull on a heading."""
        yaw, uncorrelated = self._per_yaw * self._yaw.angle_rad(offset_s), self._uncorrelated.angle_rad(offset_s)
        return self._to_north_east(yaw, uncorrelated, heading_rad)

    def velocity_m_s(self, offset_s: float, heading_rad: float) -> tuple[float, float]:
        """Return the velocity north and east of a hull on a heading."""
        return self._to_north_east(
            self._per_yaw * self._yaw.rate_rad_s(offset_s), self._uncorrelated.rate_rad_s(offset_s), heading_rad
        )

    def _to_north_east(self, correlated: float, uncorrelated: float, heading_rad: float) -> tuple[float, float]:
        """Return north and east, in m (m/s for rates), of the normalized motions correlated with the yaw and not."""
        twice_rad = 2.0 * (self._toward_rad - heading_rad)
        sine, cosine = math.sin(twice_rad), math.cos(twice_rad)
        along = self._along_m * (sine * correlated + cosine * uncorrelated)
        across = self._across_m * (cosine * correlated - sine * uncorrelated)
        cosine_toward, sine_toward = math.cos(self._toward_rad), math.sin(self._toward_rad)
        return along * cosine_toward - across * sine_toward, along * sine_toward + across * cosine_toward
