"""Observations over time: how long something has lasted, and what was reported recently."""

import math
from collections.abc import Mapping

from companion.config import Config, SupervisorLimits
from companion.records import (
    PSI,
    Dofs,
    EkfStatus,
    Event,
    Heartbeat,
    Leak,
    OtherHoldfast,
    Parameter,
    PilotInput,
    PilotSticks,
    Reboot,
    State,
    Verdict,
    Z,
)
from companion.records.state import CONTACT_S
from companion.supervision.situation import (
    Observation,
    Watched,
    ekf_is_doubtful,
    interruption,
    tilted,
    upside_down,
    voltage_is_low,
)
from companion.telemetry.modes import FAILSAFE, Mode

FAILSAFE_SETTLE_S = 1.5
"""A silent companion latches the pilot failsafe; the first heartbeat of its steering may still report it."""
LEAK_REPEAT_S = 25.0
"""ArduSub repeats the report of a leak every 20 s."""
ANNOUNCED_S = 2.0
"""How long an event that is over is reported: screens are read at some Hz."""
INNOVATION_MEMORY_S = 0.5
"""A single sample that is wrong is no failure: the mean is over 25 ticks."""
STEADY_S = 60.0
"""For this time after an interruption the next one is not reported anew."""
RECOVERS_PER_S = 0.1
"""A second with full authority reduces the lost authority by this."""
RECOVERS_S = 5.0
"""After a motor was found dead or reversed the vehicle may be off track for this time: it is turned back."""
UNSATURATED_COUNTS = 0.5
"""Share of the unsaturated time that is subtracted: waves that saturate a third of the time are too much."""
UPRIGHT_COUNTS = 0.25
"""The same of the time upright: a vehicle that turns over and over is upside down for four tenths of it."""
DEPTH_HELD_M = 0.3
"""A tilted vehicle whose depth error is below this is not handed over: ALT_HOLD would let it sink."""
UNANSWERED_M = 0.05
"""A vehicle whose depth changes by less than this answers no thrust."""
FULL_THRUST = 0.95
"""This share of `max_force` is full thrust: a load of 0.9 of it is held."""
OTHER_S = 3.0
"""A Holdfast heard within this time of our first contact was there before us. After this time without a frame
it has left. One that came after us gives way within this time."""
LISTENS_S = 1.0
"""Another Holdfast is heard within this time of the contact; before it nobody engages."""

NEVER = -math.inf


