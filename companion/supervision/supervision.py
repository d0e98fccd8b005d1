"""Permission for each tick: observations give conditions, conditions and the table give a `Verdict`.

This package alone owns the state, the flight mode and the request to engage.
"""

import math
from collections.abc import Mapping

from companion.config import Config
from companion.records import Condition, State, VehicleState, Verdict
from companion.supervision.engagement import Engagement
from companion.supervision.flight_mode import STEERING_MODES, FlightMode
from companion.supervision.monitor import Monitor
from companion.supervision.rules import assess
from companion.supervision.situation import Observation, Situation, Watched
from companion.supervision.supervisor import JUST_STARTED, StateMachine
from companion.telemetry.glossary import Details
from companion.telemetry.modes import Mode

C = Condition
DISARM = 2.0
"""FS_PILOT_INPUT."""
SILENT_S = 1.5
"""A ground station repeats the sticks at least once a second."""
BEAT_S, LEAST_S = 1.5, 1e-3
"""LEAST_S is reported until a heartbeat, BEAT_S later at most, says that the vehicle was disarmed."""


class Supervision:
    """The only owner of state, permission and flight mode."""

    def __init__(self, config: Config, parameters: Mapping[str, float], *, arm: bool) -> None:
        """Take the autopilot's `parameters`, which keep changing."""
        self._machine = StateMachine(config.supervisor.ramp_down_s, config.supervisor.ramp_up_s)
        self._monitor = Monitor()
        self.engagement = Engagement(arm=arm)
        self._flight_mode = FlightMode(STEERING_MODES[config.vehicle.steering_mode])
        self._config = config
        self._parameters = parameters
        self.verdict = JUST_STARTED
        self._steered_s = self._held_s = -math.inf

    def retune(self, config: Config, *, changed: bool) -> None:
        """Go on with `config`."""
        limits = config.supervisor
        self._machine.ramp_up_s, self._machine.ramp_down_s = limits.ramp_up_s, limits.ramp_down_s
        self._config = config
        if changed:
            self._monitor.config_changed()

    def step(self, observed: Observation) -> Verdict:
        """Return who may steer this tick."""
        config, mode, previous = self._config, self._flight_mode, self.verdict
        limits, state, dt_s = config.supervisor, observed.state, observed.dt_s
        active, steered = previous.state is State.ACTIVE, previous.authority > 0.0
        tick_s = 1.0 / config.loop.rate_hz
        self.engagement.step(observed.requests, observed.events, self._parameters, state.t_s)
        hand_over = mode.step_hand_over(
            previous, state, self._parameters, self._monitor.pilot_heard_s, limits.keep_alt_hold_s
        )
        watched = self._monitor.step(observed, config, self._parameters, previous)
        now = Situation(
            observed=observed,
            state=state,
            watched=watched,
            parameters=self._parameters,
            ground_station=config.ground_station,
            tick_s=tick_s,
            mode_right=mode.is_right(previous, state.mode),
            active=active,
            steered=steered,
            hand_over=hand_over,
            ramped_down=self._machine.ramped_down(dt_s),
            engage=self.engagement.asked,
        )
        details = {**observed.details, **self.engagement.details, **_found(watched, state)}
        verdict = self._machine.step(assess(now, limits), dt_s, details)
        mode.update(previous, verdict, state)
        self.engagement.update(verdict, state.mode, details)
        self.verdict = verdict
        return verdict

    def steers(self, state: VehicleState) -> bool:
        """Tell whether a steering frame goes out this tick."""
        steers = self._flight_mode.steers(self.verdict, state)
        self._steered_s = state.t_s if steers else self._steered_s
        self._held_s = state.t_s if self.verdict.authority > 0.0 else self._held_s
        return steers

    def disarms_in_s(self, state: VehicleState) -> float:
        """Return how long the autopilot still waits for a pilot; 0 where one steers or it does not disarm."""
        waits = state.armed and self.verdict.authority == 0.0 and self.verdict.state is not State.HAND_OVER
        if not waits or self._parameters.get("FS_PILOT_INPUT") != DISARM:
            return 0.0
        heard_s = self._monitor.pilot_heard_s
        if heard_s > self._held_s and state.t_s - heard_s < SILENT_S:
            return 0.0
        left_s = max(self._steered_s, heard_s) + self._parameters.get("FS_PILOT_TIMEOUT", 0.0) - state.t_s
        return max(left_s, LEAST_S) if left_s > -BEAT_S else 0.0

    def wanted_mode(self, state: VehicleState) -> Mode | None:
        """Return the flight mode to request; None for no request."""
        return self._flight_mode.wanted(self.verdict, state, engage=self.engagement.asked)

    def restore_mode(self) -> Mode | None:
        """Return the flight mode to request with each shutdown frame; None for no request."""
        return self._flight_mode.restore_mode()


def _found(watched: Watched, state: VehicleState) -> Details:
    """Return details of conditions that were found now, and remedies in place of the usual ones."""
    found = {}
    if watched.interruption:
        found[C.INTERRUPTED_OFTEN] = (watched.interruption, "")
    for doubt, doubted, stale in (
        (state.depth_doubt, C.DEPTH_DOUBTED, C.DEPTH_STALE),
        (state.attitude_doubt, C.ATTITUDE_DOUBTED, C.ATTITUDE_STALE),
        (state.position_doubt, C.POSITION_DOUBTED, C.POSITION_STALE),
    ):
        if doubt:
            found |= {doubted: (doubt, ""), stale: (doubt, doubted.remedy)}
    if watched.pull_n >= 1.0:
        newtons = 10.0 * math.ceil(0.1 * watched.pull_n)
        found[C.SATURATED] = ("", f"it takes {newtons:.0f} N: {C.SATURATED.remedy}")
    return found
