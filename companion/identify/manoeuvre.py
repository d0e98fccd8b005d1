"""The manoeuvre of `holdfast identify`: each axis in turn is swept to and fro and pushed. No clock.

The engine holds the vehicle as ever: its supervisor permits, its guard limits, its pilot overrides. The
manoeuvre moves the setpoint along a slow sweep, which shows the damping, and adds quick pushes of both signs
to the law's force on the same axis, which show mass, lag and delay. It keeps what was sent and measured.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Generator, Iterator
from typing import Any, Final, NamedTuple

from companion.core.bounds import wrap
from companion.engine import Engine
from companion.identify.sample_table import Streams
from companion.records import (
    AXES,
    DOFS,
    PSI,
    ZERO,
    Attitude,
    ControlSample,
    Depth,
    DepthRate,
    Position,
    Request,
    Setpoint,
    State,
    Vector,
    X,
    Y,
    Z,
    vector,
)
from companion.telemetry.glossary import advised

ORDER: Final = (Z, PSI, X, Y)
WAIT_S: Final = 120.0
"""How long it waits for the permission to engage."""
SETTLE_S: Final = 4.0
LEAD_S: Final = 1.0
"""Recording begins this long before an axis moves: what acts at first was sent before."""
EDGE_S: Final = 3.0
"""The sweep grows and fades over this time; there are no pushes in the last of it."""
ENDING_S: Final = 15.0

SLOWEST_S: Final = 12.0
"""Period with which each sweep begins."""
PUSH_HZ: Final = (0.5, 2.5)
"""Frequency of the pushes: from the first to the last, evenly."""

STEEPEST_RAD: Final = math.radians(30.0)
SHALLOWEST_M: Final = 1.2
"""The least depth to begin at: the sweep in heave must not reach the surface."""


Steps = Generator["Asks", None, str]
"""Requests of each tick, and at the end why to stop; empty where there is no reason."""


class Excitation(NamedTuple):
    """What is done on an axis, and how far it may go: m, N; on yaw rad, N·m."""

    sweep: float
    push: float
    limit: float
    quickest_s: float
    """Period with which the sweep ends."""
    lasts_s: float


EXCITATIONS: Final = (
    Excitation(0.45, 22.0, 1.2, 6.5, 24.0),
    Excitation(0.45, 22.0, 1.2, 6.5, 24.0),
    Excitation(0.45, 30.0, 1.0, 5.0, 32.0),
    Excitation(0.8, 2.0, 1.7, 6.5, 16.0),
)
"""Surge, sway, heave, yaw."""


class Asks(NamedTuple):
    """What is asked of the engine's next tick: requests, and a body force beside the law's, N and N·m."""

    requests: tuple[Request, ...] = ()
    excitation: Vector = ZERO


NOTHING = Asks()


class Manoeuvre:
    """Call `step` after each of the engine's; ask the engine for what it returns; until `done`."""

    def __init__(self, report: Callable[[str], object] = lambda _: None) -> None:
        """`report` is told what it does whenever that changes."""
        self._report = report
        self._rows = defaultdict[str, Any](list)
        self.moved: list[int] = []
        """The axes that have been moved to the end."""
        self.done = False
        self.failure = ""
        """Why it was broken off; empty where it was not."""
        self.doing = ""
        self._script = self._manoeuvre()

    def step(self, engine: Engine, sample: ControlSample) -> Asks:
        """Take the engine's last tick; move its setpoint; return what to ask of the next one."""
        self._engine, self._sample = engine, sample
        return NOTHING if self.done else next(self._script, NOTHING)

    @property
    def streams(self) -> Streams:
        """What was sent and measured since it began."""
        return Streams(**self._rows)

    def _manoeuvre(self) -> Iterator[Asks]:
        """Give what is asked of each tick; in the end ask the engine to release, and wait until it has."""
        self.failure = yield from self._engaged()
        if not self.failure:
            self.failure = yield from self._excited(self._sample.state.eta)
        self._do("releasing")
        began_s = self._now_s
        yield Asks((Request.STOP,))
        while self._sample.verdict.authority > 0.0 and self._now_s - began_s < ENDING_S:
            yield NOTHING
        self.done = True

    def _do(self, what: str) -> None:
        if what != self.doing:
            self.doing = what
            self._report(what)

    def _engaged(self) -> Steps:
        began_s = self._now_s
        while (verdict := self._sample.verdict).state is not State.ACTIVE or verdict.authority != 1.0:
            self._do(advised(f"waiting: {verdict.reason}", verdict.remedy))
            if self._now_s - began_s > WAIT_S:
                return f"not permitted to engage: {verdict.reason}"
            yield NOTHING
        z_m = self._sample.state.eta[Z]
        return f"depth {z_m:.1f} m: at least {SHALLOWEST_M:g} m are needed" if z_m < SHALLOWEST_M else ""

    def _excited(self, home: Vector) -> Steps:
        """Move one axis after the other; return why it has to end before."""
        dofs = [dof for dof in ORDER if self._sample.dofs.engaged[dof]]
        for dof in dofs:
            began_s, kind = self._now_s + SETTLE_S + LEAD_S, EXCITATIONS[dof]
            while (t_s := self._now_s - began_s) < kind.lasts_s:
                if stop := self._out_of_bounds(home, dofs):
                    return stop
                self._do(f"settling before {AXES[dof]}" if t_s < -LEAD_S else AXES[dof])
                push = 0.0
                if t_s >= -LEAD_S:
                    self._engine.aim(_swept(home, dof, kind, t_s))
                    push = kind.push * pushing(t_s, kind)
                yield Asks(excitation=vector(push if axis == dof else 0.0 for axis in range(len(DOFS))))
                self._note()
            self.moved.append(dof)
            self._engine.aim(Setpoint(home))
        return ""

    def _out_of_bounds(self, home: Vector, dofs: list[int]) -> str:
        sample = self._sample
        state = sample.state
        if sample.verdict.state is not State.ACTIVE:
            return f"{sample.verdict.state}: {sample.verdict.reason}"
        if not all(sample.dofs.engaged[dof] for dof in dofs):
            return "the pilot took an axis"
        if max(abs(state.roll), abs(state.pitch)) > STEEPEST_RAD:
            return f"it tilted by more than {math.degrees(STEEPEST_RAD):.0f}°"
        for dof in dofs:
            away = state.eta[dof] - home[dof]
            if abs(wrap(away) if dof == PSI else away) > EXCITATIONS[dof].limit:
                unit = "rad" if dof == PSI else "m"
                return f"{AXES[dof]}: it went further than {EXCITATIONS[dof].limit:g} {unit}"
        return ""

    def _note(self) -> None:
        """Keep what was sent and measured, by its stamp on our clock."""
        rows, state, last = self._rows, self._sample.state, self._engine.last
        assert last is not None, "it is told after a tick"
        rows["sticks"].append((state.t_s, *last.guarded.applied))
        rows["voltage"].append((state.t_s, state.voltage_v))
        ahead_s = state.boot_s - state.t_s
        for event in last.heard.events:
            if not isinstance(event, Depth | DepthRate | Attitude | Position):
                continue
            stamp_s = event.boot_s
            t_s = event.t_s - state.delays.telemetry_s if stamp_s is None else stamp_s - ahead_s
            if isinstance(event, Attitude):
                rows["attitude"].append((t_s, event.roll, event.pitch, event.yaw))
                rows["rates"].append((t_s, event.p, event.q, event.r))
            elif isinstance(event, Depth):
                rows["depth"].append((t_s, event.z_m))
            elif isinstance(event, DepthRate):
                rows["down"].append((t_s, event.w_mps))
            else:
                rows["level"].append((t_s, event.vx_mps, event.vy_mps))
                rows["aided"].append((t_s, 1.0))

    @property
    def _now_s(self) -> float:
        return self._sample.state.t_s


