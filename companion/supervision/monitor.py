"""Observations over time: how long something has lasted, and what was reported recently."""

import math
from collections.abc import Mapping

from companion.config import SupervisorLimits
from companion.records import (
    PSI,
    EkfStatus,
    Heartbeat,
    Leak,
    OtherHoldfast,
    Parameter,
    PilotInput,
    PilotSticks,
    Reboot,
    Z,
)
from companion.supervision.situation import (
    Observation,
    Watched,
    ekf_is_doubtful,
    interrupted,
    tilted,
    voltage_is_low,
)
from companion.telemetry.modes import FAILSAFE, Mode

FAILSAFE_SETTLE_S = 1.5
"""A silent companion latches the pilot failsafe; the first heartbeat of its steering may still report it."""

LEAK_REPEAT_S = 25.0
ANNOUNCED_S = 2.0
INNOVATION_MEMORY_S = 0.5
STEADY_S = 60.0
"""So long after an interruption the next one is not told anew."""

RECOVERS_PER_S = 0.1
"""What a second without an interruption takes off their sum."""

RECOVERS_S = 5.0
"""After a motor was found dead: until then it turned the vehicle, by up to 90°, and now it is turned back."""

DEPTH_HELD_M = 0.3
"""A vehicle that is tilted and holds its depth so well is better off with us: ALT_HOLD would let it sink."""


CONTACT_S = 5.0
"""A link that was silent for longer is a new contact."""

OTHER_S = 3.0
"""Another Holdfast that is heard sooner after our contact was first; unheard for so long, it has gone. One
that came later steers no longer than this, or believes itself to be first."""


