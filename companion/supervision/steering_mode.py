"""Which flight mode to request: the steering mode while engaged, the previous mode after release."""

from companion.records import State
from companion.telemetry.modes import Mode

STEERING_MODES = {"manual": Mode.MANUAL, "stabilize": Mode.STABILIZE}
"""`vehicle.steering_mode`: in MANUAL yaw is ours, in STABILIZE the firmware keeps roll, pitch and heading."""

GIVEN_BACK = frozenset({Mode.MANUAL, Mode.STABILIZE, Mode.ALT_HOLD, Mode.POSHOLD, Mode.SURFTRAK})
"""Modes that are safe to restore while nobody watches the vehicle."""

HOLDS_DEPTH = frozenset({Mode.ALT_HOLD, Mode.POSHOLD, Mode.SURFTRAK})
"""Entered directly from MANUAL the vehicle can sink in these (docs/ardusub.md, "Modes and arming")."""

GIVE_BACK_S = 5.0
"""The previous mode is requested for this time, then no longer."""

VIA_STABILIZE_CALLS = 2


class ModeKeeper:
    """Stores the mode before engaging and restores it after a release.

    Nothing is restored if the pilot changed the mode, or after a fault. The SURFACE mode of a failsafe is
    always kept.
    """

    def __init__(self, steering: Mode) -> None:
        self.steering = steering
        self._previous_mode: Mode | None = None
        self._mode = -1
        self._released_s: float | None = None
        self._restores = 0

    def wanted(self, now_s: float, mode: int, state: State, *, engage: bool) -> Mode | None:
        """Return the mode to ask for at `now_s`, None for leave it; `mode` is the heartbeat's."""
        self._mode = mode
        if state in (State.PILOT, State.FAULT, State.HAND_OVER):
            self._previous_mode = None
            return None
        if engage or state in (State.ACTIVE, State.RAMP_DOWN):
            self._released_s = None
            if mode in GIVEN_BACK and mode != self.steering:
                self._previous_mode = Mode(mode)
            return None if mode == Mode.SURFACE else self.steering
        if self._released_s is None:
            self._released_s = now_s
        if now_s - self._released_s > GIVE_BACK_S or not self._is_ours(mode):
            self._previous_mode = None
        return self._next(mode)

    def restore_mode(self) -> Mode | None:
        """Return the mode to ask for with each frame of shutdown, one after the other; None for leave it."""
        if not self._is_ours(self._mode):
            return None
        self._restores += 1
        via = self._restores <= VIA_STABILIZE_CALLS
        return self._next(self._mode) if via else self._previous_mode

    def _is_ours(self, mode: int) -> bool:
        return mode != self._previous_mode and mode in (self.steering, Mode.STABILIZE)

    def _next(self, mode: int) -> Mode | None:
        if self._previous_mode in HOLDS_DEPTH and mode != Mode.STABILIZE:
            return Mode.STABILIZE
        return self._previous_mode
