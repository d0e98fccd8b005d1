"""Whether what is measured answers what is done: a sensor may hang with fresh stamps, a rate may be wrong.

| a signal is not believed where                                    | such as                              |
|-------------------------------------------------------------------|--------------------------------------|
| a fine one repeats exactly (`ExactRepeats`)                       | the climb rate of an EKF that hangs  |
| the autopilot says that its depth sensor is unhealthy             | a pressure sensor that hangs         |
| it stays while its rate says that it moves (`Partners.stands`)    | a pressure sensor that hangs         |
| it and its rate go opposite ways (`Partners.opposed`)             | a rate of the wrong sign             |
| they, and the pressure, show different motions (`Partners.differ`)| a rate of another scale              |
"""

import math
from collections.abc import Sequence

from companion.core.attitude import angle_rates
from companion.core.bounds import wrap
from companion.records.events import Attitude, Position

FROZEN_S, IN_A_ROW = 0.4, 5
"""A fine signal that repeats for this time, and this often, is frozen. On two real vehicles, one on a
table, climb rate, angles and rates never came more than twice in a row (docs/ardusub.md, "Telemetry")."""

FINE = 16.0
"""A signal whose usual change is this many times the least one is not rounded: a rounded one may rest."""

CHANGES = 10.0
"""The usual change is a geometric mean over this many changes: it follows a motion that comes to rest."""

MEMORY_S, STANDING_S = 2.0, 10.0
"""How long a motion is remembered, and one during which the position stays: a small error of a rate shall not
add up."""

STANDS_STEPS = 3.0
"""A position counts as constant if it moved by at most this many of its steps, and by `least`."""

LONGEST_S, RATE_GAP_S = 1.2, 0.15
"""Between two samples of a position (with nobody asking the pressure comes at 2 Hz), and of its rate: what
happens in a longer gap nobody knows."""

PRESSED_S, PRESSED_FINE, PRESSED_STEP_M = 2.0, 4.0, 0.9e-3
"""A pressure that repeats for this time is ArduSub's own sign of a sensor that hangs. One in coarser steps,
as a Bar30's of 1 mm, is left to ArduSub: 28 % of its readings repeat (docs/ardusub.md, "Telemetry")."""

LEAST_M = 0.05
"""The noise of a climb rate adds up to 11 mm over STANDING_S (docs/ardusub.md, "Telemetry")."""

USUAL_S, NOISE, MOST_NOISE = 30.0, 2.0, 3.0
"""Time of the usual difference of the two; noise is this many times it, and `least`. With a barometer of
±0.2 m the real ArduSub's depth and climb rate go opposite ways by 0.05 m."""

SHORTEST_S = 1e-9

DIFFERENT = 0.5
"""Share of the larger motion that may be missing in the other: an EKF with GPS shows 0.71 of it."""


class ExactRepeats:
    """Since when one signal has repeated exactly.

    It is a fine one if its usual change is `fine` times the least one, and that is `coarsest` at most.
    """

    def __init__(self, fine: float = FINE, coarsest: float = math.inf) -> None:
        self._fine, self._coarsest = fine, coarsest
        self.since_s = math.nan
        """Time of the last change."""
        self._value = math.nan
        self._in_a_row = 0
        self._least = math.inf
        self._log_usual = 0.0

    def step(self, t_s: float, value: float) -> None:
        """Take a sample that came at `t_s`."""
        change = abs(value - self._value)
        if change == 0.0:
            self._in_a_row += 1
            return
        if not math.isnan(change):
            self._least = min(self._least, change)
            self._log_usual += (math.log(change) - self._log_usual) / CHANGES
        self.since_s, self._value, self._in_a_row = t_s, value, 1

    def frozen(self, now_s: float, least_s: float = FROZEN_S) -> bool:
        """Tell whether it is a fine signal that repeats for that time."""
        if self._in_a_row < IN_A_ROW or not now_s - self.since_s >= least_s:
            return False
        return self._least <= self._coarsest and self._log_usual >= math.log(self._fine * self._least)


