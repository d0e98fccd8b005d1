"""The frame inside, where the vehicle never jumps (ROS: odom), and where the EKF's frame (map) lies.

| symbol | meaning                                                            | unit |
|--------|--------------------------------------------------------------------|------|
| p_in   | place inside                                                       | m    |
| p_ekf  | the same place for the EKF: p_ekf = R(turn) p_in + (north, east)   | m    |
| ψ_ekf  | heading: ψ_in + turn                                               | rad  |
| owed   | sum of the fixes that are not yet followed                         | m    |
| sunk   | how much deeper relative_alt reads: z_ekf = z_in + sunk            | m    |

A reset of the EKF changes this offset alone. After a fix of a slow source, such as USBL, the offset goes
back, so that the vehicle follows to the numbers that it was given:

    owed'' = −ω² owed − 2 ω owed'      ω = FOLLOWED_RADPS, within FOLLOWED_MPS and FOLLOWED_MPS2

A single jump counts as a fix up to RESET_M. Those that have kept coming for STREAM_S are fixes up to
FIX_RATIO times what is usual: errors of fixes, and of the EKF's velocity between them.

Depth is z_in outside too: what an operator asks for is in the water, whose surface stays where it was known
to be.
"""

import math
from typing import Any, NamedTuple

from msgspec.structs import replace

from companion.core.bounds import wrap
from companion.core.positioning import jacobian, to_body, to_inertial
from companion.records import Current, Dofs, Setpoint, Vector, VehicleState

RESET_M = 1.0
"""Single jumps that come to more are a reset: what is wanted stays where it lies."""

RESET_LASTS_S = 10.0
"""Jumps within this time of a reset belong to it."""

FOLLOWED_RADPS, FOLLOWED_MPS, FOLLOWED_MPS2 = 0.3, 0.3, 0.1
"""How soon and how fast the vehicle follows a fix."""

STREAM_S, STREAM_GAP_S = 9.0, 60.0
USUAL_S, FIX_RATIO = 20.0, 5.0
"""The usual jump is the RMS over this time, each jump counted with RESET_M at most."""


DIRECTED = (
    *("x_d_dot", "x_d_ddot", "x_dot", "e", "e_dot", "eps"),
    *("tau", "feedforward", "feedback", "d_hat", "d_observer"),
)
"""What is inside the law and has a direction, beside places."""


class Offset(NamedTuple):
    """Where the EKF's frame lies, as seen from the frame inside; vectors and poses in DOF order."""

    turn_rad: float = 0.0
    north_m: float = 0.0
    east_m: float = 0.0

    def outward(self, vector: Vector) -> Vector:
        """Return a velocity, a force or the like in the EKF's frame."""
        return to_inertial(jacobian(self.turn_rad), vector) if self.turn_rad else vector

    def inward(self, vector: Vector) -> Vector:
        """Return the inverse of `outward`."""
        return to_body(jacobian(self.turn_rad), vector) if self.turn_rad else vector

    def outside(self, eta: Vector) -> Vector:
        """Return a pose in the EKF's frame; psi is wrapped where it has turned."""
        x, y, z, psi = self.outward(eta)
        return (x + self.north_m, y + self.east_m, z, self.heading_outside(psi))

    def inside(self, eta: Vector) -> Vector:
        """Return the inverse of `outside`."""
        x, y, z, psi = eta
        x, y, z, psi = self.inward((x - self.north_m, y - self.east_m, z, psi))
        return (x, y, z, self.heading_inside(psi))

    def heading_outside(self, psi: float) -> float:
        """Return a heading in the EKF's frame."""
        return wrap(psi + self.turn_rad) if self.turn_rad else psi

    def heading_inside(self, psi: float) -> float:
        """Return the inverse of `heading_outside`."""
        return wrap(psi - self.turn_rad) if self.turn_rad else psi

    def setpoint_outside(self, setpoint: Setpoint) -> Setpoint:
        """Return a pose, its rate and its acceleration in the EKF's frame."""
        if self == HERE:
            return setpoint
        rate, acceleration = self.outward(setpoint.eta_d_dot), self.outward(setpoint.eta_d_ddot)
        return Setpoint(self.outside(setpoint.eta_d), rate, acceleration)

    def setpoint_inside(self, setpoint: Setpoint) -> Setpoint:
        """Return the inverse of `setpoint_outside`."""
        if self == HERE:
            return setpoint
        rate, acceleration = self.inward(setpoint.eta_d_dot), self.inward(setpoint.eta_d_ddot)
        return Setpoint(self.inside(setpoint.eta_d), rate, acceleration)


