"""The steps of `holdfast check`: listen, try what was asked for, fill in the list. No clock.

It never steers unless asked to try the thrusters, and then a vehicle in the water alone. One that nobody has
armed it arms for that, and disarms again.
"""

from collections.abc import Callable, Iterator, Sequence

import msgspec

from companion import assembly
from companion.config import Config, GroundStation
from companion.core import observers
from companion.core.actuation import NONE
from companion.estimation.belief import believed
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.signing import Signing
from companion.predive import directions
from companion.predive.check import CheckRow, rows
from companion.predive.directions import RateSample
from companion.predive.survey import Directions, Observed, Survey
from companion.records import (
    NEUTRAL,
    Attitude,
    AxisCommand,
    Condition,
    DepthRate,
    Event,
    LoopHealth,
    VehicleState,
)
from companion.supervision.situation import Observation
from companion.supervision.supervision import DISARM, Supervision
from companion.telemetry.modes import Mode

CONTACT_S = 10.0
"""How long a heartbeat, one a second, is waited for: a router may have to find us first."""
LISTEN_S, SETTLE_S = 12.0, 4.0
"""Longest and shortest time to listen: measuring rates, delays and the clock takes seconds."""
TRY_S, AGAIN_S = 2.0, 0.5
"""How long a mode or the origin is asked for, and how often: a message may be lost."""
SURFACE_M = 0.3
"""Deeper, the vehicle is in the water: a motor that turns in air runs dry."""
NEUTRAL_S = 0.5
"""25 frames: that one arrives is certain."""
ARM_S = 6.0
"""How long arming and disarming may take."""


