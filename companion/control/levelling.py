"""Roll and pitch held level, where the flight mode leaves them to us.

    a = ω² φ + 2 ω p + 0.2 ω³ ∫φ dt            critically damped; the integral takes what is constant
    b' = (a − b) / τ_f                          and so the thruster's lag is led:
    K = −I (a + (τ / τ_f − 1) (a − b)) + z Y    (1 + τ s) / (1 + τ_f s)
    M   the same for θ, q                − z X

| symbol  | meaning                                              | unit       |
|---------|------------------------------------------------------|------------|
| φ, θ    | roll, pitch where the command acts                   | rad        |
| p, q    | their body rates                                     | rad/s      |
| I       | inertia with the added mass                          | kg m²      |
| ω       | frequency, as high as the delay and the guard bear   | rad/s      |
| τ, τ_f  | the thrusters' lag, and what of it is left           | s          |
| z       | how far below the centre of gravity X and Y push     | m          |
| X, Y    | forces of the horizontal thrusters, forward, right   | N          |
| K, M    | moments: starboard down, bow up                      | N·m        |

The last terms cancel what the horizontal thrusters tilt. What is left is the Munk moment (Za − Xa) u w
(Fossen 2011, 6.3): held against a current of u, a tilt θ makes w = u θ, and the moment turns it further. For
a Heavy it is 4 N·m/rad at 0.6 m/s and 9 at 0.85, where its weight rights it with 1.3: hence the stiffness.
"""

import math

import numpy as np

from companion.control import oscillation
from companion.control.bounds import bounded
from companion.records import Array

FILTER_S = 0.05
INTEGRAL = 0.2
DELAY_BEARS = 0.18
"""ω times the delay, rad: gain margin 2.3, phase margin 30° with a lag of 0.15 s."""

_SIGNS = np.array([1.0, -1.0])


class Levelling:
    """Inertia (2,) of roll and pitch, the highest ω, z, the largest moment (N·m), and the thrusters' lag."""

    def __init__(
        self, inertia: Array, frequency_radps: float, lever_m: float, max_moment_nm: float, lag_s: float
    ) -> None:
        self._inertia = inertia
        self._frequency_radps = frequency_radps
        self._lever_m = lever_m
        self._max_moment = np.full(2, max_moment_nm)
        self._lead = max(lag_s / FILTER_S - 1.0, 0.0)
        limit = oscillation.SHARE * max_moment_nm
        self._parameters = oscillation.Parameters(max_moment_nm, limit)
        self.reset()

    def reset(self) -> None:
        """Begin anew: no integral, and no rate of change known."""
        self._integral: Array = np.zeros(2)
        self._slow: Array | None = None
        self._oscillation = [oscillation.START] * 2

    def step(
        self,
        angles: Array,
        rates: Array,
        level_force: Array,
        delay_s: Array | float,
        dt_s: float,
        *,
        learn: bool,
    ) -> Array:
        """Return K, M (…, 2) for roll and pitch (…, 2) beside X, Y (…, 2), `delay_s` from sensor to motor.

        `learn` allows the integral to move; it stands where the moment is at its bound. A roll or pitch that
        oscillates by itself lowers ω.
        """
        omega = np.minimum(self._frequency_radps, DELAY_BEARS / np.maximum(delay_s, 1e-3))
        omega = omega * np.array([one.gain_scale for one in self._oscillation])
        ahead = angles + delay_s * rates
        a = omega * omega * ahead + 2.0 * omega * rates
        slow = a if self._slow is None else self._slow
        self._slow = slow + (a - slow) * (1.0 - math.exp(-dt_s / FILTER_S))
        trim = INTEGRAL * omega**3 * dt_s * ahead if learn else np.zeros(2)
        force = np.stack((level_force[..., 1], level_force[..., 0]), axis=-1)
        feedback = -self._inertia * (a + self._lead * (a - self._slow))
        if learn:
            moments = feedback.tolist()
            self._oscillation = [
                oscillation.step(self._parameters, one, moment, dt_s, 0.0)
                for one, moment in zip(self._oscillation, moments, strict=True)
            ]
        wanted = self._lever_m * force * _SIGNS + feedback
        moments = wanted - self._inertia * (self._integral + trim)
        self._integral = np.where(np.abs(moments) <= self._max_moment, self._integral + trim, self._integral)
        return bounded(moments, self._max_moment)
