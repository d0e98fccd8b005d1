"""The steps of `holdfast check`: listen, test what may be tested, fill in the list. No clock.

It never steers unless asked to try the thrusters, and then a vehicle in the water alone. One that nobody has
armed it arms for that, and disarms again.
"""

from collections.abc import Callable, Iterator, Sequence

import msgspec
import numpy as np

from companion import assembly
from companion.config import Config, GroundStation
from companion.core import observers
from companion.core.actuation import NONE
from companion.core.allocation import motors
from companion.mavlink.ardusub import motor_demand
from companion.mavlink.autopilot import Autopilot
from companion.mavlink.signing import Signing
from companion.predive import directions
from companion.predive.check import CheckRow, rows
from companion.predive.directions import Sample
from companion.predive.survey import Directions, Survey
from companion.records import (
    NEUTRAL,
    Attitude,
    AxisCommand,
    Condition,
    DepthRate,
    Event,
    LoopHealth,
    Sender,
    ServoOutput,
    VehicleState,
)
from companion.supervision.situation import Observation
from companion.supervision.supervision import Supervision
from companion.telemetry.modes import Mode

CONTACT_S = 10.0
LISTEN_S = 12.0
SETTLE_S = 4.0
"""Shortest time to listen: measuring rates, delays and the clock takes seconds."""

