"""Roll and pitch held level, where the flight mode leaves them to us.

    K = −I_φ (ω² φ + 2 ω p) + z Y        M = −I_θ (ω² θ + 2 ω q) − z X

| symbol | meaning                                              | unit       |
|--------|------------------------------------------------------|------------|
| φ, θ   | roll, pitch where the command acts                   | rad        |
| p, q   | their body rates                                     | rad/s      |
| I      | inertia with the added mass                          | kg m²      |
| ω      | frequency; the damping is critical                   | rad/s      |
| z      | how far below the centre of gravity X and Y push     | m          |
| X, Y   | forces of the horizontal thrusters, forward, right   | N          |
| K, M   | moments: starboard down, bow up                      | N·m        |

The last terms cancel what the horizontal thrusters tilt; with them the rest is small.
"""

from dataclasses import dataclass

import numpy as np

from companion.control.bounds import bounded
from companion.types import Array


@dataclass(frozen=True, slots=True)
class Levelling:
    """Inertia (2,) of roll and pitch, ω, z and the most that each moment may be (N·m)."""

    inertia: Array
    frequency_radps: float
    lever_m: float
    max_moment_nm: float

    def moments(self, angles: Array, rates: Array, level_force: Array, ahead_s: float) -> Array:
        """Return K, M (2,) for roll and pitch (2,), `ahead_s` before they act, beside X, Y (2,)."""
        ahead = angles + ahead_s * rates
        omega = self.frequency_radps
        moments = -self.inertia * (omega * omega * ahead + 2.0 * omega * rates)
        moments = moments + self.lever_m * level_force[::-1] * _SIGNS
        return bounded(moments, np.full(2, self.max_moment_nm))


_SIGNS = np.array([1.0, -1.0])
