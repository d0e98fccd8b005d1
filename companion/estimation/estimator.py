"""Events to what a tick takes: every sample, range and rate, and an age for every signal.

A sample counts for the time at which it was true: the autopilot's stamp (or arrival minus the measured
telemetry delay, where a message has none) minus the sensor's own delay.
"""

import cmath
import math
from collections.abc import Sequence
from operator import add

import msgspec

from companion.config import Config
from companion.core.actuation import NONE
from companion.core.allocation import T200_VOLTAGE_V, Thrusters, axes_from_motors
from companion.core.attitude import angle_rates
from companion.core.observers import MAX_GAP_S, Inputs, Outlook
from companion.estimation.answers import AttitudeAnswers, DepthAnswers, PositionAnswers
from companion.estimation.delay import DelayMeter
from companion.estimation.frame import Frame
from companion.estimation.observer_design import noise_of
from companion.estimation.resets import (
    POSITION_WARNED_M,
    DepthResets,
    Spikes,
    position_resets,
    yaw_resets,
)
from companion.estimation.sample_meter import RAW_LATER_S, SampleMeter
from companion.mavlink.ardusub import motor_demand
from companion.records import (
    DOFS,
    PSI,
    Ages,
    Delays,
    Event,
    Flags,
    Vector,
    X,
    Y,
    Z,
    events,
    vector,
)

MAX_RESET_INNOVATION = 1.0
"""Of a tick's resets at most this counts as innovation (m, rad). One is usual, one a sample is not."""

JUMP_BELIEVED_S = 2.0
"""A depth that jumps is ignored, so depth soon counts as stale. A jump that lasts for this time, or longer
than a short interruption may, is accepted."""

ARMING_S = 0.5
"""The autopilot sets its zero of depth within this time of arming: no reset."""

ZERO_MOVED_M = 0.05
"""A disarmed vehicle whose depth jumps by more has a new zero, as arming makes one: that is no motion."""

NOTHING = (math.nan, math.nan)
"""No value, of no time."""


class Sensed(msgspec.Struct, frozen=True):
    """All that came of a tick's events."""

    inputs: Inputs
    restarted: bool
    """Whether nothing that was known of the motion counts any more."""
    held: bool
    """Whether a place is held."""
    ranges: tuple[events.Range, ...]
    heartbeat: events.Heartbeat
    pilot_gain: float
    boot_s: float
    delays: Delays
    ages: Ages
    shifted: Vector
    """What the autopilot's estimate was reset by."""
    reset_by: Vector
    """How much of that counts as innovation."""
    depth_refused: bool
    depth_doubt: str
    attitude_doubt: str
    position_doubt: str
    clock_doubt_s: float
    depth_offset_m: float
    still: tuple[float, float]
    """Velocity inside, north and east, of what rests in the EKF's frame."""


