"""Whether the heading is wrong, by gyro and course over ground; whether heave moves against its thrust.

Against the gyro: D is how far the heading has turned without the gyro (iron, motors, or a gyro's bias).

    D' = ψ' − r − D/GYRO_MEMORY_S       reported beyond GYRO_REPORTED_RAD and GYRO_SCALE of what was turned

Against the course: thrust pushes along the true heading, and is sent along the believed one. The velocity
over ground is v = v₀ + e^{iθ} u: u is what the model's thrust makes by the believed heading, v₀ what the
water does. A fading-memory filter with a double pole at ω takes what is slow out of both:

    θ = arg S_uv     σ² = (1 − c²)/(2 n c²)     c² = |S_uv|²/(S_uu S_vv)     S over COURSE_MEMORY_S

with n = ω times the seconds that are remembered. It counts as wrong by |θ| − 2σ, the least of all BANDS.
Where motors, or a DVL's axes, are exchanged, the vehicle moves as in a mirror, in its own axes v = e^{iθ} ū:
it counts by how much better that explains v than a turn does.
A velocity that is measured in body axes and turned by the same heading (a DVL without a position of its own)
always agrees.

A wave that the thrust counters in part looks like a push the other way, at its own frequency alone; a wrong
heading turns all frequencies, and the vehicle moves by LEAST_RESPONSE of what the thrust makes, |S_uv| over
S_uu, or more. It is told after LASTS_S over c². An EKF turns the accelerations that it measures by its
heading, too, so that its faster motion agrees with any: the first band counts alone where holding the place
makes the thrust grow, S_uu by GROWTH within GROWS_S.

A place that a wrong heading lost is tried again once the evidence is gone: after RETRIED_S, then after twice
as long each time, for without thrust there is no evidence.

| symbol | meaning                                     | unit  |
|--------|---------------------------------------------|-------|
| ψ, r   | heading, and its rate by the gyro           | rad   |
| D, θ   | error of the heading, by gyro and by course | rad   |
| u, v   | north + i east                              | m/s   |
"""

import cmath
import math
from typing import NamedTuple

from companion.core.positioning import Model, damping
from companion.records import HeadingCheck, Vector, VehicleModel

GYRO_MEMORY_S = 120.0
GYRO_REPORTED_RAD = math.radians(10.0)
"""A bias of 0.08 °/s is reported, and less is not: 10° in 120 s."""

GYRO_SCALE = 0.02
"""How well the gyro's scale is known."""

BANDS = ((1.0, 0.15), (4.0, 0.03))
"""ω, among the frequencies of waves and above, rad/s; RMS of u below which a band says nothing, m/s."""
COURSE_MEMORY_S = 10.0

COURSE_REPORTED_RAD, COURSE_LOST_RAD = math.radians(30.0), math.radians(40.0)
"""Angles from which a course is reported, and from which a place is not held."""

LEAST_COHERENCE = 0.05
LEAST_RESPONSE = 0.35
"""A compass turned by 180° gave 0.46 (4.5.7)."""

GROWTH, GROWS_S, ALONE_S, ALONE_COUNTS = 4.0, 3.0, 4.0, 0.5
"""After ALONE_S of any motion it grew by 6 to 11 with a compass turned by 180° (4.5.7, 4.7), and by 3.5 at
most in 35 seas of 0.5 to 1.5 m. A second of it counts like half of one with all coherence."""

RETRIED_S = 30.0
LASTS_S = 1.0
GAP_S = 1.0
"""After a longer gap between measurements the filters begin again."""


class _Filter(NamedTuple):
    """A velocity and what changes it, as the filter follows them."""

    v: complex
    v_dot: complex

    def ahead(self, dt_s: float, known: complex) -> "_Filter":
        """Go on by `dt_s` under a known acceleration."""
        return _Filter(self.v + (self.v_dot + known) * dt_s, self.v_dot)

    def corrected(self, error: complex, gap_s: float, omega: float) -> "_Filter":
        """Take the error of a measurement, `gap_s` after the one before."""
        theta = math.exp(-omega * gap_s)
        return _Filter(
            self.v + (1.0 - theta * theta) * error, self.v_dot + (1.0 - theta) ** 2 / gap_s * error
        )


class _Off(NamedTuple):
    """The heading's error by the course, by how much it is surely off (rad), and c²."""

    course_rad: float = math.nan
    surely_rad: float = 0.0
    coherence: float = 0.0


