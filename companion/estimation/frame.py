"""The frame inside, where the vehicle never jumps (ROS: odom), and where the EKF's frame (map) lies.

| symbol | meaning                                                            | unit |
|--------|--------------------------------------------------------------------|------|
| p_in   | place inside                                                       | m    |
| p_ekf  | the same place for the EKF: p_ekf = R(turn) p_in + (north, east)   | m    |
| ψ_ekf  | heading: ψ_in + turn                                               | rad  |
| owed   | sum of the fixes that are not yet followed                         | m    |
| sunk   | how much deeper relative_alt reads: z_ekf = z_in + sunk            | m    |

A reset of the EKF changes this offset alone. After a fix of a slow source, such as USBL, the offset
goes back slowly, so that the vehicle follows to the numbers that it was given. Depth is z_in outside too:
what an operator asks for is in the water, whose surface stays where it was known to be.
"""

import math
from typing import Any, NamedTuple

from msgspec.structs import replace

from companion.core.bounds import wrap
from companion.core.positioning import jacobian, to_body, to_inertial
from companion.records import Current, Dofs, Setpoint, Vector, VehicleState

RESET_M = 1.0
"""Jumps that come to more are a reset: what is wanted stays where it lies."""

RESET_LASTS_S = 10.0
"""Jumps so soon after a reset belong to it."""

FOLLOWED_S, FOLLOWED_MPS = 20.0, 0.03
"""Jumps that come to less are fixes: so slowly, and no faster, the vehicle follows them."""


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
    """Of the places that an operator gives: there the vehicle ends."""
    owed: tuple[float, float] = (0.0, 0.0)
    reset_t_s: float = -math.inf
    sunk_m: float = 0.0

    @property
    def now(self) -> Offset:
        """Of what is measured in this tick."""
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

    def jumped(self, north_m: float, east_m: float, t_s: float, *, held: bool) -> "Frame":
        """Return the frame after a jump of the position; `held`: a place was held at that time."""
        owed = (self.owed[0] + north_m, self.owed[1] + east_m)
        reset_t_s = t_s if math.hypot(*owed) > RESET_M else self.reset_t_s
        jumped = self._replace(owed=owed, reset_t_s=reset_t_s)
        return jumped if held and t_s - reset_t_s > RESET_LASTS_S else jumped.stayed()

    def stayed(self) -> "Frame":
        """Return the frame that stays as it is now: nothing is left to follow."""
        return self._replace(settled=self.now, owed=(0.0, 0.0))

    def followed(self, dt_s: float, *, held: bool) -> "Frame":
        """Return the frame a tick later; where no place is held there is nothing to follow."""
        if not any(self.owed):
            return self
        if not held:
            return self.stayed()
        share = min(1.0 / FOLLOWED_S, FOLLOWED_MPS / math.hypot(*self.owed))
        left = 1.0 - share * dt_s
        return self._replace(owed=(left * self.owed[0], left * self.owed[1]))

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


HERE = Offset()