class Partners:
    """The motion that a position and its rate show, each over MEMORY_S.

    A step of the position that is larger than `jump` and `fastest` explain is a reset, and no motion; nor is
    less than `least`.
    """

    def __init__(self, jump: float, fastest: float, least: float, *, angular: bool = False) -> None:
        self._jump, self._fastest, self._least, self._angular = jump, fastest, least, angular
        self._rate_s = self._at_s = self.since_s = math.nan
        self._rate = self._position = 0.0
        self._came = self._way = self._moved = self._meanwhile = 0.0
        self._step = math.inf
        self._difference2 = self._seen_s = 0.0

    def rate(self, t_s: float, rate: float) -> None:
        """Take a sample of the rate."""
        gap_s = t_s - self._rate_s
        if gap_s > RATE_GAP_S:
            self._at_s = math.nan
        elif gap_s > 0.0:
            self._came += 0.5 * (rate + self._rate) * gap_s
        self._rate_s, self._rate = t_s, rate

    def position(self, t_s: float, position: float) -> None:
        """Take a sample of the position; begin anew after a gap in it or in its rate."""
        gap_s, moved, came = t_s - self._at_s, position - self._position, self._came
        moved = wrap(moved) if self._angular else moved
        self._at_s, self._position, self._came = t_s, position, 0.0
        if not (0.0 <= gap_s <= LONGEST_S and t_s - self._rate_s <= RATE_GAP_S):
            self._way = self._moved = self._meanwhile = 0.0
            self.since_s = t_s
            return
        if moved:
            self._step, self._meanwhile, self.since_s = min(self._step, abs(moved)), 0.0, t_s
        else:
            self._meanwhile = math.exp(-gap_s / STANDING_S) * self._meanwhile + came
        if abs(moved - came) > self._jump + self._fastest * gap_s:
            moved = came
        keep = math.exp(-gap_s / MEMORY_S)
        self._way, self._moved = keep * self._way + came, keep * self._moved + moved
        self._seen_s = min(self._seen_s + gap_s, USUAL_S)
        new = gap_s / max(self._seen_s, gap_s, SHORTEST_S)
        self._difference2 += new * ((self._way - self._moved) ** 2 - self._difference2)

    @property
    def stands(self) -> bool:
        """Whether the position stays while the rate says that it moves."""
        lasts = self._at_s - self.since_s >= FROZEN_S
        return lasts and abs(self._meanwhile) > STANDS_STEPS * min(self._step, self._least) + self._least

    @property
    def opposed(self) -> bool:
        """Whether the two go opposite ways, by more than they usually differ."""
        usual = NOISE * math.sqrt(self._difference2)
        least = max(self._least, min(usual, MOST_NOISE * self._least))
        return self._way * self._moved < 0.0 and min(abs(self._way), abs(self._moved)) > least

    @property
    def differ(self) -> bool:
        """Whether the two show different motions."""
        larger = max(abs(self._way), abs(self._moved))
        return abs(self._way - self._moved) > 3.0 * self._least + DIFFERENT * larger


class DepthAnswers:
    """Depth, climb rate and pressure, which shows a zero of depth that moves to be no motion."""

    def __init__(self) -> None:
        self.healthy = True
        """Whether the autopilot believes its depth sensor."""
        self._climb, self._reading = ExactRepeats(), ExactRepeats(PRESSED_FINE, PRESSED_STEP_M)
        self._depth, self._pressure = Partners(0.04, 2.0, LEAST_M), Partners(0.04, 2.0, LEAST_M)
        self._pressure_s = -math.inf

    def rate(self, t_s: float, w_mps: float) -> None:
        """Take a sample of the climb rate, positive down."""
        self._climb.step(t_s, w_mps)
        self._depth.rate(t_s, w_mps)
        self._pressure.rate(t_s, w_mps)

    def pressure(self, t_s: float, z_m: float) -> None:
        """Take a reading of the pressure."""
        self._pressure_s = t_s
        self._reading.step(t_s, z_m)
        self._pressure.position(t_s, z_m)

    def position(self, t_s: float, z_m: float) -> tuple[float, str]:
        """Take a depth; return when it was believed last, and why it is not now."""
        self._depth.position(t_s, z_m)
        if self._climb.frozen(t_s):
            return self._climb.since_s, f"the climb rate repeats for {t_s - self._climb.since_s:.1f} s"
        if self._reading.frozen(t_s, PRESSED_S):
            return self._reading.since_s, f"the pressure repeats for {t_s - self._reading.since_s:.1f} s"
        if not self.healthy:
            return -math.inf, "the autopilot reports its depth sensor unhealthy"
        if self._depth.stands:
            return self._depth.since_s, "the depth repeats while the climb rate shows a motion"
        moved_zero = t_s - self._pressure_s <= LONGEST_S and not self._pressure.differ
        if self._depth.opposed or (self._depth.differ and not moved_zero):
            return -math.inf, "depth and climb rate show different motions"
        return t_s, ""