SYNCS = 8
TRY_S = 2.0
AGAIN_S = 0.5
SURFACE_M = 0.3
NEUTRAL_S = 0.5
ARM_S = 6.0
"""How long arming and disarming may take."""
ECHO_SETTLED_S = 0.1
DISARM = 2.0


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
        self._thrusters = assembly.thrusters(config)
        self._estimator = assembly.estimator(config)
        self._observers = assembly.observers(config)
        self._observed = observers.start(self._observers)
        self._survey = Survey(self._autopilot)
        alone = msgspec.structs.replace(config, ground_station=GroundStation())
        self._supervision = Supervision(alone, self._autopilot.parameters, arm=False)
        self._conditions = Condition(0)
        self._origin = origin
        self._tries_thrusters = thrusters
        self._modes: dict[str, bool] | None = None
        self._directions: Directions | None = None
        self._pushing = False
        self._arms = False
        """Whether it has asked to arm: then it disarms too."""
        self._events: list[Event] = []
        self._out: list[bytes] = []
        self._now_s = 0.0
        self._state: VehicleState | None = None
        self._script = self._inspect()
        self.done = False
        self.notes: list[str] = []
        """What was done besides listening, for people."""

    def step(self, now_s: float, datagrams: Sequence[tuple[int, bytes]]) -> list[bytes]:
        """Advance one tick: take what arrived (monotonic ns, bytes), return what to send."""
        self._now_s = now_s
        self._events = self._autopilot.receive(datagrams)
        observed, inputs = self._estimator.take(now_s, self._events, self._observed)
        self._observed, motion = observers.step(self._observers, observed, inputs)
        self._state = self._estimator.state(inputs, motion, self._observed.learner.model)
        self._survey.take(self._events)
        observation = Observation(
            state=self._state,
            dt_s=1.0 / self._config.loop.rate_hz,
            loop=LoopHealth(0, 0.0, 0.0, 0.0, 0, 0),
            held=NONE,
            events=self._events,
        )
        self._conditions = self._supervision.step(observation).conditions
        self._out = self._autopilot.upkeep(now_s, self._events, mode=None, arm=self._arms and self._pushing)
        if not self.done:
            self.done = next(self._script, True) is True
        return self._out

    def sender(self, datagram: bytes) -> Sender:
        """Tell whether a datagram is our vehicle's, for a link that listens (`Autopilot.sender`)."""
        return self._autopilot.sender(datagram)

    def hello(self) -> bytes:
        """Return a heartbeat for a sender that is not yet our peer (`Autopilot.hello`)."""
        return self._autopilot.hello()

    def shutdown_frames(self) -> list[bytes]:
        """Return the frames that end an interrupted inspection: neutral if a thruster may turn."""
        if not self._pushing:
            return []
        return [self._autopilot.neutral(), *([self._autopilot.disarm()] if self._arms else [])]

    @property
    def rows(self) -> list[CheckRow]:
        """The list as far as it is known."""
        seen = self._survey.observed(
            self._seen, modes=self._modes, directions=self._directions, conditions=self._conditions
        )
        return rows(seen, self._config)

    @property
    def _seen(self) -> VehicleState:
        assert self._state is not None
        return self._state

    def _inspect(self) -> Iterator[None]:
        yield from self._wait(CONTACT_S, lambda: self._seen.ages.heartbeat_s < CONTACT_S)
        if not self._seen.ages.heartbeat_s < CONTACT_S:
            return
        began_s = self._now_s
        yield from self._wait(LISTEN_S, lambda: self._now_s - began_s > SETTLE_S and self._heard_enough())
        if self._origin is not None:
            yield from self._set_origin(*self._origin)
        yield from self._try_modes()
        if self._tries_thrusters:
            yield from self._try_thrusters()

    def _wait(self, seconds: float, until: Callable[[], bool]) -> Iterator[None]:
        end_s = self._now_s + seconds
        while self._now_s < end_s and not until():
            yield

    def _heard_enough(self) -> bool:
        seen = self._survey.observed(self._seen)
        return (
            seen.firmware is not None
            and seen.syncs >= SYNCS
            and seen.depth_hz > 0.0
            and bool(seen.toggles)
            and self._autopilot.all_parameters_known
        )

    def _set_origin(self, latitude_deg: float, longitude_deg: float) -> Iterator[None]:
        if self._survey.observed(self._seen).origin_known:
            self.notes.append("the EKF origin was already set and is unchanged")
        elif not self._seen.eta[2] < SURFACE_M:
            self.notes.append(
                f"the EKF origin was not set: the vehicle is dived ({self._seen.eta[2]:.1f} m); surface first"
            )
        else:
            self._out.append(self._autopilot.set_origin(latitude_deg, longitude_deg))
            yield from self._wait(TRY_S, lambda: self._survey.observed(self._seen).origin_known)
            known = self._survey.observed(self._seen).origin_known
            self.notes.append(f"the EKF origin {'was set' if known else 'was requested, but not confirmed'}")

    def _try_modes(self) -> Iterator[None]:
        """Request each needed mode from a disarmed vehicle, and then its previous mode."""
        if self._seen.armed:
            self._modes = {}
            return
        previous_mode = self._seen.mode
        tried = {}
        for mode in (Mode.MANUAL, Mode.STABILIZE):
            yield from self._ask_mode(mode)
            tried[mode.name] = self._seen.mode == mode
        if previous_mode in tuple(Mode):
            yield from self._ask_mode(Mode(previous_mode))
        self._modes = tried

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
        yield from self._keep_armed()
        samples: dict[str, list[Sample]] = {}
        starts_s: dict[str, float] = {}
        echoes: list[tuple[float, float]] = []
        for axis in directions.DEMANDS:
            starts_s[axis], samples[axis] = self._now_s, []
            while (since_s := self._now_s - starts_s[axis]) < 2.0 * directions.PULSE_S + directions.REST_S:
                if stopped := self._why_stop():
                    self._directions = Directions(refused=stopped)
                    yield from self._rest()
                    return
                command = directions.command(axis, since_s)
                self._note(samples[axis], echoes, command, since_s)
                self._out.append(self._autopilot.steer(command, self._seen.pilot_gain))
                yield
        yield from self._rest()
        if previous_mode != Mode.MANUAL and previous_mode in tuple(Mode):
            yield from self._ask_mode(Mode(previous_mode))
        delays = self._seen.delays
        shares = directions.shares(
            self._config.vehicle.frame,
            samples,
            starts_s,
            inertia={"w": self._config.heave.mass, "r": self._config.yaw.mass},
            lag_s=self._config.thrusters.from_rest_s,
            delay_s=delays.total_s,
        )
        asked, came = np.array(echoes or [(1.0, 0.0)]).T
        self._directions = Directions(motors=shares, echo=float(asked @ came / (asked @ asked)))

    def _keep_armed(self) -> Iterator[None]:
        """Arm a vehicle that nobody has armed, with neutral frames, so that its failsafe sees somebody."""
        self._arms = not self._seen.armed
        end_s = self._now_s + ARM_S
        while self._now_s < end_s and not self._seen.armed:
            self._out.append(self._autopilot.steer(NEUTRAL, self._seen.pilot_gain))
            yield

    def _rest(self) -> Iterator[None]:
        """End neutral; disarm what it has armed."""
        end_s = self._now_s + NEUTRAL_S
        while self._now_s < end_s:
            self._out.append(self._autopilot.steer(NEUTRAL, self._seen.pilot_gain))
            yield
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

    def _note(
        self, samples: list[Sample], echoes: list[tuple[float, float]], command: AxisCommand, since_s: float
    ) -> None:
        """Keep the rates that came, and beside each motor's demand what the autopilot says it got."""
        settled = since_s % directions.PULSE_S > ECHO_SETTLED_S and since_s < 2.0 * directions.PULSE_S
        asked = motors(self._thrusters, command)[: self._thrusters.motor_count]
        for event in self._events:
            if isinstance(event, Attitude):
                samples += [Sample(event.t_s, name, getattr(event, name)) for name in ("p", "q", "r")]
            elif isinstance(event, DepthRate):
                samples.append(Sample(event.t_s, "w", event.w_mps))
            elif isinstance(event, ServoOutput) and settled:
                echoes += zip(asked, motor_demand(event.pwm_us[: len(asked)]), strict=True)
