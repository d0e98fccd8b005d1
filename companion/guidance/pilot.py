"""The pilot at the ground station: the sticks move the setpoint, or override an axis.

A stick on an axis that is held commands a rate, at most the axis' `max_rate`. Released, it leaves the new
depth or heading to be held. A stick at full deflection overrides its axis after FULL_DEFLECTION_S; the
release button and the firmware's toggles override all axes; the engage button engages, the hold button stops.
A command of the ground station does what the button does.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from companion.config import Config
from companion.core.actuation import NONE
from companion.core.bounds import limited, wrap
from companion.core.positioning import jacobian, to_body, to_inertial
from companion.guidance.fence import Bounds
from companion.records import (
    PSI,
    ZERO,
    Event,
    Flags,
    PilotAction,
    PilotCommand,
    PilotSticks,
    PilotToggle,
    Setpoint,
    Vector,
    VehicleState,
    X,
    Y,
    Z,
    chosen,
    either,
    vector,
)

STALE_S = 0.5
"""Sticks that came longer ago count as released."""
FULL_DEFLECTION, FULL_DEFLECTION_S = 0.95, 0.3
"""Share of its travel, and time: a stick beyond the one for longer than the other overrides its axis."""


class PilotDemand(NamedTuple):
    """What the pilot demands this tick. Vectors and flags in the order surge, sway, heave, yaw.

    `sticks` is what to pass on, None where none came of late. `nu` and `nu_dot` say how the setpoint is to
    move (m/s, rad/s), zero where nothing is held. `overridden` are degrees of freedom that were held until
    now; after a `full_override` none is held. `engage`, `release` and `hold` are the buttons: engage and hold
    were just pressed, release is down.
    """

    sticks: PilotSticks | None = None
    nu: Vector = ZERO
    nu_dot: Vector = ZERO
    overridden: Flags = NONE
    full_override: bool = False
    engage: bool = False
    release: bool = False
    hold: bool = False


NO_DEMAND = PilotDemand()


class PilotControl:
    """Turns the pilot's frames into demands, tick by tick."""

    def __init__(self, config: Config) -> None:
        ground = config.ground_station
        buttons = (ground.engage_button, ground.release_button, ground.hold_button)
        self._bits = {
            action: 1 << button for action, button in zip(PilotAction, buttons, strict=True) if button >= 0
        }
        self._down = -1
        """Buttons that were down in the frame before. One that is down in the first frame was not pressed."""
        self.retune(config)
        self._sticks: PilotSticks | None = None
        self._asked: tuple[float, Vector, bool] = (-math.inf, ZERO, True)
        self._nu = ZERO
        self._full_s = ZERO
        """How long each stick has been at full deflection."""
        self._moved = NONE
        self._busy = False

    def retune(self, config: Config) -> None:
        """Take limits and dead zone that were changed while running."""
        self._dead_zone = config.supervisor.pilot_deflection
        self._max_depth_m = config.supervisor.max_depth_m
        self._axes = config.axes

    def ask(self, until_s: float, velocity: Vector, *, body: bool) -> None:
        """Move like this, where the sticks are at rest, until then; what stops is held where it stands.

        `body` tells that the velocity is along the vehicle's axes, not north, east, down.
        """
        self._asked = (until_s, velocity, body)

    def step(
        self, state: VehicleState, dt_s: float, events: Sequence[Event], held: Flags, depth_m: float
    ) -> PilotDemand:
        """Take this tick's events, which axes are held, and the depth that is wanted now."""
        buttons, toggled, asked_for = self._heard(events)
        sticks = self._sticks
        if sticks is None or state.t_s - sticks.t_s > STALE_S:
            sticks, deflections = None, ZERO
        else:
            sticks = msgspec.structs.replace(sticks, buttons=sticks.buttons | buttons)
            stick = sticks.sticks
            deflections = (stick.surge, stick.sway, stick.heave, stick.yaw)
            self._busy = True
        until_s, asked, body = self._asked
        if state.t_s >= until_s:
            asked = ZERO
        elif not body:
            asked = to_body(jacobian(state.eta_ahead[PSI]), asked)
        if not (self._busy or toggled or asked_for or any(asked)):
            return NO_DEMAND
        nu, nu_dot = self._rates(deflections, asked, held, depth_m, max(dt_s, 0.0))
        self._nu = nu
        self._busy = sticks is not None or any(nu)
        overridden = self._overridden(deflections, held, max(dt_s, 0.0))
        release = PilotAction.RELEASE in asked_for
        return PilotDemand(
            sticks,
            nu=nu,
            nu_dot=nu_dot,
            overridden=overridden,
            full_override=release or toggled or (overridden != NONE and overridden == held),
            engage=PilotAction.ENGAGE in asked_for,
            release=release,
            hold=PilotAction.HOLD in asked_for,
        )

    def move(
        self,
        target: Setpoint,
        demand: PilotDemand,
        psi: float,
        held: Flags,
        x_d: Vector,
        bounds: Bounds,
        dt_s: float,
    ) -> tuple[Setpoint, Flags]:
        """Return the target as the sticks move it, and the degrees of freedom that they move.

        `psi` is the law's heading and `x_d` its reference. The first push counts from the reference: a target
        that it has not reached yet is given up. It stops before the fence.
        """
        J = jacobian(psi)
        asked = chosen(held, to_inertial(J, demand.nu), ZERO)
        rate = bounds.fence.braked(target.eta_d, asked, bounds.max_acceleration)
        free = vector(slow == fast for slow, fast in zip(rate, asked, strict=True))
        rate_dot = chosen(free, to_inertial(J, demand.nu_dot), ZERO)
        horizontal = rate[X] != 0.0 or rate[Y] != 0.0
        moving = (horizontal, horizontal, rate[Z] != 0.0, rate[PSI] != 0.0)
        moved_before, self._moved = self._moved, moving
        if moving == moved_before == NONE:
            return target, NONE
        x, y, z, heading = (
            (reached if moves and not moved else place) + speed * dt_s
            for reached, place, speed, moves, moved in zip(
                x_d, target.eta_d, rate, moving, moved_before, strict=True
            )
        )
        changed = either(moving, moved_before)
        return Setpoint(
            (x, y, min(z, self._max_depth_m), wrap(heading)),
            chosen(changed, rate, target.eta_d_dot),
            chosen(changed, chosen(moving, rate_dot, ZERO), target.eta_d_ddot),
        ), changed

    def _heard(self, events: Sequence[Event]) -> tuple[int, bool, set[PilotAction]]:
        """Return which buttons were down, whether a toggle went on, and what buttons and commands ask for."""
        buttons, toggled, asked_for = 0, False, set[PilotAction]()
        for event in events:
            if isinstance(event, PilotSticks):
                self._sticks = event
                buttons |= event.buttons
                pressed, self._down = event.buttons & ~self._down, event.buttons
                for action, bit in self._bits.items():
                    if (event.buttons if action is PilotAction.RELEASE else pressed) & bit:
                        asked_for.add(action)
            elif isinstance(event, PilotCommand):
                asked_for.add(event.action)
            elif isinstance(event, PilotToggle):
                toggled |= event.on
        return buttons, toggled, asked_for

    def _rates(
        self, deflections: Vector, asked: Vector, held: Flags, depth_m: float, dt_s: float
    ) -> tuple[Vector, Vector]:
        """Return the setpoint's body velocity and its derivative, within the axes' limits.

        They are the sticks', or what is `asked` where those are at rest.
        """
        wanted = [
            (beyond(deflection, self._dead_zone) * axis.max_rate or limited(rate, axis.max_rate))
            if is_held
            else 0.0
            for deflection, rate, axis, is_held in zip(deflections, asked, self._axes, held, strict=True)
        ]
        if wanted[Z]:
            room_m = depth_m if wanted[Z] < 0.0 else self._max_depth_m - depth_m
            brakes_in_time = math.sqrt(2.0 * self._axes[Z].max_acceleration * max(room_m, 0.0))
            wanted[Z] = math.copysign(min(abs(wanted[Z]), brakes_in_time), wanted[Z])
        nu = vector(
            previous + limited(rate - previous, axis.max_acceleration * dt_s) if is_held else 0.0
            for previous, rate, axis, is_held in zip(self._nu, wanted, self._axes, held, strict=True)
        )
        if dt_s == 0.0:
            return nu, ZERO
        changes = zip(nu, self._nu, held, strict=True)
        return nu, vector((now - old) / dt_s if is_held else 0.0 for now, old, is_held in changes)

    def _overridden(self, deflections: Vector, held: Flags, dt_s: float) -> Flags:
        """Return the degrees of freedom whose stick has been at full deflection for long enough.

        Surge and sway turn into x and y: either overrides both.
        """
        self._full_s = vector(
            full_s + dt_s if is_held and abs(deflection) >= FULL_DEFLECTION else 0.0
            for full_s, deflection, is_held in zip(self._full_s, deflections, held, strict=True)
        )
        surge, sway, heave, yaw = (full_s > FULL_DEFLECTION_S for full_s in self._full_s)
        return (surge or sway, surge or sway, heave, yaw)


def beyond(deflection: float, dead_zone: float) -> float:
    """Return how far a stick is out of its dead zone, -1..1."""
    return (deflection - limited(deflection, dead_zone)) / (1.0 - dead_zone)
