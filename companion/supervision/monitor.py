"""Observations over time: how long something has lasted, and what was reported recently."""

import math
from collections.abc import Mapping

from companion.config import SupervisorLimits
from companion.records import (
    PSI,
    EkfStatus,
    Heartbeat,
    Leak,
    Parameter,
    PilotInput,
    PilotSticks,
    Reboot,
    Z,
)
from companion.supervision.situation import Observation, Watched, ekf_is_doubtful, tilted, voltage_is_low
from companion.telemetry.modes import FAILSAFE as FAILSAFE
from companion.telemetry.modes import Mode

FAILSAFE_SETTLE_S = 1.5
"""A silent companion latches the pilot failsafe; the first heartbeat of its steering may still report it."""

LEAK_REPEAT_S = 25.0
ANNOUNCED_S = 2.0
INNOVATION_MEMORY_S = 0.5
RECOVERS_S = 5.0
"""After a motor was found dead: until then it turned the vehicle, by up to 90°, and now it is turned back."""

DEPTH_HELD_M = 0.3
"""A vehicle that is tilted and holds its depth so well is better off with us: ALT_HOLD would let it sink."""


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
        self._tilted_s = 0.0
        self._dead_motor, self._without_since_s = 0, -math.inf
        self._mean_innovation = [0.0] * 4
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
        steered: bool,
    ) -> Watched:
        """Observe one tick; `parameters` are those before its events, `steered` whether the last one did."""
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
                case EkfStatus():
                    self._ekf = event
                case Leak():
                    self._leak_t_s = event.t_s
                case Parameter() if parameters.get(event.name, event.value) != event.value:
                    self._changed_t_s = event.t_s
                case Reboot():
                    self._rebooted_t_s, self._ekf = event.t_s, None
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
            innovation_m=max(mean[:PSI]),
            innovation_deg=math.degrees(mean[PSI]),
            samples_dropped=now_s - self._dropped_t_s <= ANNOUNCED_S,
            peer_changed=now_s - self._peer_t_s <= ANNOUNCED_S,
            config_changed=now_s - self._changed_t_s <= ANNOUNCED_S,
        )

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
