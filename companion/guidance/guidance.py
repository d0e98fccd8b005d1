"""What is wanted: the setpoint, the target of now, the degrees of freedom that are held, the pilot's demand.

| word      | meaning                                                                            |
|-----------|------------------------------------------------------------------------------------|
| setpoint  | what the operator asked for; NaN: where the vehicle is when it is engaged           |
| target    | where each degree of freedom is to go now: the setpoint, as the pilot's sticks moved it |
| engaged   | degrees of freedom that the law holds                                               |
| released  | those that the pilot took back since it engaged; engaging again holds them again    |
"""

import math
from collections import deque
from collections.abc import Sequence

from msgspec.structs import replace

from companion.config import Config
from companion.control.bounds import clamped, wrap
from companion.control.frames import shifted, shifted_along
from companion.guidance.pilot import NO_DEMAND, NONE, Pilot, PilotDemand
from companion.records import (
    Event,
    Flags,
    FrameShift,
    Setpoint,
    State,
    Vector,
    VehicleState,
    Verdict,
    Z,
    chosen,
    either,
    vector,
)

UNSET: Vector = (math.nan, math.nan, math.nan, math.nan)


class Guidance:
    """The only owner of setpoint, target and held degrees of freedom."""

    def __init__(self, config: Config, setpoint: Setpoint) -> None:
        self._config = config
        self._pilot = Pilot(config)
        self._setpoint = self._target = checked(setpoint, config.supervisor.max_depth_m)
        self._start = self._target
        """Where it stays until it may push with all authority."""
        self.engaged = NONE
        self._released = NONE
        self._references: deque[tuple[float, Vector]] = deque()

    @property
    def target(self) -> Setpoint:
        """Where it is to go: x, y, z, psi, with rates and accelerations."""
        return self._target

    def aim(self, setpoint: Setpoint) -> None:
        """Take a new setpoint; its NaN targets stay what they are.

        Raises ValueError for one that is infinite, or deeper than `supervisor.max_depth_m`.
        """
        self._setpoint = checked(setpoint, self._config.supervisor.max_depth_m)
        self._target = _filled(setpoint, self._target.eta_d)

    def refuse(self, config: Config) -> None:
        """Raise ValueError where the present setpoint is not possible with `config`."""
        checked(self._setpoint, config.supervisor.max_depth_m)

    def retune(self, config: Config) -> None:
        """Go on with `config`."""
        self._config = config
        self._pilot.retune(config)

    def holdable(self, state: VehicleState) -> Flags:
        """Return the degrees of freedom that would be held if it engaged now."""
        positioned = state.ages.position_s <= self._config.supervisor.position_timeout_s
        return (positioned, positioned, True, self._config.vehicle.holds_heading)

    def pilot_demand(self, now_s: float, dt_s: float, events: Sequence[Event]) -> PilotDemand:
        """Return what the pilot demands this tick."""
        return self._pilot.step(now_s, dt_s, events, self.engaged, self._target.eta_d[Z])

    def update(self, before: Verdict, verdict: Verdict, state: VehicleState, *, engage: bool) -> Flags | None:
        """Take this tick's permission; `engage` tells that the operator asks for it now.

        Return the degrees of freedom that are held anew, whose reference starts where the vehicle is; None
        where all of it rests there.
        """
        if verdict.authority == 0.0:
            self._references.clear()
            self.engaged = NONE
            self._target = Setpoint(state.eta_ahead)
            return None
        if not before.authority > 0.0:
            self.engaged, self._released = self.holdable(state), NONE
            self._start = Setpoint(state.eta)
            self._target = _filled(self._setpoint, self._start.eta_d)
            return None
        if not (engage and verdict.state is State.ACTIVE):
            return NONE
        regained, self._released = self._released, NONE
        self._target = replace(self._target, eta_d=chosen(regained, state.eta, self._target.eta_d))
        self.engaged = either(self.engaged, regained)
        return regained

    def apply_pilot_demand(self, demand: PilotDemand, psi: float, x_d: Vector, dt_s: float) -> None:
        """Release the DOFs that the pilot overrides, and move the target as the sticks say.

        `psi` and `x_d` are the law's: the heading where the command acts, and the reference.
        """
        if demand is NO_DEMAND:
            return
        overridden = demand.overridden
        x, y, z, psi_held = (held and not lost for held, lost in zip(self.engaged, overridden, strict=True))
        self.engaged = (x, y, z, psi_held)
        self._released = either(self._released, overridden)
        self._target, moved = self._pilot.move(self._target, demand, psi, self.engaged, x_d, dt_s)
        eta_d = chosen(either(moved, overridden), UNSET, self._setpoint.eta_d)
        self._setpoint = replace(self._setpoint, eta_d=eta_d)

    def target_now(self, verdict: Verdict) -> Setpoint:
        """Return where the reference goes: while authority grows, it stays where it engaged."""
        growing = verdict.state is State.ACTIVE and verdict.authority < 1.0
        return self._start if growing else self._target

    def shift(self, shift: FrameShift, state: VehicleState) -> None:
        """Hold the same physical place and direction in the frame of a reset estimate."""
        self._target = replace(self._target, eta_d=shifted(shift, self._target.eta_d))
        self._start = replace(self._start, eta_d=shifted(shift, self._start.eta_d))
        moved = [
            held if engaged and math.isfinite(asked) else asked
            for engaged, held, asked in zip(
                self.engaged, self._target.eta_d, self._setpoint.eta_d, strict=True
            )
        ]
        self._setpoint = replace(self._setpoint, eta_d=vector(moved))
        self._references = deque(
            (t_s, shifted_along(shift, eta_d, state.eta)) for t_s, eta_d in self._references
        )

    def reference_now(self, ahead: Vector, state: VehicleState) -> Vector:
        """Take the reference of `state.ahead_s` from now; return that of now, which was taken before."""
        references = self._references
        references.append((state.t_s + state.ahead_s, ahead))
        while len(references) > 2 and references[1][0] <= state.t_s:
            references.popleft()
        (t_0, early), (t_1, late) = references[0], references[min(1, len(references) - 1)]
        share = clamped((state.t_s - t_0) / (t_1 - t_0), 0.0, 1.0) if t_1 > t_0 else 0.0
        x, y, z, psi = [a + (b - a) * share for a, b in zip(early, late, strict=True)]
        return (x, y, z, wrap(psi))


def checked(setpoint: Setpoint, max_depth_m: float) -> Setpoint:
    """Return a setpoint; raise ValueError for one that is infinite, or deeper than `max_depth_m`."""
    motion = (*setpoint.eta_d_dot, *setpoint.eta_d_ddot)
    infinite = any(map(math.isinf, setpoint.eta_d)) or not all(map(math.isfinite, motion))
    if infinite or setpoint.eta_d[Z] > max_depth_m:
        raise ValueError(
            f"setpoint {list(setpoint.eta_d)} (x, y, depth, heading): must be finite, "
            f"and no deeper than supervisor.max_depth_m = {max_depth_m:g}"
        )
    return setpoint


def _filled(setpoint: Setpoint, eta: Vector) -> Setpoint:
    """Return the setpoint with NaN targets replaced by `eta`."""
    x, y, z, psi = map(math.isnan, setpoint.eta_d)
    return replace(setpoint, eta_d=chosen((x, y, z, psi), eta, setpoint.eta_d))