class PositionAnswers:
    """Horizontal position and velocity. Fixes move the one without the other, so only repeats count."""

    NAMES = ("north", "east", "velocity north", "velocity east")

    def __init__(self) -> None:
        self._repeats = [ExactRepeats() for _ in self.NAMES]
        self._partners = [Partners(0.04, 2.0, LEAST_M) for _ in range(2)]

    def step(self, sample: Position) -> tuple[float, str]:
        """Take a sample; return when position was believed last, and why it is not now."""
        t_s, places, velocity = sample.t_s, (sample.x_m, sample.y_m), (sample.vx_mps, sample.vy_mps)
        if repeats := _repeats(self.NAMES, self._repeats, t_s, (*places, *velocity)):
            return repeats
        for partners, place, rate in zip(self._partners, places, velocity, strict=True):
            partners.rate(t_s, rate)
            partners.position(t_s, place)
        stand_s = min((partners.since_s for partners in self._partners if partners.stands), default=t_s)
        return stand_s, "it repeats while the velocity shows a motion" if stand_s < t_s else ""


class AttitudeAnswers:
    """Angles and body rates."""

    NAMES = ("roll", "pitch", "yaw", "roll rate", "pitch rate", "yaw rate")

    def __init__(self) -> None:
        self._repeats = [ExactRepeats() for _ in self.NAMES]
        jump, least = math.radians(1.0), math.radians(7.0)
        self._partners = [Partners(jump, 2.0, least, angular=True) for _ in range(3)]

    def step(self, sample: Attitude) -> tuple[float, str]:
        """Take a sample; return when attitude was believed last, and why it is not now."""
        t_s, gyro = sample.t_s, (sample.p, sample.q, sample.r)
        angles = (sample.roll, sample.pitch, sample.yaw)
        if repeats := _repeats(self.NAMES, self._repeats, t_s, (*angles, *gyro)):
            return repeats
        rates = angle_rates(sample.roll, sample.pitch, *gyro)
        for partners, angle, rate in zip(self._partners, angles, rates, strict=True):
            partners.rate(t_s, rate)
            partners.position(t_s, angle)
        opposed = [i for i, partners in enumerate(self._partners) if partners.opposed]
        if opposed:
            return -math.inf, f"{_named(self.NAMES, opposed)}: gyro and angle turn opposite ways"
        return t_s, ""


def _repeats(
    names: Sequence[str], signals: Sequence[ExactRepeats], t_s: float, values: Sequence[float]
) -> tuple[float, str] | None:
    """Take a sample of each signal; return since when any repeats exactly, and which; None if none does."""
    for signal, value in zip(signals, values, strict=True):
        signal.step(t_s, value)
    frozen = [i for i, signal in enumerate(signals) if signal.frozen(t_s)]
    if not frozen:
        return None
    since_s = min(signals[i].since_s for i in frozen)
    return since_s, f"{_named(names, frozen)}: the same for {t_s - since_s:.1f} s"


def _named(names: Sequence[str], signals: Sequence[int]) -> str:
    return ", ".join(names[i] for i in signals)
