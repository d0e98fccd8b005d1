"""The human at the ground station: where the sticks move the setpoint, and which axes are taken back.

A stick on an axis that we hold is a rate, as fast as the axis' `max_rate` at most; released, it leaves the
new depth or heading to be held. Held at full deflection it takes the axis back; so does a button, for all.
Another button engages.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np

from companion import assembly
from companion.config import Config
from companion.control.bounds import bounded, wrap
from companion.control.positioning import to_inertial
from companion.records import PSI, Array, Event, Flags, PilotSticks, PilotToggle, Setpoint, X, Y, Z

STALE_S = 0.5
"""Sticks that came longer ago count as released."""


@dataclass(frozen=True, slots=True)
class PilotDemand:
    """What the pilot wants this tick, by axis (4,): surge, sway, heave, yaw.

    `sticks` is what to pass on, None if none came of late. `nu` and `nu_dot` are how the setpoint is to move
    (m/s, rad/s), zero where nothing is held. `taken` are held axes that the pilot takes back, `all` with a
    button. `engage` and `release` are those buttons: the one just pressed, the other down.
    """

    sticks: PilotSticks | None
    nu: Array
    nu_dot: Array
    taken: Flags
    all: bool
    engage: bool = False
    release: bool = False


NOTHING = PilotDemand(None, nu=np.zeros(4), nu_dot=np.zeros(4), taken=np.zeros(4, bool), all=False)


class Pilot:
    """Turns the pilot's frames into wishes, a tick at a time."""

    def __init__(self, config: Config) -> None:
        ground = config.ground_station
        self._full, self._full_s = ground.full_deflection, ground.full_deflection_s
        self._release = 1 << ground.release_button if ground.release_button >= 0 else 0
        self._engage = 1 << ground.engage_button if ground.engage_button >= 0 else 0
        self._engage_down = True
        """A button that is down when it is first heard of was not pressed."""
        self.retune(config)
        self._sticks: PilotSticks | None = None
        self._nu = np.zeros(4)
        self._moving = np.zeros(4, bool)
        self._pushed_s = np.zeros(4)
        self._busy = False

    def retune(self, config: Config) -> None:
        """Take limits and dead zone that were changed while running."""
        self._dead_zone = np.full(4, config.supervisor.pilot_deflection)
        self._max_depth_m = config.supervisor.max_depth_m
        self._max_rate = assembly.each(config, "max_rate")
        self._max_acceleration = assembly.each(config, "max_acceleration")

    def step(
        self, now_s: float, dt_s: float, events: Sequence[Event], held: Flags, depth_m: float
    ) -> PilotDemand:
        """Take what came since the last tick, which axes are held, and the depth that is wanted now."""
        buttons, toggled, engage = 0, False, False
        for event in events:
            if isinstance(event, PilotSticks):
                self._sticks = event
                buttons |= event.buttons
                down = bool(event.buttons & self._engage)
                engage |= down and not self._engage_down
                self._engage_down = down
            elif isinstance(event, PilotToggle):
                toggled |= event.on
        sticks = self._sticks
        if sticks is None or now_s - sticks.t_s > STALE_S:
            sticks, deflection = None, np.zeros(4)
        else:
            sticks = replace(sticks, buttons=sticks.buttons | buttons)
            deflection = np.array(astuple(sticks.sticks)[:4])
            self._busy = True
        if not (self._busy or toggled):
            return NOTHING
        dt_s = max(dt_s, 0.0)
        beyond = (deflection - bounded(deflection, self._dead_zone)) / (1.0 - self._dead_zone)
        wanted = beyond * self._max_rate * held
        if wanted[Z]:
            room_m = depth_m if wanted[Z] < 0.0 else self._max_depth_m - depth_m
            brakes_in_time = math.sqrt(2.0 * self._max_acceleration[Z] * max(room_m, 0.0))
            wanted[Z] = math.copysign(min(abs(wanted[Z]), brakes_in_time), wanted[Z])
        before = self._nu
        self._nu = (before + bounded(wanted - before, self._max_acceleration * dt_s)) * held
        self._busy = sticks is not None or bool(self._nu.any())
        self._pushed_s = np.where(held & (np.abs(deflection) >= self._full), self._pushed_s + dt_s, 0.0)
        return PilotDemand(
            sticks,
            nu=self._nu,
            nu_dot=(self._nu - before) * held / dt_s if dt_s > 0.0 else np.zeros(4),
            taken=self._pushed_s > self._full_s,
            all=bool(buttons & self._release) or toggled,
            engage=engage,
            release=bool(buttons & self._release),
        )

    def move(
        self, target: Setpoint, wish: PilotDemand, J: Array, held: Flags, x_d: Array, dt_s: float
    ) -> tuple[Setpoint, Flags]:
        """Return the target as the sticks move it, and which DOFs they move; J and `x_d` are the law's.

        A way that has only begun is given up: the first push counts from where the reference is.
        """
        rate = to_inertial(J, wish.nu) * held
        moving = rate != 0.0
        moving[[X, Y]] = moving[[X, Y]].any()
        changed = moving | self._moving
        begun = np.where(moving & ~self._moving, x_d, target.eta_d)
        self._moving = moving
        if not changed.any():
            return target, changed
        eta_d = begun + rate * dt_s
        eta_d[Z] = min(eta_d[Z], self._max_depth_m)
        eta_d[PSI] = wrap(eta_d[PSI])
        turn = to_inertial(J, wish.nu_dot) * moving
        rate, turn = np.where(changed, (rate, turn), (target.eta_d_dot, target.eta_d_ddot))
        return Setpoint(eta_d, rate, turn), changed