class Monitor:
    """Observes every tick; durations and recent reports stand in `watched`."""

    def __init__(self) -> None:
        self.watched = Watched()
        self.pilot_heard_s = NEVER
        """When somebody else last sent a steering message, deflected or not."""
        self._pilot_t_s = self._leak_t_s = self._rebooted_t_s = self._interrupted_t_s = NEVER
        self._changed_t_s = self._dropped_t_s = self._peer_t_s = NEVER
        self._pilot_deflection = 0.0
        self._heartbeat: Heartbeat | None = None
        self._steering_since_s: float | None = None
        self._contact_s: float | None = None
        self._dropped = self._peer_changes = 0
        self._bad_motor, self._found_since_s = 0, NEVER
        self._mean_innovation = [0.0] * 4
        self._pushed_at_m = math.nan
        """The depth from which the vehicle moved last."""
        self._other_since_s = self._other_t_s = NEVER
        self._other_first = False

    def config_changed(self) -> None:
        """Note that our configuration changed, between two ticks."""
        self._changed_t_s = math.inf

    def step(
        self,
        observed: Observation,
        config: Config,
        parameters: Mapping[str, float],
        previous: Verdict,
    ) -> Watched:
        """Observe one tick; `parameters` are those before its events, `previous` is the last verdict."""
        state, loop, now_s, limits = observed.state, observed.loop, observed.state.t_s, config.supervisor
        self._changed_t_s = min(self._changed_t_s, now_s)
        for event in observed.events:
            self._hear(event, limits, parameters)
        self._contact_s = _since(self._contact_s, now_s, holds=state.ages.link_s <= CONTACT_S)
        self._steering_since_s = _since(self._steering_since_s, now_s, holds=previous.authority > 0.0)
        if loop.peer_changes > self._peer_changes:
            self._peer_changes, self._peer_t_s = loop.peer_changes, now_s
        if loop.samples_dropped > self._dropped:
            self._dropped, self._dropped_t_s = loop.samples_dropped, now_s
        self._measure(observed, config, previous)
        self._average(observed)
        watched, other_here = self.watched, now_s - self._other_t_s <= OTHER_S
        pilot_steers = now_s - self._pilot_t_s <= limits.pilot_hold_s
        watched.pilot_deflection = self._pilot_deflection if pilot_steers else 0.0
        watched.failsafe = self._failsafe()
        watched.other_first = other_here and self._other_first
        watched.other_came = other_here and not self._other_first
        watched.listened = self._contact_s is not None and now_s - self._contact_s >= LISTENS_S
        watched.rebooted = now_s - self._rebooted_t_s <= ANNOUNCED_S
        watched.leaking = now_s - self._leak_t_s <= LEAK_REPEAT_S
        watched.unsteady = now_s - self._interrupted_t_s <= STEADY_S
        watched.samples_dropped = now_s - self._dropped_t_s <= ANNOUNCED_S
        watched.peer_changed = now_s - self._peer_t_s <= ANNOUNCED_S
        watched.config_changed = now_s - self._changed_t_s <= ANNOUNCED_S
        return watched

    def _hear(self, event: Event, limits: SupervisorLimits, parameters: Mapping[str, float]) -> None:
        watched = self.watched
        match event:
            case Heartbeat():
                latches = watched.failsafe_surfaces or self._latches(event)
                watched.failsafe_surfaces = event.mode == Mode.SURFACE and latches
                self._heartbeat = event
            case PilotSticks():
                self.pilot_heard_s = event.t_s
            case PilotInput():
                self.pilot_heard_s = event.t_s
                if event.deflection > limits.pilot_deflection:
                    self._pilot_t_s, self._pilot_deflection = event.t_s, event.deflection
            case OtherHoldfast():
                self._hear_other(event)
            case EkfStatus():
                watched.ekf = event
            case Leak():
                self._leak_t_s = event.t_s
            case Parameter() if parameters.get(event.name, event.value) != event.value:
                self._changed_t_s = event.t_s
            case Reboot():
                self._rebooted_t_s, watched.ekf = event.t_s, None

    def _measure(self, observed: Observation, config: Config, previous: Verdict) -> None:
        """Count how long each lasts that has to last; while steering is interrupted, what lasted goes on."""
        watched, dt_s, state, dofs = self.watched, observed.dt_s, observed.state, observed.dofs
        active, limits = previous.state is State.ACTIVE, config.supervisor
        paused = interruption(observed, limits, 1.0 / config.loop.rate_hz) if active else ""
        off_track = depth_held = False
        if paused:
            off_track = watched.off_track_s > 0.0
        elif dofs is not None and previous.authority > 0.0:
            largest = [limits.max_error_m] * PSI + [math.radians(limits.max_error_deg)]
            for held, e, most in zip(observed.held, dofs.e, largest, strict=True):
                off_track = off_track or (held and not abs(e) <= most)
            depth_held = observed.held[Z] and abs(dofs.e[Z]) <= DEPTH_HELD_M
        if (bad_motor := state.dead_motor - state.reversed_motor) != self._bad_motor:
            self._bad_motor, self._found_since_s = bad_motor, state.t_s
        recovers = state.t_s - self._found_since_s <= RECOVERS_S
        doubtful = watched.ekf is not None and ekf_is_doubtful(watched.ekf, limits)
        low = voltage_is_low(state.voltage_v, limits)
        far = watched.tilted_s > 0.0 if paused else tilted(observed, limits) and not depth_held
        watched.ekf_doubt_s = _lasting(watched.ekf_doubt_s, dt_s, holds=doubtful)
        watched.battery_low_s = _lasting(watched.battery_low_s, dt_s, holds=low)
        if not paused and not previous.authority > 0.0:
            watched.saturated_s = watched.pull_n = watched.unanswered_s = 0.0
        elif dofs is not None:
            self._count_saturated(observed, dofs, limits, paused=bool(paused))
            if not paused:
                self._count_unanswered(observed, dofs, config)
        # A vehicle that turns round and round, or over and over, is right once in each turn.
        steers = previous.authority > 0.0 or bool(paused)
        off_track_s = _counted_back(watched.off_track_s, dt_s, holds=off_track)
        watched.off_track_s = off_track_s if steers and not recovers else 0.0
        watched.tilted_s = _counted_back(watched.tilted_s, dt_s, holds=far) if steers else 0.0
        over = upside_down(state)
        if steers or previous.state is State.HAND_OVER:
            counted_s = _counted_back(watched.upside_down_s, dt_s, holds=over, back=UPRIGHT_COUNTS)
            watched.upside_down_s = counted_s
        elif not over:
            watched.upside_down_s = 0.0
        if paused:
            watched.interruption, self._interrupted_t_s = paused, state.t_s
        if not active:  # the ramp of engaging is no loss
            watched.lost_s = -0.5 * limits.ramp_up_s
        elif previous.authority < 1.0:
            watched.lost_s += (1.0 - previous.authority) * dt_s
        else:
            watched.lost_s = max(0.0, watched.lost_s - RECOVERS_PER_S * dt_s)

    def _count_saturated(
        self, observed: Observation, dofs: Dofs, limits: SupervisorLimits, *, paused: bool
    ) -> None:
        """Count how long held axes are saturated, and what pulls at them meanwhile."""
        watched = self.watched
        cut = [held and full for held, full in zip(observed.held, dofs.saturated, strict=True)]
        counts = any(cut) or (paused and watched.saturated_s > 0.0)
        counted_s = _counted_back(watched.saturated_s, observed.dt_s, holds=counts, back=UNSATURATED_COUNTS)
        watched.saturated_s = min(counted_s, 1.5 * limits.saturated_s + observed.dt_s)
        pulls = [d * full for d, full in zip(observed.state.disturbance[:PSI], cut[:PSI], strict=True)]
        watched.pull_n = max(watched.pull_n, math.hypot(*pulls)) if watched.saturated_s > 0.0 else 0.0

    def _count_unanswered(self, observed: Observation, dofs: Dofs, config: Config) -> None:
        """Count how long full vertical thrust has not moved the vehicle; one that is tilted gets less."""
        watched, z_m = self.watched, observed.state.eta[Z]
        full = abs(dofs.tau[Z]) >= FULL_THRUST * config.heave.max_force
        pushes = observed.held[Z] and full and not tilted(observed, config.supervisor)
        if not abs(z_m - self._pushed_at_m) <= UNANSWERED_M:
            watched.unanswered_s, self._pushed_at_m = 0.0, z_m
        watched.unanswered_s = _counted_back(
            watched.unanswered_s, observed.dt_s, holds=pushes, back=UNSATURATED_COUNTS
        )

    def _average(self, observed: Observation) -> None:
        """Average the innovations, with a memory of INNOVATION_MEMORY_S; what is not finite begins anew."""
        new = observed.dt_s / (observed.dt_s + INNOVATION_MEMORY_S)
        innovations = zip(self._mean_innovation, observed.state.innovation, strict=True)
        mean = [old + new * (abs(innovation) - old) for old, innovation in innovations]
        self._mean_innovation = mean if all(map(math.isfinite, mean)) else [0.0] * 4
        mean = [mean * held for mean, held in zip(self._mean_innovation, observed.held, strict=True)]
        self.watched.innovation_m = max(mean[:PSI])
        self.watched.innovation_deg = math.degrees(mean[PSI])

    def _hear_other(self, event: OtherHoldfast) -> None:
        """Who hears the other soon after its own contact is the younger of the two."""
        if event.t_s - self._other_t_s > OTHER_S:
            self._other_since_s = event.t_s
            self._other_first = self._contact_s is None or event.t_s - self._contact_s < OTHER_S
        self._other_first |= event.steers and event.t_s - self._other_since_s > OTHER_S
        self._other_t_s = event.t_s

    def _latches(self, event: Heartbeat) -> bool:
        """Tell whether a failsafe changed the mode: it is latched before the firmware does so.

        One that was latched before has done what it does; the mode is somebody's choice then.
        """
        previous = self._heartbeat
        changed = previous is not None and previous.mode != event.mode and previous.system_status != FAILSAFE
        return changed and event.system_status == FAILSAFE

    def _failsafe(self) -> bool:
        beat, since_s = self._heartbeat, self._steering_since_s
        if beat is None or since_s is None or beat.system_status != FAILSAFE:
            return False
        return beat.t_s - since_s > FAILSAFE_SETTLE_S


def _lasting(so_far_s: float, dt_s: float, *, holds: bool) -> float:
    return so_far_s + dt_s if holds else 0.0


def _counted_back(so_far_s: float, dt_s: float, *, holds: bool, back: float = 1.0) -> float:
    """Return the time in which it held, less the share `back` of that in which it did not."""
    return max(so_far_s + (dt_s if holds else -back * dt_s), 0.0)


def _since(began_s: float | None, now_s: float, *, holds: bool) -> float | None:
    """Return since when it holds; None where it does not."""
    return (now_s if began_s is None else began_s) if holds else None
