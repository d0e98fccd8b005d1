"""From the law's wrench to the axes: what a tilt leaves of it, moments that level, the thrusters' curve."""

import math
from collections.abc import Sequence
from operator import sub

from companion.control import levelling, pace, tilt
from companion.control.allocation import (
    HALVINGS,
    Allocation,
    Thrusters,
    allocate,
    can_lose,
    delivered,
    overloaded,
    without,
)
from companion.control.bounds import limited
from companion.control.levelling import Levelling
from companion.control.positioning import by_dof
from companion.control.reference import ReferenceModel
from companion.control.tilt import TiltLimit
from companion.records import (
    NEUTRAL,
    PSI,
    ZERO,
    Axes,
    AxisCommand,
    Flags,
    State,
    Vector,
    VehicleState,
    Verdict,
    X,
    Y,
    Z,
)

FULL_PACE: Vector = (1.0, 1.0, 1.0, 1.0)
FULL_SHARE: Vector = (1.0, 1.0, 1.0, 1.0)
RELEASING = (State.RAMP_DOWN, State.HAND_OVER)
CUT_OFF = 0.01
"""An axis that differs from what was wanted by more than this did not get it."""


class Actuation:
    """One tick: `step` gives the axes that are wanted, `sent` takes those that went out."""

    def __init__(
        self,
        thrusters: Thrusters,
        levelling: tuple[Levelling, Levelling] | None,
        tilt_limit: TiltLimit,
        max_force: tuple[float, float],
    ) -> None:
        """Take what levels roll and pitch, and `max_force` of surge and sway, N."""
        self._levelling = levelling
        self._tilt_limit = tilt_limit
        self._command = self._beside = NEUTRAL
        self.dead_motor = 0
        """Number of the motor that gives no thrust; 0 for none."""
        self.retune(thrusters, max_force)
        self._reset()
        self._pace = FULL_PACE
        self._active_wrench = ZERO
        """What the law last asked while ACTIVE: this is let go, evenly, whatever it would say by then."""
        self._wanted = Allocation(NEUTRAL, (False,) * 6)
        self._share = FULL_SHARE
        self.delivered = ZERO
        """Body wrench that the last command, with the pilot's share, should have given, N and N·m."""
        self.saturated: Flags = (False, False, False, False)
        """By degree of freedom, whether the law did not get what it asked for."""

    def retune(self, thrusters: Thrusters, max_force: tuple[float, float]) -> None:
        """Go on with other limits."""
        self._whole, self._max_force = thrusters, max_force
        self._allocate_without(self.dead_motor)

    def _yaw_beside(self, N: float, voltage_v: float, reach: float) -> float:
        """Return the yaw axis for a moment beside the pilot's axes, which turn a vehicle without a motor."""
        low, high = -reach, reach
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            if delivered(self.thrusters, self._beside._replace(yaw=middle), voltage_v)[3] < N:
                low = middle
            else:
                high = middle
        return low

    def _allocate_without(self, motor: int) -> None:
        self.dead_motor = motor
        self.misses_motor = motor > 0 and not can_lose(self._whole, motor)
        self.thrusters = without(self._whole, motor)

    def restart(self) -> None:
        """Forget how fast the reference could go: numbers gone bad."""
        self._pace = FULL_PACE

    def step(
        self,
        requested: Vector,
        verdict: Verdict,
        state: VehicleState,
        engaged: Flags,
        reach: Axes,
        reference: ReferenceModel,
        dt_s: float,
    ) -> AxisCommand:
        """Return the axes for the body wrench `requested`, each within ±`reach`.

        Where thrust or tilt leaves less, the reference is slowed and stays near the vehicle.
        """
        if verdict.state is State.ACTIVE:
            self._active_wrench = requested
        if verdict.authority == 0.0:
            self._reset()
        angle = tilt.coming_tilt(state.roll, state.pitch, state.p, state.q)
        self._share = self._tilt_share(angle, state, reference, dt_s)
        level, _, _, upright = self._share
        surge, sway, heave, N = self._active_wrench if verdict.state in RELEASING else requested
        force = tilt.body_force(state.roll, state.pitch, angle, (level * surge, level * sway, heave))
        K, M = self._moments(force[X], force[Y], verdict, state, engaged, dt_s)
        asked = AxisCommand(*[verdict.authority * tau for tau in (*force, upright * N, K, M)])
        axes, saturated = allocate(self.thrusters, asked, state.voltage_v, reach)
        wanted = AxisCommand(*axes)
        if self.dead_motor and any(self._beside) and math.isfinite(asked.yaw):
            wanted = wanted._replace(yaw=self._yaw_beside(asked.yaw, state.voltage_v, reach[3]))
        if not engaged[PSI]:  # unequal curves ask for a little, of a heading not ours
            wanted = wanted._replace(yaw=0.0)
        self._wanted = Allocation(wanted, saturated)
        return wanted

    def sent(self, command: AxisCommand, state: VehicleState, held: Sequence[bool]) -> Vector:
        """Take what the vehicle makes of the command that went out; axes that are not `held` are the pilot's.

        Return the wrench that it gives in the level frame of the heading, N and N·m.
        """
        self._command = command
        self._beside = NEUTRAL if all(held) else AxisCommand(*map(_unless, held, command))
        surge, sway, heave, N, _, _ = delivered(self.thrusters, command, state.voltage_v)
        self.delivered = (surge, sway, heave, N)
        got_less = [
            over or saturated or abs(got - wanted) > CUT_OFF or share < 1.0
            for over, saturated, got, wanted, share in zip(
                overloaded(self.thrusters, command),
                self._wanted.saturated,
                command,
                self._wanted.axes,
                (*self._share, 1.0, 1.0),
                strict=True,
            )
        ]
        less_surge, less_sway, less_heave, less_yaw, _, _ = got_less
        self.saturated = by_dof((less_surge, less_sway, less_heave, less_yaw))
        x, y, z = tilt.level_force(state.roll, state.pitch, (surge, sway, heave))
        return (x, y, z, N)

    def _reset(self) -> None:
        """Forget what tilted the vehicle, and what it bore."""
        self._tilt = tilt.start(self._tilt_limit)
        self._roll = self._pitch = levelling.START

    def go_on_without(self, motor: int, state: VehicleState) -> Vector:
        """Allocate around a motor that gives no thrust, or none for 0, without a step in what is given.

        Return what the last command gave less than was believed, as `sent` does. Where the others cannot do
        the motor's work, everything stays as it is, and `misses_motor` tells so.
        """
        believed = delivered(self.thrusters, self._command, state.voltage_v)
        self._allocate_without(motor)
        given = delivered(self.thrusters, self._command, state.voltage_v)
        surge, sway, heave, N, K, M = map(sub, believed, given)
        if self._levelling is not None:
            roll, pitch = self._levelling
            self._roll = self._roll._replace(integral=self._roll.integral + K / roll.inertia)
            self._pitch = self._pitch._replace(integral=self._pitch.integral + M / pitch.inertia)
        x, y, z = tilt.level_force(state.roll, state.pitch, (surge, sway, heave))
        return (x, y, z, N)

    def _tilt_share(
        self, angle: float, state: VehicleState, reference: ReferenceModel, dt_s: float
    ) -> Vector:
        """Return the share of the law's force that the tilt leaves; what is let go is not pulled at.

        Heave is always ours. While the horizontal force is limited the reference stays near the vehicle.
        """
        pushed, asked = [math.hypot(*tau[:2]) for tau in (self.delivered, self._active_wrench)]
        self._tilt = tilt.step(self._tilt_limit, self._tilt, angle, pushed, dt_s)
        most_n = tilt.allowed_n(self._tilt, angle)
        level = most_n / asked if asked > most_n else 1.0
        yaw = tilt.share(angle, tilt.YAW_LEVEL_RAD, tilt.YAW_STEEP_RAD)
        x, y, z, psi = [
            pace.step(one, cut, dt_s) for one, cut in zip(self._pace, self.saturated, strict=True)
        ]
        self._pace = (x, y, z, psi)
        left = tilt.share(angle)
        reference.pace = (pace.on_a_tilt(x, left), pace.on_a_tilt(y, left), pace.on_a_tilt(z, left), psi)
        if level < 1.0:
            (x, y, _, _), (x_d, y_d, _, _) = state.eta_ahead, reference.x_d
            astray = math.hypot(x - x_d, y - y_d) > tilt.FOLLOWS_M
            reference.catch_up(state.eta_ahead, state.eta_dot_ahead, (astray, astray, False, yaw == 0.0))
        return (level, level, 1.0, yaw)

    def _moments(
        self, surge: float, sway: float, verdict: Verdict, state: VehicleState, engaged: Flags, dt_s: float
    ) -> tuple[float, float]:
        """Return the moments that keep it level, where those are ours, beside the forces of surge and sway.

        On an axis that is not held the pilot's force counts. The thrusters that level are those of heave:
        a vehicle that answers more strongly there is taken to do so in roll and pitch.
        """
        if self._levelling is None:
            return (0.0, 0.0)
        roll, pitch = self._levelling
        force_x = limited(surge if engaged[X] else self.delivered[X], self._max_force[X])
        force_y = limited(sway if engaged[Y] else self.delivered[Y], self._max_force[Y])
        model, learn = state.model, verdict.authority == 1.0
        delay_s, gain, lag_s = state.delays.total_s + model.dof_later_s[Z], model.gain[Z], model.lag_s[Z]
        self._roll, K = levelling.step(
            roll, self._roll, state.roll, state.p, force_y, delay_s, dt_s, learn, gain, lag_s
        )
        self._pitch, M = levelling.step(
            pitch, self._pitch, state.pitch, state.q, force_x, delay_s, dt_s, learn, gain, lag_s
        )
        return (K, M)


def _unless(held: bool, axis: float) -> float:
    return 0.0 if held else axis