class Estimator:
    """What is known of clock, delays, resets, frame and meters: `take` begins a tick, `sent` ends it."""

    def __init__(self, config: Config, thrusters: Thrusters) -> None:
        self._thrusters = thrusters
        self._delays = config.delays
        self._lead_s = config.thrusters.lead_s
        self._tick_s = 1.0 / config.loop.rate_hz
        self._depth_later_s = RAW_LATER_S if config.vehicle.depth_source == "pressure" else 0.0
        self._hidden_s = 0.0
        self._configured = (math.nan, math.nan)
        self.frame = Frame()
        """Where the EKF's frame lies, as seen from the one in which states and the observers' memory are."""
        self._held = False
        self.retune(config)
        self._heartbeat = events.Heartbeat(-math.inf, armed=False, mode=-1, system_status=0)
        self._voltage_v = T200_VOLTAGE_V
        self._gain = 1.0
        self._armed_t_s = -math.inf
        self._came_s = dict.fromkeys(("link_s", "heartbeat_s", "pilot_s"), -math.inf)
        """When what has no sample came last, by the name of its age."""
        self._restart()

    def retune(self, config: Config) -> None:
        """Go on from the present estimate with other noises, sensor delays and limits of jumps and ages."""
        self._sensor_delay_s = vector([axis.sensor_delay_s for axis in config.axes])
        self._rate_delay_s = vector([axis.rate_delay_s for axis in config.axes])
        configured = noise_of(config)
        if configured != self._configured:
            self._configured = configured
            self._depths = SampleMeter(configured[0], self._depth_later_s, angular=False)
            self._headings = SampleMeter(configured[1], 0.0, angular=True)
        limits = config.supervisor
        self.max_depth_jump_m = limits.max_depth_jump_m
        position_s = limits.position_timeout_s
        self._believed_s = max(JUMP_BELIEVED_S, 2.0 * limits.link_timeout_s)
        self._timeout_s = (position_s, position_s, limits.depth_timeout_s, limits.attitude_timeout_s)

    def _restart(self) -> None:
        """Forget motion and clocks: a rebooted autopilot, or numbers gone bad."""
        self._meter = DelayMeter(self._delays.telemetry_s, self._delays.command_s)
        self._attitude = events.Attitude(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._measured_t_s = [-math.inf] * len(DOFS)
        self._expected_depth_m = self._expected_sink_mps = 0.0
        self._sink_mps, self._sink_t_s = 0.0, -math.inf
        self._begin()
        self._yaw_resets, self._x_resets, self._y_resets = yaw_resets(), position_resets(), position_resets()
        self._depth_resets, self._depth_spikes = DepthResets(), Spikes()
        self._begins_depth = False
        self._depth_answers, self._attitude_answers = DepthAnswers(), AttitudeAnswers()
        self._position_answers = PositionAnswers()
        self._depth_doubt = self._attitude_doubt = self._position_doubt = ""
        self._came_s |= dict.fromkeys(("yaw_reset_s", "position_reset_s", "depth_reset_s"), -math.inf)

    def _begin(self) -> None:
        self._positions, self._rates = [NOTHING] * len(DOFS), [NOTHING] * len(DOFS)
        self._begins = [math.nan] * len(DOFS)
        self._shifted, self._reset_by = [0.0] * len(DOFS), [0.0] * len(DOFS)
        self._ranges: list[events.Range] = []
        self._depth_refused = False

    def take(
        self,
        now_s: float,
        heard: Sequence[Event],
        expected: Outlook,
        learns: Flags = NONE,
        *,
        drift: complex = 0j,
        held: bool = False,
    ) -> Sensed:
        """Take in what came since the last tick.

        Args:
            now_s: monotonic.
            heard: the events.
            expected: what the observers expect.
            learns: by axis, whether our commands alone moved the vehicle.
            drift: of the EKF's velocity, m/s, as the water shows it: north + i east.
            held: whether a place is held.

        """
        restarted, hidden_s = not expected.believable, expected.hidden_s
        if restarted:
            self._restart()
        drift = drift if self.frame.has_fixes(now_s) and not restarted else 0j
        drift *= cmath.exp(1j * self.frame.settled.turn_rad)
        self._held, self.frame = held, self.frame.followed(self._tick_s, drift, held=held)
        self._expected_depth_m, self._expected_sink_mps = expected.depth_m, expected.sink_mps
        self._begin()
        self._hidden_s = hidden_s
        for event in heard:
            self._take(event)
            restarted |= isinstance(event, events.Reboot)
        delays = self._meter.delays(hidden_s)
        if not math.isfinite(delays.total_s):
            self._restart()
            restarted, delays = True, self._meter.delays(0.0)
        clock = self._meter.clock
        return Sensed(
            inputs=self._inputs(now_s, delays, learns),
            restarted=restarted,
            held=held,
            ranges=tuple(self._ranges),
            heartbeat=self._heartbeat,
            pilot_gain=self._gain,
            boot_s=now_s + clock.offset_s,
            delays=delays,
            ages=self._ages(now_s),
            shifted=vector(self._shifted),
            reset_by=vector(self._reset_by),
            depth_refused=self._depth_refused,
            depth_doubt=self._depth_doubt,
            attitude_doubt=self._attitude_doubt,
            position_doubt=self._position_doubt,
            clock_doubt_s=clock.doubt_s(now_s),
            depth_offset_m=self.frame.sunk_m,
            still=self.frame.velocity_inside(0.0, 0.0),
        )

    def _inputs(self, now_s: float, delays: Delays, learns: Flags) -> Inputs:
        attitude, timeout_s = self._attitude, self._timeout_s
        stale = [not now_s - t_s <= most for t_s, most in zip(self._measured_t_s, timeout_s, strict=True)]
        return Inputs(
            now_s=now_s,
            positions=vector(self._positions),
            rates=vector(self._rates),
            begins=vector(self._begins),
            stale=vector(stale),
            telemetry_s=delays.telemetry_s,
            command_s=delays.command_s,
            ahead_s=delays.command_s + self._lead_s,
            positioned=self._measured_t_s[X] > -math.inf,
            learns=learns,
            attitude=(attitude.roll, attitude.pitch, attitude.p, attitude.q, attitude.r),
            voltage_v=self._voltage_v,
        )

    def _ages(self, now_s: float) -> Ages:
        return Ages(
            depth_s=now_s - self._measured_t_s[Z],
            attitude_s=now_s - self._measured_t_s[PSI],
            position_s=now_s - self._measured_t_s[X],
            **{name: now_s - t_s for name, t_s in self._came_s.items()},
        )

    @property
    def noise(self) -> tuple[float, float]:
        """The white noise of depth (m) and heading (rad) that they show, at least the configured one."""
        return self._depths.noise, self._headings.noise

    def sent(self, now_s: float, axes: Vector) -> None:
        """Note the axes that were sent."""
        self._meter.sent(now_s, axes)

    def _take(self, event: Event) -> None:
        match event:
            case events.Attitude():
                self._on_attitude(event)
            case events.Depth():
                self._on_depth(event)
            case events.DepthRate():
                self._on_depth_rate(event)
            case events.Position():
                self._on_position(event)
            case events.Pressure():
                self._on_pressure(event)
            case events.DepthSensor():
                self._depth_answers.healthy = event.healthy
            case events.Range():
                self._ranges.append(event)
            case events.ServoOutput():
                self._on_servo_output(event)
            case events.TimeSync():
                self._meter.timesync(event.sent_s, event.t_s, event.boot_s)
            case events.Heartbeat():
                self._on_heartbeat(event)
            case events.Battery():
                self._voltage_v = min(max(event.voltage_v, 10.0), 20.0)  # a T200 takes 20 V at most
            case events.PilotGain():
                self._gain = event.gain
            case events.Reboot():
                self.frame = self.frame._replace(sunk_m=0.0)
                self._restart()
            case events.PilotHeartbeat():
                self._came_s["pilot_s"] = event.t_s
                return
            case _:
                return
        self._came_s["link_s"] = event.t_s

    def _sampled(
        self, event: events.Depth | events.DepthRate | events.Attitude | events.Position, dof: int
    ) -> tuple[float, float]:
        """Return the times at which this sample of `dof` was true: of its position, and of its rate."""
        meter = self._meter
        if event.boot_s is None:
            sent_s = event.t_s - meter.telemetry_s
        else:
            meter.stamped(event.t_s, event.boot_s)
            sent_s = meter.clock.local(event.boot_s)
        return sent_s - self._sensor_delay_s[dof], sent_s - self._rate_delay_s[dof]

    def _position(self, dof: int, value: float | None, t_s: float, at_s: float) -> None:
        """Keep a position sample; None repeats one, which is no silence and shows nothing new.

        What was not measured for long begins again; x, y after their timeout.
        """
        if value is None:
            self._measured_t_s[dof] = t_s
            return
        most_s = self._timeout_s[dof] if dof in (X, Y) else min(MAX_GAP_S, self._timeout_s[dof])
        if t_s - self._measured_t_s[dof] > most_s:
            self._begins[dof] = value
            if dof == Z:
                self._expected_depth_m = value
        self._measured_t_s[dof] = t_s
        self._positions[dof] = (value, at_s)

    def _note_reset(self, north_m: float, east_m: float, down_m: float, turn_rad: float) -> None:
        """Report a reset of the EKF; samples of this tick from before it are left out."""
        for dof in () if down_m else (X, Y, PSI):
            self._positions[dof] = self._rates[dof] = NOTHING
        by = north_m, east_m, down_m, turn_rad
        self._shifted = list(map(add, self._shifted, by))
        self._reset_by = [
            min(a + abs(b), MAX_RESET_INNOVATION) for a, b in zip(self._reset_by, by, strict=True)
        ]

    def _on_attitude(self, event: events.Attitude) -> None:
        at_s, rate_s = self._sampled(event, PSI)
        believed_s, self._attitude_doubt = self._attitude_answers.step(event)
        if self._attitude_doubt:
            self._measured_t_s[PSI] = min(self._measured_t_s[PSI], believed_s)
            return
        self._attitude = event
        *_, heading_rate = angle_rates(event.roll, event.pitch, event.p, event.q, event.r)
        turn_rad = self._yaw_resets.step(event.boot_s, event.yaw, heading_rate)
        if turn_rad:
            self._came_s["yaw_reset_s"] = event.t_s
            self._note_reset(0.0, 0.0, 0.0, turn_rad)
            north_m = self._x_resets.extrapolated(event.boot_s)
            east_m = self._y_resets.extrapolated(event.boot_s)
            self.frame = self.frame.turned(turn_rad, north_m, east_m)
        self._headings.rate(at_s, heading_rate)
        psi = self._headings.position(at_s, self.frame.settled.heading_inside(event.yaw))
        self._position(PSI, psi, event.t_s, at_s)
        self._rates[PSI] = (heading_rate, rate_s)

    def _on_depth(self, event: events.Depth) -> None:
        at_s, _ = self._sampled(event, Z)
        surprise_m = event.z_m - self.frame.sunk_m - self._expected_depth_m
        known = self._heartbeat.armed and event.t_s - self._measured_t_s[Z] <= self._believed_s
        if self._depth_spikes.leave_out(event.t_s, far=known and abs(surprise_m) > self.max_depth_jump_m):
            return
        self._depth_refused |= self._depth_spikes.over
        believed_s, self._depth_doubt = self._depth_answers.position(event.t_s, event.z_m)
        if self._depth_doubt:
            self._measured_t_s[Z] = min(self._measured_t_s[Z], believed_s)
            return
        if event.boot_s is not None:
            climbs = event.t_s - self._sink_t_s <= MAX_GAP_S
            sink_mps = self._sink_mps if climbs else self._expected_sink_mps
            self._note_depth_reset(
                event.t_s,
                self._depth_resets.step(event.boot_s, event.z_m, sink_mps, surprise_m, climbs=climbs),
            )
        z_m = event.z_m - self.frame.sunk_m
        if self._begins_depth:
            self._begins[Z] = self._expected_depth_m = z_m
            self._begins_depth = False
        if known and abs(z_m - self._expected_depth_m) > self.max_depth_jump_m:
            self._depth_refused = True
            return
        if not self._heartbeat.armed and abs(z_m - self._expected_depth_m) > ZERO_MOVED_M:
            self._begins[Z] = self._expected_depth_m = z_m
        self._position(Z, self._depths.position(at_s, z_m), event.t_s, at_s - self._hidden_s)

    def _on_pressure(self, event: events.Pressure) -> None:
        later_s = max(RAW_LATER_S - self._depths.later_s, 0.0)
        reset_m = self._depth_resets.pressed(event.boot_s - later_s, event.z_m)
        spikes = self._depth_resets.spikes
        if not spikes.doubtful:
            self._depth_answers.pressure(event.t_s, event.z_m)
        self._depth_refused |= spikes.over
        self._note_depth_reset(event.t_s, reset_m)
        self._begins_depth = self._depth_resets.late

    def _note_depth_reset(self, t_s: float, down_m: float) -> None:
        """Let depth go on as before. While it is disarmed, and as it arms, the zero is the autopilot's."""
        if not self._heartbeat.armed or t_s - self._armed_t_s <= ARMING_S:
            self._depth_resets.accept()
        elif down_m:
            self.frame = self.frame._replace(sunk_m=self.frame.sunk_m + down_m)
            self._came_s["depth_reset_s"] = t_s
            self._note_reset(0.0, 0.0, down_m, 0.0)

    def _on_depth_rate(self, event: events.DepthRate) -> None:
        self._sink_mps, self._sink_t_s = event.w_mps, event.t_s
        self._depth_answers.rate(event.t_s, event.w_mps)
        if self._depth_doubt:
            return
        at_s, rate_s = self._sampled(event, Z)
        self._depths.rate(at_s, event.w_mps)
        self._rates[Z] = (event.w_mps, rate_s - self._hidden_s)

    def _on_position(self, event: events.Position) -> None:
        at_s, rate_s = self._sampled(event, X)
        believed_s, self._position_doubt = self._position_answers.step(event)
        if self._position_doubt:
            self._measured_t_s[X] = self._measured_t_s[Y] = min(self._measured_t_s[X], believed_s)
            return
        north_m = self._x_resets.step(event.boot_s, event.x_m, event.vx_mps)
        east_m = self._y_resets.step(event.boot_s, event.y_m, event.vy_mps)
        if north_m or east_m:  # a fix moves both
            north_m, east_m = north_m or self._x_resets.rest(), east_m or self._y_resets.rest()
            self._note_reset(north_m, east_m, 0.0, 0.0)
            faster = (self._x_resets.rate_change, self._y_resets.rate_change)
            self.frame = self.frame.jumped(north_m, east_m, event.t_s, faster, held=self._held)
            reset = self.frame.reset_t_s == event.t_s or not self.frame.has_fixes(event.t_s)
            if reset and math.hypot(north_m, east_m) > POSITION_WARNED_M:
                self._came_s["position_reset_s"] = event.t_s
        x, y, _, _ = self.frame.now.inside((event.x_m, event.y_m, 0.0, 0.0))
        u, v = self.frame.velocity_inside(event.vx_mps, event.vy_mps)
        self._position(X, x, event.t_s, at_s)
        self._position(Y, y, event.t_s, at_s)
        self._rates[X], self._rates[Y] = (u, rate_s), (v, rate_s)

    def _on_servo_output(self, event: events.ServoOutput) -> None:
        count = self._thrusters.motor_count
        if len(event.pwm_us) >= count:
            axes = axes_from_motors(self._thrusters, motor_demand(event.pwm_us[:count]))
            self._meter.echo(event.boot_s, axes[:4])

    def _on_heartbeat(self, event: events.Heartbeat) -> None:
        if not event.armed:
            self.frame = self.frame._replace(sunk_m=0.0)
        elif not self._heartbeat.armed:
            self._armed_t_s = event.t_s
        self._heartbeat = event
        self._came_s["heartbeat_s"] = event.t_s
