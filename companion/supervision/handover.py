"""The hand-over to the autopilot's depth hold or ascent, and the neutral frames that keep it armed.

docs/supervisor.md describes it. A vehicle that enters ALT_HOLD directly from MANUAL can sink by half a metre;
through STABILIZE with neutral throttle it does not (docs/ardusub.md, "Modes and arming", "Silence").
"""

from enum import Enum, auto

from companion.telemetry.modes import Mode

SETTLE_S = 1.0
"""Neutral frames are sent in STABILIZE for this time: the vehicle comes to rest."""
REFUSED_S = 8.0
"""Twice the usual time: a ramp, the second of neutral, and two modes, each confirmed within a second."""
KEEP_ALIVE_S = 1.0
"""FS_PILOT_TIMEOUT is 3 s by default; 0.36 Hz would do."""
AT_SURFACE_M = 0.5
"""The firmware may detect the surface this far below SURFACE_DEPTH: its zero of depth differs from ours."""


class HandOverStep(Enum):
    """The result of one tick of the hand-over; HELD: ALT_HOLD is confirmed and kept alive."""

    NONE = auto()
    RUNNING = auto()
    HELD = auto()
    DONE = auto()
    REFUSED = auto()
    SURFACED = auto()


class HandOver:
    """The steps of one hand-over to `goal`, ALT_HOLD or SURFACE; `begin` starts again."""

    def __init__(self) -> None:
        self.begin(0.0, Mode.MANUAL, Mode.ALT_HOLD)

    def begin(self, now_s: float, mode: int, goal: Mode, *, for_good: bool = False) -> None:
        """Start from flight mode `mode`; `for_good` keeps the goal alive until somebody steers."""
        self.goal = goal
        self._rises = goal is Mode.SURFACE
        self._for_good = for_good or self._rises
        self._came_from = mode
        self._since_s = now_s
        self._stable_s: float | None = None
        self._held_s: float | None = None
        self.wanted: Mode | None = None
        """The flight mode to ask for."""

    def step(
        self,
        now_s: float,
        mode: int,
        *,
        thrusting: bool,
        pilot_heard_s: float,
        keep_s: float,
        at_surface: bool = False,
    ) -> HandOverStep:
        """Go on at `now_s` with the heartbeat's `mode`."""
        if self.goal is Mode.SURFACE and self.held and mode == Mode.ALT_HOLD and at_surface:
            self.goal = Mode.ALT_HOLD
            return HandOverStep.SURFACED
        if mode == self.goal:
            self._held_s = now_s if self._held_s is None else self._held_s
            self.wanted = None
            kept = now_s - self._held_s < keep_s or self._for_good
            if pilot_heard_s > self._held_s or not kept:
                return HandOverStep.DONE
            return HandOverStep.RUNNING if self._rises else HandOverStep.HELD
        if now_s - self._since_s > REFUSED_S:
            return HandOverStep.REFUSED
        if thrusting:
            return HandOverStep.RUNNING
        if mode == Mode.STABILIZE and self._stable_s is None:
            self._stable_s = now_s
        settled = self._stable_s is not None and now_s - self._stable_s >= SETTLE_S
        self.wanted = self.goal if settled else Mode.STABILIZE
        return HandOverStep.RUNNING

    def allows(self, mode: int) -> bool:
        """Tell whether `mode` belongs to the sequence; somebody else chose any other mode."""
        if self._held_s is not None:
            return mode == self.goal
        if self._stable_s is not None:
            return mode in (Mode.STABILIZE, self.goal)
        return mode in (self._came_from, Mode.STABILIZE, self.goal)

    @property
    def held(self) -> bool:
        """Whether the heartbeat confirmed `goal`."""
        return self._held_s is not None