class Frame(NamedTuple):
    """The offset as it will be when all fixes have been followed, and what is left to follow (m)."""

    settled: Offset = Offset()
    """The offset of places that an operator gives: the vehicle ends there."""
    owed: tuple[float, float] = (0.0, 0.0)
    follows: tuple[float, float] = (0.0, 0.0)
    drift: tuple[float, float] = (0.0, 0.0)
    """How fast the offset moves, m/s: to follow fixes, and with the error of the EKF's velocity."""
    reset_t_s: float = -math.inf
    jumped_t_s: float = -math.inf
    jumps_since_s: float = -math.inf
    usual_m: float = 0.0
    sunk_m: float = 0.0

    @property
    def now(self) -> Offset:
        """The offset of what is measured in this tick."""
        if not any(self.owed):
            return self.settled
        turn_rad, north_m, east_m = self.settled
        return Offset(turn_rad, north_m + self.owed[0], east_m + self.owed[1])

    def turned(self, turn_rad: float, north_m: float, east_m: float) -> "Frame":
        """Return the frame after a reset of yaw about the vehicle, which the EKF has at this place."""
        inside = self.now.inside((north_m, east_m, 0.0, 0.0))
        turn_rad = wrap(self.settled.turn_rad + turn_rad)
        x, y, _, _ = Offset(turn_rad).outside(inside)
        return self._replace(settled=Offset(turn_rad, north_m - self.owed[0] - x, east_m - self.owed[1] - y))

    def has_fixes(self, t_s: float) -> bool:
        """Tell whether jumps have kept coming."""
        stream_s = self.jumped_t_s - self.jumps_since_s
        return stream_s >= STREAM_S and t_s - self.jumped_t_s <= STREAM_GAP_S

    def jumped(
        self,
        north_m: float,
        east_m: float,
        t_s: float,
        faster: tuple[float, float] = (0.0, 0.0),
        *,
        held: bool,
    ) -> "Frame":
        """Return the frame after a jump of the position, and of the velocity by `faster` (m/s).

        `held`: a place was held at that time.
        """
        gap_s, old_m2 = t_s - self.jumped_t_s, self.usual_m**2
        begins = gap_s > STREAM_GAP_S
        new_m2 = min(math.hypot(north_m, east_m), RESET_M) ** 2
        usual_m = math.sqrt(new_m2 + (old_m2 - new_m2) * math.exp(-gap_s / USUAL_S))
        seen = self._replace(
            owed=(self.owed[0] + north_m, self.owed[1] + east_m),
            drift=(self.drift[0] + faster[0], self.drift[1] + faster[1]),
            jumped_t_s=t_s,
            jumps_since_s=t_s if begins else self.jumps_since_s,
            usual_m=0.0 if begins else usual_m,
        )
        stream = seen.has_fixes(t_s)
        most_m = max(RESET_M, FIX_RATIO * seen.usual_m) if stream else RESET_M
        if math.hypot(*seen.owed) > most_m:
            seen = seen._replace(reset_t_s=t_s)
        if not held or not (stream or t_s - seen.reset_t_s > RESET_LASTS_S):
            return seen.stayed()
        if seen.reset_t_s == t_s:  # what was owed before it is followed on
            turn_rad, x_m, y_m = self.settled
            return seen._replace(settled=Offset(turn_rad, x_m + north_m, y_m + east_m), owed=self.owed)
        return seen

    def stayed(self) -> "Frame":
        """Return the frame that stays as it is now: nothing is left to follow."""
        return self._replace(settled=self.now, owed=(0.0, 0.0), follows=(0.0, 0.0), drift=(0.0, 0.0))

    def followed(self, dt_s: float, drift: complex = 0j, *, held: bool) -> "Frame":
        """Return the frame a tick later; where no place is held there is nothing to follow.

        `drift` is by how much the EKF's velocity is wrong, north + i east, m/s.
        """
        if not (drift or any(self.owed) or any(self.drift)):
            return self
        if not held:
            return self.stayed()
        owed, follows, drifts = complex(*self.owed), complex(*self.follows), complex(*self.drift)
        rise = -FOLLOWED_RADPS * (FOLLOWED_RADPS * owed + 2.0 * follows)
        follows = bounded(follows + bounded(rise, FOLLOWED_MPS2) * dt_s, FOLLOWED_MPS)
        drifts += bounded(drift - drifts, FOLLOWED_MPS2 * dt_s)
        owed += (follows + drifts) * dt_s
        return self._replace(
            owed=(owed.real, owed.imag),
            follows=(follows.real, follows.imag),
            drift=(drifts.real, drifts.imag),
        )

    def velocity_inside(self, north_mps: float, east_mps: float) -> tuple[float, float]:
        """Return a velocity that the EKF measured as it is inside, where this frame moves."""
        (f_n, f_e), (d_n, d_e) = self.follows, self.drift
        u, v, _, _ = self.settled.inward((north_mps - f_n - d_n, east_mps - f_e - d_e, 0.0, 0.0))
        return u, v

    def reported_state(self, state: VehicleState) -> VehicleState:
        """Return in the EKF's frame what the estimator believes."""
        now, current = self.now, state.current
        if now == HERE:
            return state
        north_mps, east_mps, _, _ = now.outward((current.north_mps, current.east_mps, 0.0, 0.0))
        return replace(
            state,
            eta=now.outside(state.eta),
            eta_dot=now.outward(state.eta_dot),
            eta_ahead=now.outside(state.eta_ahead),
            eta_dot_ahead=now.outward(state.eta_dot_ahead),
            disturbance=now.outward(state.disturbance),
            current=Current(north_mps, east_mps, current.doubt_mps),
        )

    def reported_dofs(self, dofs: Dofs) -> Dofs:
        """Return in the EKF's frame what is inside the law. What has no direction stays with its axis."""
        now = self.now
        if now == HERE:
            return dofs
        turned: Any = {name: now.outward(getattr(dofs, name)) for name in DIRECTED}
        return dofs._replace(x_d=now.outside(dofs.x_d), x=now.outside(dofs.x), **turned)


def bounded(vector: complex, most: float) -> complex:
    """Return a vector of at most this length."""
    return vector * most / abs(vector) if abs(vector) > most else vector


HERE = Offset()