class _Band:
    """What is faster than `omega` (rad/s) of the velocity, and of what the thrust makes of it.

    It says nothing where the latter is less than `least_mps`.
    """

    def __init__(self, omega: float, least_mps: float, moved: _Filter, pushed: _Filter) -> None:
        self._omega, self._least_mps, self._moved, self._pushed = omega, least_mps, moved, pushed
        self.seconds = self._uu = self._vv = 0.0
        self._uv = self._mirror = 0j

    def ahead(self, dt_s: float, thrust: complex, braked: complex) -> None:
        """Go on by `dt_s` with the acceleration by the thrust, and what the water takes of it."""
        self._pushed = self._pushed.ahead(dt_s, thrust)
        self._moved = self._moved.ahead(dt_s, -braked)

    def compare(self, velocity: complex, ahead: complex, gap_s: float) -> None:
        """Hold a measured velocity against what the thrust makes of it; `ahead` is the way of the bow."""
        kept = math.exp(-gap_s / COURSE_MEMORY_S)
        u, v = self._pushed.v, velocity - self._moved.v
        self._pushed = self._pushed.corrected(-u, gap_s, self._omega)
        self._moved = self._moved.corrected(v, gap_s, self._omega)
        self.seconds = kept * self.seconds + gap_s
        self._uu = kept * self._uu + abs(u) ** 2 * gap_s
        self._vv = kept * self._vv + abs(v) ** 2 * gap_s
        self._uv = kept * self._uv + u.conjugate() * v * gap_s
        self._mirror = kept * self._mirror + u * v / ahead**2 * gap_s

    @property
    def pushed_mps2(self) -> float:
        """Mean square of what the thrust makes of the velocity, (m/s)²."""
        return self._uu / max(self.seconds, 1e-9)

    @property
    def seen(self) -> bool:
        """Whether that is enough to say something."""
        return self.pushed_mps2 > self._least_mps**2 and self._vv > 0.0

    @property
    def off(self) -> _Off:
        """The error of the heading."""
        coherence = min(abs(self._uv) ** 2 / (self._uu * self._vv), 1.0) if self.seen else 0.0
        if coherence < LEAST_COHERENCE or abs(self._uv) < LEAST_RESPONSE * self._uu:
            return _Off()
        course_rad = cmath.phase(self._uv)
        doubt_rad = math.sqrt((1.0 - coherence) / (2.0 * self._omega * self.seconds * coherence))
        return _Off(course_rad, abs(course_rad) - 2.0 * doubt_rad, coherence)

    @property
    def mirrored(self) -> float:
        """By how much better a mirror explains the velocity than a turn does, c² of both."""
        if not self.seen or abs(self._mirror) < LEAST_RESPONSE * self._uu:
            return 0.0
        return max(abs(self._mirror) ** 2 - abs(self._uv) ** 2, 0.0) / (self._uu * self._vv)


class _Pushed:
    """A velocity and what the thrust makes of it, in all BANDS."""

    def __init__(self) -> None:
        self.bands: list[_Band] = []
        self._velocity: complex | None = None
        self._thrust = 0j
        self._gap_s = 0.0

    def last(self, velocity: complex) -> complex:
        """Return the velocity that was measured last, which may be this one; NaN where none was."""
        return velocity if self._velocity is None else self._velocity

    def step(
        self, velocity: complex, ahead: complex, wanted: complex, braked: complex, lag_s: float, dt_s: float
    ) -> bool:
        """Go on by a tick; return whether it did, and not only began.

        `velocity` is NaN where none was measured; `ahead` is the way of the bow. The acceleration by the
        thrust is `wanted` after its lag, and the water takes `braked` of it, both in the vehicle's axes.
        """
        if self._velocity is None:  # assume that it is in balance
            self._velocity, self._thrust = velocity, wanted
            moved, pushed = _Filter(velocity, ahead * braked), _Filter(0j, -ahead * wanted)
            self.bands = [_Band(*band, moved, pushed) for band in BANDS]
            return False
        self._thrust += (wanted - self._thrust) * dt_s / (dt_s + lag_s)
        for band in self.bands:
            band.ahead(dt_s, ahead * self._thrust, ahead * braked)
        self._gap_s += dt_s
        if not cmath.isnan(velocity):
            for band in self.bands:
                band.compare(velocity, ahead, self._gap_s)
            self._velocity, self._gap_s = velocity, 0.0
        return self._gap_s <= GAP_S


class HeaveWatch:
    """Whether the vehicle moves against its vertical thrust, by the same test."""

    def __init__(self) -> None:
        self._pushed, self._against_s = _Pushed(), 0.0

    def step(
        self,
        w_mps: float,
        heave_n: float,
        nominal: Model,
        model: VehicleModel,
        delay_s: float,
        dt_s: float,
        pushes: bool,
    ) -> bool:
        """Take the rate of depth that was measured in a tick, NaN where none was, and what was sent last.

        The others are as in `HeadingWatch.push`.
        """
        last_mps = self._pushed.last(complex(w_mps)).real
        if not pushes or math.isnan(last_mps):
            self._pushed, self._against_s = _Pushed(), 0.0
            return False
        gain = model.gain[2] / nominal.m[2]
        braked = gain * damping(nominal, (0.0, 0.0, last_mps, 0.0))[2] * last_mps
        lag_s = model.lag_s[2] + delay_s
        if not self._pushed.step(complex(w_mps), 1.0, complex(gain * heave_n), complex(braked), lag_s, dt_s):
            return False
        offs = [band.off for band in self._pushed.bands]
        against = min(off.surely_rad for off in offs) > COURSE_LOST_RAD
        counts = min(off.coherence for off in offs)
        self._against_s = self._against_s + dt_s * counts if against else 0.0
        return self._against_s > LASTS_S


