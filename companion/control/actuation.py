"""From the law's wrench to the axes: what a tilt leaves of it, moments that level, the thrusters' curve."""

import math

import numpy as np

from companion.control import pace
from companion.control.allocation import Allocation, Thrusters, allocate, delivered, overloaded
from companion.control.bounds import bounded
from companion.control.levelling import Levelling
from companion.control.positioning import by_dof
from companion.control.reference import ReferenceModel
from companion.control.tilt import (
    FOLLOWS_M,
    YAW_LEVEL_RAD,
    YAW_STEEP_RAD,
    TiltLimit,
    body_force,
    coming_tilt,
    level_force,
    share,
)
from companion.records import (
    NEUTRAL,
    PSI,
    ZERO,
    Array,
    Axes,
    AxisCommand,
    Flags,
    State,
    Vector,
    VehicleState,
    Verdict,
)

FULL_PACE: Vector = (1.0, 1.0, 1.0, 1.0)
RELEASING = (State.RAMP_DOWN, State.HAND_OVER)
CUT_OFF = 0.01
"""An axis that differs from what was wanted by more than this did not get it."""


class Actuation:
    """One tick: `step` gives the axes that are wanted, `sent` takes those that went out."""

    def __init__(
        self, thrusters: Thrusters, levelling: Levelling | None, tilt_limit: TiltLimit, max_force: Array
    ) -> None:
        """Take `max_force` (2,) of surge and sway, N."""
        self._levelling = levelling
        self._tilt_limit = tilt_limit
        self.retune(thrusters, max_force)
        self._pace = FULL_PACE
        self._active_wrench = ZERO
        """What the law last asked while ACTIVE: this is let go, evenly, whatever it would say by then."""
        self._wanted = Allocation(NEUTRAL, (False,) * 6)
        self._share = np.ones(4)
        self.delivered = ZERO
        """Body wrench that the last command, with the pilot's share, should have given, N and N·m."""
        self.saturated: Flags = (False, False, False, False)
        """By degree of freedom, whether the law did not get what it asked for."""

    def retune(self, thrusters: Thrusters, max_force: Array) -> None:
        """Go on with other limits."""
        self.thrusters, self._max_force = thrusters, max_force

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
            self._tilt_limit.reset()
            if self._levelling is not None:
                self._levelling.reset()
        tilt = coming_tilt(state.roll, state.pitch, state.p, state.q)
        self._share = self._tilt_share(tilt, state, reference, dt_s)
        pushed = self._share * np.array(self._active_wrench if verdict.state in RELEASING else requested)
        pushed[:3] = body_force(state.roll, state.pitch, tilt, tuple(pushed[:3].tolist()))
        moments = self._moments(pushed, verdict, state, engaged, dt_s)
        asked = AxisCommand(*(verdict.authority * tau for tau in (*pushed.tolist(), *moments)))
        axes, saturated = allocate(self.thrusters, asked, state.voltage_v, reach)
        wanted = AxisCommand(*axes)
        if not engaged[PSI]:  # unequal curves ask for a little, of a heading not ours
            wanted = wanted._replace(yaw=0.0)
        self._wanted = Allocation(wanted, saturated)
        return wanted

    def sent(self, command: AxisCommand, state: VehicleState) -> Vector:
        """Take what the vehicle makes of the command that went out.

        Return the wrench that it gives in the level frame of the heading, N and N·m.
        """
        wanted, saturated = self._wanted
        X, Y, Z, N, _, _ = delivered(self.thrusters, command, state.voltage_v)
        self.delivered = (X, Y, Z, N)
        level_x, level_y, level_z = level_force(state.roll, state.pitch, (X, Y, Z))
        cut_off = [abs(got - axis) > CUT_OFF for got, axis in zip(command, wanted, strict=True)]
        short = np.array(overloaded(self.thrusters, command)) | cut_off | saturated
        surge, sway, heave, yaw = (short[:4] | (self._share < 1.0)).tolist()
        self.saturated = by_dof((surge, sway, heave, yaw))
        return (level_x, level_y, level_z, N)

    def _tilt_share(self, tilt: float, state: VehicleState, reference: ReferenceModel, dt_s: float) -> Array:
        """Return the share (4,) of the law's force that the tilt leaves; what is let go is not pulled at.

        Heave is always ours. While the horizontal force is limited the reference stays near the vehicle.
        """
        pushed, asked = (math.hypot(*tau[:2]) for tau in (self.delivered, self._active_wrench))
        most_n = self._tilt_limit.step(tilt, pushed, dt_s)
        level = most_n / asked if asked > most_n else 1.0
        yaw = share(tilt, YAW_LEVEL_RAD, YAW_STEEP_RAD)
        x, y, z, psi = (
            pace.step(one, cut, dt_s) for one, cut in zip(self._pace, self.saturated, strict=True)
        )
        self._pace = (x, y, z, psi)
        x, y, z = (pace.on_a_tilt(one, share(tilt)) for one in (x, y, z))
        reference.pace = (x, y, z, psi)
        if level < 1.0:
            (x, y, _, _), (x_d, y_d, _, _) = state.eta_ahead, reference.x_d
            astray = math.hypot(x - x_d, y - y_d) > FOLLOWS_M
            gone = (astray, astray, False, yaw == 0.0)
            reference.catch_up(state.eta_ahead, state.eta_dot_ahead, gone)
        return np.array((level, level, 1.0, yaw))

    def _moments(
        self, pushed: Array, verdict: Verdict, state: VehicleState, engaged: Flags, dt_s: float
    ) -> tuple[float, float]:
        """Return the moments that keep it level, where those are ours.

        Beside what the law pushes on the axes that are held goes what the pilot pushes on the others.
        """
        if self._levelling is None:
            return (0.0, 0.0)
        K, M = self._levelling.step(
            np.array((state.roll, state.pitch)),
            np.array((state.p, state.q)),
            bounded(np.where(engaged[:2], pushed[:2], self.delivered[:2]), self._max_force),
            state.delays.total_s,
            dt_s,
            learn=verdict.authority == 1.0,
        ).tolist()
        return (K, M)
