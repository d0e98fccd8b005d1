"""The only owner of the flight mode: for steering, for hand-over and for restoring the previous mode.

It also decides whether a steering frame is sent: with authority, and for a short time after it, so that the
autopilot's failsafe does not detect a lost pilot at once.
"""

import math
from collections.abc import Mapping

from companion.records import Condition, State, VehicleState, Verdict, Z
from companion.supervision.handover import AT_SURFACE_M, KEEP_ALIVE_S, HandOver, HandOverStep
from companion.telemetry.modes import FAILSAFE, Mode

STEERING_MODES = {"manual": Mode.MANUAL, "stabilize": Mode.STABILIZE}
"""`vehicle.steering_mode`: in MANUAL yaw is ours, in STABILIZE the firmware keeps roll, pitch and heading."""
GIVEN_BACK = frozenset({Mode.MANUAL, Mode.STABILIZE, Mode.ALT_HOLD, Mode.POSHOLD, Mode.SURFTRAK})
"""Modes that are safe to restore while nobody watches the vehicle."""
HOLDS_DEPTH = frozenset({Mode.ALT_HOLD, Mode.POSHOLD, Mode.SURFTRAK})
"""Entered directly from MANUAL the vehicle can sink in these (docs/ardusub.md, "Modes and arming")."""
GIVE_BACK_S = 5.0
"""The previous mode is requested for this time, then no longer."""
VIA_STABILIZE_CALLS = 2
"""Frames of shutdown that request STABILIZE first: one may be lost."""
NEUTRAL_FRAMES_S = 0.5
"""Neutral frames are sent this long after our steering, or that of a companion that failed. Then silence, so
that the autopilot's failsafe detects a lost pilot."""


class FlightMode:
    """Requests modes, and knows whether the vehicle follows our frames.

    The mode of before engaging is restored after a release, unless the pilot changed the mode, or after a
    fault. The SURFACE mode of a failsafe is always kept.
    """

    def __init__(self, steering: Mode) -> None:
        self._steering = steering
        self._previous_mode: Mode | None = None
        self._mode = -1
        self._released_s: float | None = None
        self._restores = 0
        self._hand_over = HandOver()
        self._neutral_until_s = self._kept_alive_s = -math.inf
        self._had_authority = self._heard = False

    def step_hand_over(
        self,
        verdict: Verdict,
        state: VehicleState,
        parameters: Mapping[str, float],
        pilot_heard_s: float,
        keep_s: float,
    ) -> HandOverStep:
        """Continue a hand-over if `verdict`, the last tick's, is in HAND_OVER."""
        if verdict.state is not State.HAND_OVER:
            return HandOverStep.NONE
        surface_m = -0.01 * parameters.get("SURFACE_DEPTH", -10.0)
        return self._hand_over.step(
            state.t_s,
            state.mode,
            thrusting=verdict.authority > 0.0,
            pilot_heard_s=pilot_heard_s,
            keep_s=keep_s,
            at_surface=state.eta[Z] <= surface_m + AT_SURFACE_M,
        )

    def is_right(self, verdict: Verdict, mode: int) -> bool:
        """Tell whether the state of `verdict` may steer or hand over in `mode`."""
        return self._hand_over.allows(mode) if verdict.state is State.HAND_OVER else mode == self._steering

    def update(self, previous: Verdict, verdict: Verdict, state: VehicleState) -> None:
        """Begin a hand-over if `verdict` requires one."""
        if verdict.state is not State.HAND_OVER:
            return
        surfaces = Condition.FAILSAFE_SURFACES in verdict.conditions
        if previous.state is not State.HAND_OVER or surfaces:
            up = surfaces or Condition.PILOT_LOST_SURFACE in verdict.conditions
            tilted = Condition.TILT_PERSISTS in verdict.conditions
            goal = Mode.SURFACE if up else Mode.ALT_HOLD
            self._hand_over.begin(state.t_s, state.mode, goal, for_good=tilted)

    def wanted(self, verdict: Verdict, state: VehicleState, *, engage: bool) -> Mode | None:
        """Return the mode to request now; None for no request."""
        now_s, self._mode = state.t_s, state.mode
        mode = self._mode
        if verdict.state in (State.PILOT, State.FAULT, State.HAND_OVER):
            self._previous_mode = None
            return self._hand_over.wanted if verdict.state is State.HAND_OVER else None
        if engage or verdict.state in (State.ACTIVE, State.RAMP_DOWN):
            self._released_s = None
            if mode in GIVEN_BACK and mode != self._steering:
                self._previous_mode = Mode(mode)
            return None if mode == Mode.SURFACE else self._steering
        if self._released_s is None:
            self._released_s = now_s
        if now_s - self._released_s > GIVE_BACK_S or not self._is_ours(mode):
            self._previous_mode = None
        return self._next(mode)

    def restore_mode(self) -> Mode | None:
        """Return the mode to request with each frame of shutdown, one after the other; None for leave it."""
        if not self._is_ours(self._mode):
            return None
        self._restores += 1
        via = self._restores <= VIA_STABILIZE_CALLS
        return self._next(self._mode) if via else self._previous_mode

    def _is_ours(self, mode: int) -> bool:
        return mode != self._previous_mode and mode in (self._steering, Mode.STABILIZE)

    def _next(self, mode: int) -> Mode | None:
        if self._previous_mode in HOLDS_DEPTH and mode != Mode.STABILIZE:
            return Mode.STABILIZE
        return self._previous_mode

    def steers(self, verdict: Verdict, state: VehicleState) -> bool:
        """Tell whether a steering frame is sent: while ACTIVE or with authority, and NEUTRAL_FRAMES_S longer.

        During a hand-over neutral frames continue; they are slower when ALT_HOLD is confirmed.
        """
        now_s = state.t_s
        if verdict.state is State.HAND_OVER and verdict.authority == 0.0:
            kept_alive = self._hand_over.held and now_s - self._kept_alive_s < KEEP_ALIVE_S
            self._kept_alive_s = self._kept_alive_s if kept_alive else now_s
            self._neutral_until_s, self._had_authority = now_s, False
            return not kept_alive
        holds = verdict.state is State.ACTIVE or verdict.authority > 0.0
        if holds or self._had_authority or self._finds_it_steered(state):
            self._neutral_until_s = now_s + NEUTRAL_FRAMES_S
        self._had_authority = verdict.authority > 0.0
        return now_s <= self._neutral_until_s

    def _finds_it_steered(self, state: VehicleState) -> bool:
        """Tell, at the first heartbeat, whether commands are in force, perhaps of a companion that failed.

        If nobody steers, nothing may be sent: frames would count as a pilot, the silence after them as a lost
        pilot, and the autopilot would disarm a vehicle that somebody else has armed meanwhile.
        """
        previous, self._heard = self._heard, self._heard or math.isfinite(state.ages.heartbeat_s)
        return self._heard and not previous and state.armed and state.system_status != FAILSAFE