class HeadingWatch:
    """Takes each tick what was measured and what was sent."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what was reported."""
        self._lost = False
        self._released_s, self._retried_s = 0.0, RETRIED_S
        self._rest_gyro()
        self._rest_course()

    def _rest_gyro(self) -> None:
        self._psi = math.nan
        self._gyro_rad = self._turned_rad = 0.0

    def _rest_course(self) -> None:
        self._pushed = _Pushed()
        self._reported_s = self._lost_s = self._mirrored_s = 0.0
        self._usual_mps2 = self._alone_s = 0.0
        self._course_rad = math.nan

    @property
    def check(self) -> HeadingCheck:
        """What is reported of the heading."""
        by_gyro = abs(self._gyro_rad) > GYRO_REPORTED_RAD + GYRO_SCALE * abs(self._turned_rad)
        doubtful = by_gyro or self._lost or self._reported_s > LASTS_S
        return HeadingCheck(self._course_rad, doubtful, self._lost)

    def turn(self, psi: float, rate: float, dt_s: float, turns: bool) -> None:
        """Take the heading that was measured in a tick, NaN where none was, and the gyro's rate.

        `turns` tells whether our commands alone turn the vehicle.
        """
        if not turns:
            self._rest_gyro()
            return
        left = 1.0 - dt_s / GYRO_MEMORY_S
        self._gyro_rad = left * self._gyro_rad - rate * dt_s
        self._turned_rad = left * self._turned_rad + rate * dt_s
        if not math.isnan(psi):
            if not math.isnan(self._psi):
                self._gyro_rad += math.remainder(psi - self._psi, math.tau)
            else:
                self._gyro_rad = 0.0
            self._psi = psi

    def push(
        self,
        velocity: complex,
        heading: float,
        tau: Vector,
        nominal: Model,
        model: VehicleModel,
        delay_s: float,
        dt_s: float,
        pushes: bool,
    ) -> None:
        """Take the velocity that was measured in a tick, NaN where none was, and what was sent last.

        `heading` is the believed one, `tau` the body wrench (N, N·m), `model` what was found of the nominal
        vehicle; `delay_s` runs from a command to its measured effect, beyond the thrusters' lag; `pushes`
        tells whether our commands alone push the vehicle, with full authority or less.
        """
        if not pushes:
            self._rest_course()
            self._wait(dt_s)
            return
        ahead = cmath.exp(1j * heading)
        gain_x, gain_y = model.gain[0] / nominal.m[0], model.gain[1] / nominal.m[1]
        wanted = complex(gain_x * tau[0], gain_y * tau[1])
        nu = self._pushed.last(velocity) / ahead
        if cmath.isnan(nu):
            return
        d_u, d_v, _, _ = damping(nominal, (nu.real, nu.imag, 0.0, 0.0))
        braked = complex(gain_x * d_u * nu.real, gain_y * d_v * nu.imag)
        begins = not self._pushed.bands
        if self._pushed.step(velocity, ahead, wanted, braked, model.lag_s[0] + delay_s, dt_s):
            self._judge(dt_s)
        elif not begins:
            self._rest_course()

    def _judge(self, dt_s: float) -> None:
        """Count for how long the heading has surely been off."""
        offs = [band.off for band in self._pushed.bands]
        self._course_rad = offs[0].course_rad
        counts = min(off.coherence for off in offs)
        if self._grows(dt_s):
            offs, counts = offs[:1], ALONE_COUNTS
        off_rad, sure_s = min(off.surely_rad for off in offs), dt_s * counts
        self._reported_s = self._reported_s + sure_s if off_rad > COURSE_REPORTED_RAD else 0.0
        self._lost_s = self._lost_s + sure_s if off_rad > COURSE_LOST_RAD else 0.0
        mirrored = min(band.mirrored for band in self._pushed.bands)
        self._mirrored_s = self._mirrored_s + dt_s * mirrored if mirrored > 0.0 else 0.0
        self._lost |= max(self._lost_s, self._mirrored_s) > LASTS_S

    def _grows(self, dt_s: float) -> bool:
        """Tell whether the thrust has grown within the memory of the course."""
        self._alone_s -= dt_s
        for band in self._pushed.bands[:1]:
            self._usual_mps2 += (band.pushed_mps2 - self._usual_mps2) * dt_s / GROWS_S
            if band.seconds > ALONE_S and band.seen and band.pushed_mps2 > GROWTH * self._usual_mps2:
                self._alone_s = COURSE_MEMORY_S
        return self._alone_s > 0.0

    def _wait(self, dt_s: float) -> None:
        """Let a place that was lost be tried again after a while."""
        self._released_s = self._released_s + dt_s if self._lost else 0.0
        if self._released_s > self._retried_s:
            self._lost, self._retried_s = False, 2.0 * self._retried_s