class Inspection:
    """The inspection of one vehicle: call `step` at the loop's rate until `done`, then read `rows`."""

    def __init__(
        self,
        config: Config,
        *,
        origin: tuple[float, float] | None = None,
        thrusters: bool = False,
        signing: Signing | None = None,
    ) -> None:
        self._config = config
        self._autopilot = Autopilot(config, signing)
        self.heard = self._autopilot.heard
        self.sender, self.hello = self._autopilot.sender, self._autopilot.hello
        """Both are what a listening link needs (`Autopilot`)."""
        self._estimator, self._surroundings = assembly.estimator(config), assembly.surroundings(config)
        self._observers = assembly.observers(config)
        self._observed = observers.start(self._observers)
        self._survey = Survey(self._autopilot)
        alone = msgspec.structs.replace(config, ground_station=GroundStation())
        self._supervision = Supervision(alone, self._autopilot.parameters, arm=False)
        self._conditions = Condition(0)
        self._directions: Directions | None = None
        self._pushing = self._arms = False
        """Whether a thruster may turn, and whether it has asked to arm: then it disarms too."""
        self._events: list[Event] = []
        self._out: list[bytes] = []
        self._now_s = 0.0
        self._seen: VehicleState
        self._script = self._inspect(origin, thrusters)
        self.done = False
        self.notes: list[str] = []
        """What was done besides listening, for people."""

    def step(self, now_s: float, datagrams: Sequence[tuple[int, bytes]]) -> list[bytes]:
        """Advance one tick: take what arrived (monotonic ns, bytes), return what to send."""
        self._now_s = now_s
        self._events = self._autopilot.receive(datagrams)
        sensed = self._estimator.take(now_s, self._events, observers.outlook(self._observed))
        if sensed.restarted:
            self._observed = observers.restarted(self._observed)
        self._observed, motion = observers.step(self._observers, self._observed, sensed.inputs)
        model = self._observed.learner.model
        self._seen = believed(sensed, motion, self._surroundings.step(sensed, motion, model), model)
        self._survey.take(self._events)
        observation = Observation(
            state=self._seen,
            dt_s=1.0 / self._config.loop.rate_hz,
            loop=LoopHealth(0, 0.0, 0.0, 0.0, 0, 0),
            held=NONE,
            events=self._events,
        )
        self._conditions = self._supervision.step(observation).conditions
        self._out = self._autopilot.upkeep(now_s, self._events, mode=None, arm=self._arms and self._pushing)
        self.done = self.done or next(self._script, True) is True
        return self._out

    def shutdown_frames(self) -> list[bytes]:
        """Return the frames that end an interrupted inspection: neutral if a thruster may turn."""
        if not self._pushing:
            return []
        return [self._autopilot.neutral(), *([self._autopilot.disarm()] if self._arms else [])]

    @property
    def rows(self) -> list[CheckRow]:
        """The list as far as it is known."""
        return rows(self.observed, self._config)

    @property
    def observed(self) -> Observed:
        """What was seen of the vehicle so far."""
        return self._survey.observed(self._seen, self._conditions, self._directions)

    def _inspect(self, origin: tuple[float, float] | None, thrusters: bool) -> Iterator[None]:
        yield from self._wait(CONTACT_S, lambda: self._seen.ages.heartbeat_s < CONTACT_S)
        if not self._seen.ages.heartbeat_s < CONTACT_S:
            return
        settled_s = self._now_s + SETTLE_S
        yield from self._wait(LISTEN_S, lambda: self._now_s > settled_s and self._heard_enough())
        if origin is not None:
            yield from self._set_origin(*origin)
        if thrusters:
            yield from self._try_thrusters()

    def _wait(self, seconds: float, until: Callable[[], bool] = lambda: False) -> Iterator[None]:
        end_s = self._now_s + seconds
        while self._now_s < end_s and not until():
            yield

    def _heard_enough(self) -> bool:
        seen = self.observed
        known = seen.firmware is not None and bool(seen.toggles) and self._autopilot.all_parameters_known
        return known and seen.state.delays.telemetry_known and bool(seen.measured_hz)

    def _set_origin(self, latitude_deg: float, longitude_deg: float) -> Iterator[None]:
        depth_m = self._seen.eta[2]
        if self.observed.origin_known:
            note = "was already set and is unchanged"
        elif not depth_m < SURFACE_M:
            note = f"was not set: the vehicle is under water ({depth_m:.1f} m); surface first"
        else:
            self._out.append(self._autopilot.set_origin(latitude_deg, longitude_deg))
            yield from self._wait(TRY_S, lambda: self.observed.origin_known)
            note = "was set" if self.observed.origin_known else "was requested, but not confirmed"
        self.notes.append(f"the EKF origin {note}")

    def _ask_mode(self, mode: Mode) -> Iterator[None]:
        for _ in range(round(TRY_S / AGAIN_S)):
            if self._seen.mode == mode:
                return
            self._out.append(self._autopilot.set_mode(mode))
            yield from self._wait(AGAIN_S, lambda: self._seen.mode == mode)

    def _try_thrusters(self) -> Iterator[None]:
        if why_not := self._why_not():
            self._directions = Directions(refused=why_not)
            return
        previous_mode = self._seen.mode
        yield from self._ask_mode(Mode.MANUAL)
        self._directions, self._pushing = Directions(refused="the test was interrupted"), True
        self._arms = not self._seen.armed
        yield from self._steer_neutral(ARM_S, until_armed=True)
        samples: dict[str, list[RateSample]] = {}
        starts_s: dict[str, float] = {}
        for axis in directions.DEMANDS:
            starts_s[axis], samples[axis] = self._now_s, []
            while (since_s := self._now_s - starts_s[axis]) < 2.0 * directions.PULSE_S + directions.REST_S:
                if stopped := self._why_stop():
                    self._directions = Directions(refused=stopped)
                    yield from self._rest()
                    return
                samples[axis] += _rates(self._events)
                self._steer(directions.command(axis, since_s))
                yield
        yield from self._rest()
        if previous_mode != Mode.MANUAL and previous_mode in tuple(Mode):
            yield from self._ask_mode(Mode(previous_mode))
        shares = directions.shares(
            self._config.vehicle.frame,
            samples,
            starts_s,
            inertia={"w": self._config.heave.mass, "r": self._config.yaw.mass},
            lag_s=self._config.thrusters.from_rest_s,
            delay_s=self._seen.delays.total_s,
        )
        self._directions = Directions(motors=shares)

    def _steer(self, command: AxisCommand) -> None:
        self._out.append(self._autopilot.steer(command, self._seen.pilot_gain))

    def _steer_neutral(self, seconds: float, *, until_armed: bool = False) -> Iterator[None]:
        """Send neutral frames: an autopilot that is to arm has to see somebody."""
        for _ in self._wait(seconds, lambda: until_armed and self._seen.armed):
            self._steer(NEUTRAL)
            yield

    def _rest(self) -> Iterator[None]:
        """End neutral; disarm what it has armed."""
        yield from self._steer_neutral(NEUTRAL_S)
        self._pushing = False
        if self._arms:
            self._out.append(self._autopilot.disarm())
            yield from self._wait(ARM_S, lambda: not self._seen.armed)
            state = "is still armed" if self._seen.armed else "was armed for the test and disarmed after it"
            self.notes.append(f"the vehicle {state}")
        elif self._autopilot.parameters.get("FS_PILOT_INPUT") == DISARM:
            self.notes.append("nobody steers now: FS_PILOT_INPUT disarms the vehicle unless a pilot steers")

    def _why_stop(self) -> str:
        if not self._seen.armed:
            return "the vehicle did not arm, or was disarmed"
        return self._why_not() or ("the mode was changed" if self._seen.mode != Mode.MANUAL else "")

    def _why_not(self) -> str:
        state = self._seen
        if not state.ages.depth_s < 1.0:
            return "there is no depth, so the vehicle may be out of the water"
        if not state.eta[2] >= SURFACE_M:
            return f"the vehicle is not in the water (depth {state.eta[2]:.1f} m, at least {SURFACE_M:g} m)"
        return ""


def _rates(events: Sequence[Event]) -> Iterator[RateSample]:
    for event in events:
        if isinstance(event, Attitude):
            for name in ("p", "q", "r"):
                yield RateSample(event.t_s, name, getattr(event, name))
        elif isinstance(event, DepthRate):
            yield RateSample(event.t_s, "w", event.w_mps)