class Monitor:
    """Observes every tick, and returns durations and recent reports as `Watched`."""

    def __init__(self) -> None:
        self._ekf: EkfStatus | None = None
        self._config_changed = False
        self._pilot_t_s = self._leak_t_s = self._rebooted_t_s = -math.inf
        self._changed_t_s = self._dropped_t_s = self._peer_t_s = -math.inf
        self._pilot_deflection = 0.0
        self._heartbeat: Heartbeat | None = None
        self._surfaces = False
        self._steering_since_s: float | None = None
        self._dropped = self._peer_changes = 0
        self._ekf_doubt_s = self._battery_low_s = self._saturated_s = self._off_track_s = 0.0
        self._tilted_s = self._interrupted_s = 0.0
        self._interrupted_t_s = -math.inf
        self._dead_motor, self._without_since_s = 0, -math.inf
        self._mean_innovation = [0.0] * 4
        self._contact_s: float | None = None
        self._other_since_s = self._other_t_s = -math.inf
        self._other_first = False
        self.pilot_heard_s = -math.inf
        """When somebody else last sent a steering message, deflected or not."""

    def config_changed(self) -> None:
        """Note that our configuration changed."""
        self._config_changed = True

    def step(
        self,
        observed: Observation,
        limits: SupervisorLimits,
        parameters: Mapping[str, float],
        *,
        active: bool,
        steered: bool,
        tick_s: float,
    ) -> Watched:
        """Observe one tick; `parameters` are those before its events.

        `active` and `steered` tell of the last tick whether it was ACTIVE, and carried authority.
        """
        dt_s, loop, held = observed.dt_s, observed.loop, observed.held
        state, dofs = observed.state, observed.dofs
        now_s = state.t_s
        if self._config_changed:
            self._config_changed, self._changed_t_s = False, now_s
        for event in observed.events:
            match event:
                case Heartbeat():
                    self._surfaces = event.mode == Mode.SURFACE and (self._surfaces or self._latches(event))
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
                    self._ekf = event
                case Leak():
                    self._leak_t_s = event.t_s
                case Parameter() if parameters.get(event.name, event.value) != event.value:
                    self._changed_t_s = event.t_s
                case Reboot():
                    self._rebooted_t_s, self._ekf = event.t_s, None
        if not state.ages.link_s <= CONTACT_S:
            self._contact_s = None
        elif self._contact_s is None:
            self._contact_s = now_s
        if not steered:
            self._steering_since_s = None
        elif self._steering_since_s is None:
            self._steering_since_s = now_s
        if loop.peer_changes > self._peer_changes:
            self._peer_changes, self._peer_t_s = loop.peer_changes, now_s
        if loop.samples_dropped > self._dropped:
            self._dropped, self._dropped_t_s = loop.samples_dropped, now_s
        doubtful = self._ekf is not None and ekf_is_doubtful(self._ekf, limits)
        self._ekf_doubt_s = _lasting(self._ekf_doubt_s, dt_s, doubtful)
        self._battery_low_s = _lasting(self._battery_low_s, dt_s, voltage_is_low(state.voltage_v, limits))
        saturated = off_track = False
        if dofs is not None and steered:
            for ours, cut, e, most in zip(held, dofs.saturated, dofs.e, _max_error(limits), strict=True):
                saturated = saturated or (ours and cut)
                off_track = off_track or (ours and not abs(e) <= most)
        self._saturated_s = _lasting(self._saturated_s, dt_s, saturated)
        if state.dead_motor != self._dead_motor:
            self._dead_motor, self._without_since_s = state.dead_motor, now_s
        recovers = now_s - self._without_since_s <= RECOVERS_S
        self._off_track_s = _lasting(self._off_track_s, dt_s, off_track and not recovers)
        depth_held = dofs is not None and steered and held[Z] and abs(dofs.e[Z]) <= DEPTH_HELD_M
        self._tilted_s = _lasting(self._tilted_s, dt_s, tilted(observed, limits) and not depth_held)
        if not active:
            self._interrupted_s = 0.0
        elif interrupted(observed, limits, tick_s):
            self._interrupted_s, self._interrupted_t_s = self._interrupted_s + dt_s, now_s
        else:
            self._interrupted_s = max(0.0, self._interrupted_s - RECOVERS_PER_S * dt_s)
        new = dt_s / (dt_s + INNOVATION_MEMORY_S)
        innovations = zip(self._mean_innovation, state.innovation, strict=True)
        mean = [old + new * (abs(innovation) - old) for old, innovation in innovations]
        self._mean_innovation = mean if all(map(math.isfinite, mean)) else [0.0] * 4
        mean = [mean * ours for mean, ours in zip(self._mean_innovation, held, strict=True)]
        return Watched(
            ekf=self._ekf,
            ekf_doubt_s=self._ekf_doubt_s,
            pilot_deflection=self._pilot_deflection
            if now_s - self._pilot_t_s <= limits.pilot_hold_s
            else 0.0,
            rebooted=now_s - self._rebooted_t_s <= ANNOUNCED_S,
            leaking=now_s - self._leak_t_s <= LEAK_REPEAT_S,
            failsafe_surfaces=self._surfaces,
            failsafe=self._failsafe(),
            battery_low_s=self._battery_low_s,
            saturated_s=self._saturated_s,
            off_track_s=self._off_track_s,
            tilted_s=self._tilted_s,
            interrupted_s=self._interrupted_s,
            other_first=self._other_first and now_s - self._other_t_s <= OTHER_S,
            other_came=not self._other_first and now_s - self._other_t_s <= OTHER_S,
            unsteady=now_s - self._interrupted_t_s <= STEADY_S,
            innovation_m=max(mean[:PSI]),
            innovation_deg=math.degrees(mean[PSI]),
            samples_dropped=now_s - self._dropped_t_s <= ANNOUNCED_S,
            peer_changed=now_s - self._peer_t_s <= ANNOUNCED_S,
            config_changed=now_s - self._changed_t_s <= ANNOUNCED_S,
        )

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


def _lasting(so_far_s: float, dt_s: float, holds: bool) -> float:
    return so_far_s + dt_s if holds else 0.0


def _max_error(limits: SupervisorLimits) -> list[float]:
    return [limits.max_error_m] * PSI + [math.radians(limits.max_error_deg)]