def sweeping(t_s: float, kind: Excitation) -> float:
    """Return where the sweep is `t_s` after an axis began, -1..1: a sine that becomes quicker."""
    slow, quick = (2.0 * math.pi / period_s for period_s in (SLOWEST_S, kind.quickest_s))
    phase = slow * t_s + 0.5 * (quick - slow) * t_s**2 / kind.lasts_s
    edge = min(t_s, kind.lasts_s - t_s, EDGE_S) / EDGE_S
    return edge**3 * (10.0 - 15.0 * edge + 6.0 * edge**2) * math.sin(phase) if edge > 0.0 else 0.0


def pushing(t_s: float, kind: Excitation) -> float:
    """Return the push `t_s` after an axis began, -1, 0 or 1: a square wave that becomes quicker."""
    ends_s = kind.lasts_s - EDGE_S
    if not 0.0 <= t_s <= ends_s:
        return 0.0
    phase = PUSH_HZ[0] * t_s + 0.5 * (PUSH_HZ[1] - PUSH_HZ[0]) * t_s**2 / ends_s
    return 1.0 if (phase + 0.25) % 1.0 < 0.5 else -1.0


def _swept(home: Vector, dof: int, kind: Excitation, t_s: float) -> Setpoint:
    """Return the setpoint of the sweep with its rate and acceleration; surge and sway follow the heading."""
    step_s = 0.01
    earlier, now, later = (kind.sweep * sweeping(at_s, kind) for at_s in (t_s - step_s, t_s, t_s + step_s))
    course = home[PSI] + (0.5 * math.pi if dof == Y else 0.0)
    if dof in (X, Y):
        towards: Vector = (math.cos(course), math.sin(course), 0.0, 0.0)
    else:
        towards = vector(1.0 if index == dof else 0.0 for index in range(len(DOFS)))

    def along(value: float) -> Vector:
        return vector(value * part for part in towards)

    eta_d = vector(place + away for place, away in zip(home, along(now), strict=True))
    rate, acceleration = (later - earlier) / (2.0 * step_s), (later - 2.0 * now + earlier) / step_s**2
    return Setpoint(eta_d, along(rate), along(acceleration))
