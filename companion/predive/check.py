"""The pre-dive list: judges what was observed, row by row. Pure: it requests nothing from the vehicle.

`holdfast check` prints it, `holdfast run` refuses to engage while a row is REFUSED and names the row.
Source: docs/ardusub.md.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum

from companion.config import Config
from companion.control.allocation import HORIZONTAL
from companion.mavlink.ardusub import FRAMES
from companion.predive.survey import Observed
from companion.supervision.conditions import RESET_SETTLE_S
from companion.supervision.situation import (
    depth_is_fresh,
    ekf_is_doubtful,
    pilot_failsafe_acts,
    voltage_is_low,
)

PRESET_OF = {"vectored": "bluerov2", "vectored_6dof": "heavy"}
"""The shipped vehicle of each frame."""

SUBMARINE = 12
OLDEST = (4, 5, 0)
MIN_REACH = 0.3
"""With a smaller pilot gain MANUAL_CONTROL reaches less than a third of the thrust."""

SLOW_SHARE = 0.7
NOT_ON_EVERY_VEHICLE = frozenset(
    {"DISTANCE_SENSOR", "LOCAL_POSITION_NED", "SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"}
)
"""Streams that a vehicle may lack; another row reports a missing one if it is needed."""

MIN_DEPTH_HZ = 8.0
FULL_CELL_SHARE = 1.08
"""A battery below this multiple of the low voltage gives a warning before a dive."""

MAX_ROUND_TRIP_S = 0.1
HEEDED, SHARED = 0.7, 0.2
"""Of the demand, at least what reaches the motors alone, and beside a pilot's neutral sticks."""

REVERSED, WEAK = -0.25, 0.35
"""A motor's share, of the strongest in its group, below which it is reversed or gives too little."""
NO_ANSWER = 0.1
"""The strongest motor of a group has to answer with this share of what the configured vehicle would."""


class Grade(IntEnum):
    """The result of a row; the worst one is the exit status of `holdfast check`."""

    GOOD = 0
    WARNING = 1
    REFUSED = 2


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One line of the list: what was found, why it matters, how to fix it."""

    name: str
    grade: Grade
    found: str
    why: str
    fix: str = ""


def rows(seen: Observed, config: Config) -> list[CheckRow]:
    """Return the list, without the rows of what was not tested."""
    return [row for make in _ROWS if (row := make(seen, config)) is not None]


WATCHED = frozenset({"pilot failsafe", "depth", "battery"})
"""Rows for which the supervisor has conditions, which it tests in every tick."""


SETTLES = frozenset({"EKF", "compass"})
"""Rows that only forbid engaging: while Holdfast holds, the supervisor has conditions for them."""


def refusals(listed: Sequence[CheckRow], *, holding: bool = False) -> str:
    """Return the rows that forbid engaging, in words; empty if there are none. WATCHED rows are left out.

    While `holding`, the rows of SETTLES are left out too.
    """
    ignored = WATCHED | SETTLES if holding else WATCHED
    refused = [row for row in listed if row.grade is Grade.REFUSED and row.name not in ignored]
    return "; ".join(f"{row.name}: {row.found}. Fix: {row.fix}" for row in refused)


def _firmware(seen: Observed, config: Config) -> CheckRow:
    why = "Holdfast uses the signs, scales and failsafes of ArduSub 4.5 and newer"
    kind = seen.heartbeat.vehicle_type if seen.heartbeat else None
    if kind is not None and kind != SUBMARINE:
        found = f"a vehicle of MAVLink type {kind}"
        return CheckRow(
            "firmware", Grade.REFUSED, found, why, "set link.vehicle_system to that of an ArduSub vehicle"
        )
    if seen.firmware is None:
        return CheckRow(
            "firmware", Grade.WARNING, "the version was not reported", why, "reduce the load of the link"
        )
    grade = Grade.GOOD if seen.firmware.version >= OLDEST else Grade.WARNING
    return CheckRow("firmware", grade, f"ArduSub {seen.firmware.text}", why, "update to ArduSub 4.5 or newer")


def _signing(seen: Observed, config: Config) -> CheckRow | None:
    if not config.link.signing_key_file:
        return None
    why = "frames that are not signed with link.signing_key_file are dropped"
    if seen.messages or not seen.refused:
        found = "the vehicle signs with the same key" if seen.messages else "no frame arrived yet"
        return CheckRow("signing", Grade.GOOD, found, why)
    found, fix = "no frame is signed with the same key", "use one key on both sides: docs/wiring.md"
    return CheckRow("signing", Grade.REFUSED, found, why, fix)


def _frame(seen: Observed, config: Config) -> CheckRow:
    why = "the thrust is distributed over the motors of this frame"
    wanted, value = config.vehicle.frame, seen.parameters.get("FRAME_CONFIG")
    if value is None:
        return _not_reported("frame", "FRAME_CONFIG", why)
    has = FRAMES.get(value, f"number {value:g}")
    grade = Grade.GOOD if has == wanted else Grade.REFUSED
    fix = f'vehicle.preset = "{PRESET_OF[has]}"' if has in PRESET_OF else "a frame that Holdfast knows"
    return CheckRow("frame", grade, f"{has}, expected {wanted}" if grade else has, why, fix)


def _steering_id(seen: Observed, config: Config) -> CheckRow:
    why = "ArduSub silently refuses steering from any other system id"
    ours, value = config.link.system, seen.parameters.get("MAV_GCS_SYSID")
    if value is None:
        return _not_reported("steering id", "MAV_GCS_SYSID", why)
    if value != ours:
        found, fix = (
            f"it accepts {value:g}, Holdfast is {ours}",
            f"link.system = {value:g}, or MAV_GCS_SYSID = {ours}",
        )
        return CheckRow("steering id", Grade.REFUSED, found, why, fix)
    tried = seen.directions
    if tried is None or tried.refused:
        return CheckRow("steering id", Grade.GOOD, f"MAV_GCS_SYSID is {value:g}, as Holdfast's", why)
    found = f"{100.0 * tried.echo:.0f} % of the demand reached the motors"
    if tried.echo > HEEDED:
        return CheckRow("steering id", Grade.GOOD, found, why)
    grade = Grade.WARNING if tried.echo > SHARED else Grade.REFUSED
    fix = "look for another sender, such as a pilot's neutral sticks: two overwrite each other"
    return CheckRow("steering id", grade, found, why, fix)


def _pilot_failsafe(seen: Observed, config: Config) -> CheckRow:
    why = "if this computer fails, only FS_PILOT_INPUT stops the thrusters"
    action = seen.parameters.get("FS_PILOT_INPUT")
    timeout_s = seen.parameters.get("FS_PILOT_TIMEOUT")
    if action is None or timeout_s is None:
        return _not_reported(
            "pilot failsafe", "FS_PILOT_INPUT" if action is None else "FS_PILOT_TIMEOUT", why
        )
    does = {0.0: "does nothing", 1.0: "neutral", 2.0: "disarm"}.get(action, f"action {action:g}")
    found = f"{does} after {timeout_s:g} s"
    safe = pilot_failsafe_acts(seen.parameters, config.supervisor)
    fix = f"FS_PILOT_INPUT = 2, FS_PILOT_TIMEOUT <= {config.supervisor.max_pilot_timeout_s:g}"
    return CheckRow("pilot failsafe", Grade.GOOD if safe else Grade.REFUSED, found, why, fix)


def _pilot_gain(seen: Observed, config: Config) -> CheckRow:
    why = "the autopilot scales MANUAL_CONTROL by it; Holdfast compensates this"
    if config.vehicle.thrust_path == "rc_override":
        return CheckRow("pilot gain", Grade.GOOD, "not used: RC_CHANNELS_OVERRIDE is not scaled", why)
    gain, throttle = seen.pilot_gain, seen.parameters.get("JS_THR_GAIN")
    if gain is None or throttle is None:
        name = "PilotGain" if gain is None else "JS_THR_GAIN"
        return _not_reported("pilot gain", name, why)
    found = (
        f"{gain:g}, throttle x {throttle:g}: full stick is {100.0 * min(1.0, gain * throttle):.0f} % thrust"
    )
    grade = Grade.GOOD if min(gain, gain * throttle) >= MIN_REACH else Grade.WARNING
    fix = 'raise the gain by joystick, or JS_GAIN_DEFAULT and reboot, or thrust_path = "rc_override"'
    return CheckRow("pilot gain", grade, found, why, fix)


def _input_hold(seen: Observed, config: Config) -> CheckRow:
    why = "InputHold adds offsets to the sticks; RollPitch lets x and y control pitch and roll"
    on = [name for name, is_on in seen.toggles.items() if is_on]
    if on:
        fix = f"switch {' and '.join(on)} off with its joystick button"
        return CheckRow("input hold", Grade.REFUSED, f"{' and '.join(on)} on", why, fix)
    if not seen.toggles:
        return CheckRow(
            "input hold", Grade.WARNING, "not reported", why, "check that NAMED_VALUE_FLOAT is sent"
        )
    return CheckRow("input hold", Grade.GOOD, "InputHold and RollPitch off", why)


def _receiver(seen: Observed, config: Config) -> CheckRow:
    why = "with an RC receiver the pilot failsafe never acts; only RC_OVERRIDE_TIME stops the thrusters"
    if seen.parameters.get("RC_PROTOCOLS") == 0.0 or seen.receiver_channels == 0:
        return CheckRow("RC receiver", Grade.GOOD, "none", why)
    if seen.failsafe_seen:
        return CheckRow("RC receiver", Grade.GOOD, "none: the pilot failsafe has acted", why)
    override_s = seen.parameters.get("RC_OVERRIDE_TIME")
    if override_s is None:
        return _not_reported("RC receiver", "RC_OVERRIDE_TIME", why)
    limit_s = config.supervisor.max_pilot_timeout_s
    safe = 0.0 < override_s <= limit_s
    ends = f"overrides end after {override_s:g} s" if safe else f"RC_OVERRIDE_TIME is {override_s:g}"
    found = f"perhaps one, or another sender steers; {ends}"
    fix = f"RC_PROTOCOLS = 0, or unplug the receiver; and RC_OVERRIDE_TIME <= {limit_s:g}"
    return CheckRow("RC receiver", Grade.WARNING if safe else Grade.REFUSED, found, why, fix)


def _streams(seen: Observed, config: Config) -> CheckRow:
    why = "the estimate needs these rates; a parameter transfer reduces them to a quarter for a while"
    asked, came = seen.asked_hz, seen.measured_hz
    slow = [name for name, hz in asked.items() if name in came and came[name] < SLOW_SHARE * hz]
    slow = [name for name in slow if came[name] > 0.0 or name not in NOT_ON_EVERY_VEHICLE]
    if not came:
        return CheckRow("streams", Grade.WARNING, "not measured yet", why)
    if slow:
        found = ", ".join(f"{name} {came[name]:.0f} of {asked[name]:.0f} Hz" for name in slow)
        return CheckRow(
            "streams",
            Grade.WARNING,
            found,
            why,
            "look for another client that sets rates; reduce the load of the link",
        )
    return CheckRow(
        "streams", Grade.GOOD, f"ATTITUDE {came.get('ATTITUDE', 0.0):.0f} Hz and the others as requested", why
    )


def _depth(seen: Observed, config: Config) -> CheckRow:
    why = "Holdfast controls the depth"
    source, state = config.vehicle.depth_source, seen.state
    if not depth_is_fresh(state, config.supervisor):
        fix = "check that its message is streamed, or choose another vehicle.depth_source"
        if source == "pressure":
            lacking = [name for name in _pressure_parameters(seen) if name not in seen.parameters]
            fix = f"it needs {', '.join(lacking)}, which were not reported" if lacking else fix
        return CheckRow("depth", Grade.REFUSED, f"no fresh depth from {source}", why, fix)
    delays = state.delays
    late = f"{1e3 * max(0.0, delays.telemetry_s):.0f} ms" if delays.telemetry_known else "not measured"
    gravity = seen.parameters.get("BARO_SPEC_GRAV", math.nan)
    found = f"{state.eta[2]:.2f} m from {source}, {seen.depth_hz:.0f} Hz, late by {late}; density {gravity:g}"
    fix = "BARO_SPEC_GRAV = 1.025 in sea water; otherwise depth reads 2.5 % too deep"
    grade = Grade.GOOD if seen.depth_hz >= MIN_DEPTH_HZ else Grade.WARNING
    return CheckRow("depth", grade, found, why, fix)


def _pressure_parameters(seen: Observed) -> tuple[str, ...]:
    primary = int(seen.parameters.get("BARO_PRIMARY", 1.0))
    return "BARO_PRIMARY", f"BARO{primary + 1}_GND_PRESS", "BARO_SPEC_GRAV"


def _origin(seen: Observed, config: Config) -> CheckRow:
    why = "relative_alt shifts permanently by about 0.1 m if it is set under water"
    if seen.origin_known:
        return CheckRow("EKF origin", Grade.GOOD, "set", why)
    fix = "at the surface: holdfast check --set-origin LAT,LON"
    if config.vehicle.depth_source == "vfr_hud":
        found = "not set: VFR_HUD.alt stays exactly 0"
        return CheckRow("EKF origin", Grade.REFUSED, found, why, fix)
    return CheckRow("EKF origin", Grade.WARNING, "not set", why, fix)


def _ekf(seen: Observed, config: Config) -> CheckRow:
    why = "attitude, heading and depth come from the autopilot's EKF, which settles after boot"
    ekf, limits = seen.ekf, config.supervisor
    if ekf is None:
        return CheckRow(
            "EKF", Grade.REFUSED, "no EKF_STATUS_REPORT arrived", why, "wait; reduce the load of the link"
        )
    lacks = [name for name, has in (("attitude", ekf.attitude), ("depth", ekf.depth)) if not has]
    if seen.state.ages.position_s <= limits.position_timeout_s and not ekf.position:
        lacks.append("position, though one is sent")
    found = f"it has no {' and no '.join(lacks)}" if lacks else ""
    if not ekf.initialised:
        found = "not initialised"
    elif not lacks and ekf_is_doubtful(ekf, limits):
        found = f"its variance is {ekf.variance:.2f}, the limit {limits.max_ekf_variance:g}"
    if found:
        fix = "keep the vehicle at rest until the EKF has settled; if it does not, calibrate the compass"
        return CheckRow("EKF", Grade.REFUSED, f"{found}: wait", why, fix)
    has = "no position: x and y are not held"
    if ekf.position:
        has = "and position" if ekf.absolute else "and position by dead reckoning: it drifts"
    return CheckRow("EKF", Grade.GOOD, f"attitude, depth, {has}", why)


def _compass(seen: Observed, config: Config) -> CheckRow:
    why = "while the EKF aligns its yaw to the compass, the heading jumps"
    state = seen.state
    aligned_s = min(state.ages.yaw_reset_s, state.t_s - seen.yaw_aligned_t_s)
    if aligned_s <= RESET_SETTLE_S:
        found = f"the EKF aligned its yaw less than {RESET_SETTLE_S:g} s ago: wait"
        fix = "wait; calibrate the compass if this continues"
        return CheckRow("compass", Grade.REFUSED, found, why, fix)
    return CheckRow("compass", Grade.GOOD, "yaw is steady", why)


def _mode(seen: Observed, config: Config) -> CheckRow | None:
    if seen.modes is None:
        return None
    why = "Holdfast steers in vehicle.steering_mode and hands over through STABILIZE"
    if not seen.modes:
        return CheckRow("mode", Grade.GOOD, "not tested: the vehicle is armed", why)
    missing = [name for name, came in seen.modes.items() if not came]
    if not missing:
        return CheckRow(
            "mode", Grade.GOOD, f"{' and '.join(seen.modes)} are possible; the previous mode is restored", why
        )
    wanted = config.vehicle.steering_mode.upper() in missing
    grade = Grade.REFUSED if wanted else Grade.WARNING
    return CheckRow("mode", grade, f"{' and '.join(missing)} refused", why, "read the autopilot's messages")


def _battery(seen: Observed, config: Config) -> CheckRow:
    why = "thrust is proportional to the square of the voltage; the charge must last for the dive"
    low_v = config.supervisor.min_voltage_v
    if seen.voltage_v is None:
        return CheckRow("battery", Grade.WARNING, "no voltage", why, "set BATT_MONITOR")
    grade = Grade.WARNING if seen.voltage_v < FULL_CELL_SHARE * low_v else Grade.GOOD
    grade = Grade.REFUSED if voltage_is_low(seen.voltage_v, config.supervisor) else grade
    return CheckRow("battery", grade, f"{seen.voltage_v:.1f} V, low is {low_v:g}", why, "charge it")


def _leak(seen: Observed, config: Config) -> CheckRow:
    why = "Holdfast hands over when the autopilot reports a leak; FS_LEAK_ENABLE enables the report"
    action = seen.parameters.get("FS_LEAK_ENABLE")
    if action is None:
        return CheckRow(
            "leak", Grade.WARNING, "FS_LEAK_ENABLE was not reported", why, "reduce the load of the link"
        )
    if action == 0.0:
        fix = "FS_LEAK_ENABLE = 1 to warn, 2 to surface"
        return CheckRow("leak", Grade.WARNING, "not detected: FS_LEAK_ENABLE is 0", why, fix)
    does = {1.0: "warns", 2.0: "surfaces"}.get(action, f"does {action:g}")
    return CheckRow("leak", Grade.GOOD, f"no leak; the autopilot {does} if one is detected", why)


def _clock(seen: Observed, config: Config) -> CheckRow:
    why = "it measures the delays; an unknown delay causes a limit cycle"
    if not seen.syncs:
        return CheckRow(
            "clock", Grade.WARNING, "TIMESYNC is not answered", why, "look for a filter on the link"
        )
    found = f"round trip {1e3 * seen.round_trip_s:.1f} ms, {seen.clock_jumps} jumps in {seen.syncs} answers"
    total_s, bears_s = seen.state.delays.total_s, config.delays.gains_bear_s
    if seen.clock_jumps or seen.round_trip_s > MAX_ROUND_TRIP_S:
        return CheckRow(
            "clock", Grade.WARNING, found, why, "use a faster link; look for a second autopilot on it"
        )
    if total_s > bears_s:
        found += f"; total delay {1e3 * total_s:.0f} ms, full gains up to {1e3 * bears_s:.0f} ms"
        return CheckRow(
            "clock", Grade.WARNING, found, why, "the gains are reduced; run on the vehicle, not topside"
        )
    return CheckRow("clock", Grade.GOOD, found, why)


def _thrusters(seen: Observed, config: Config) -> CheckRow | None:
    tried = seen.directions
    if tried is None:
        return None
    why = "one reversed motor turns every force into a rotation"
    if tried.refused:
        return CheckRow(
            "thrusters", Grade.WARNING, f"not tested: {tried.refused}", why, "dive, and check again"
        )
    shares = [*_of_strongest(tried.motors[:HORIZONTAL]), *_of_strongest(tried.motors[HORIZONTAL:])]
    wrong = [str(n) for n, share in enumerate(shares, start=1) if share < REVERSED]
    weak = [str(n) for n, share in enumerate(shares, start=1) if REVERSED <= share < WEAK]
    answers = "measured " + ", ".join(f"{share:+.1f}" for share in tried.motors)
    if wrong:
        fix = " and ".join(f"MOT_{n}_DIRECTION" for n in wrong) + ": change the sign"
        found = f"motor {' and '.join(wrong)} pushes in the wrong direction; {answers}"
        return CheckRow("thrusters", Grade.REFUSED, found, why, fix)
    if weak:
        found = f"motor {' and '.join(weak)} gives too little thrust; {answers}"
        return CheckRow("thrusters", Grade.REFUSED, found, why, "check propeller, ESC and cable")
    return CheckRow(
        "thrusters", Grade.GOOD, f"all {len(tried.motors)} push in the right direction; {answers}", why
    )


def _of_strongest(motors: Sequence[float]) -> list[float]:
    """Return what the motors of a group give of the strongest one; NaN where it is unknown.

    How strong they all are together says nothing of a motor: the vehicle may be light, or its battery low.
    """
    strongest = max((share for share in motors if math.isfinite(share)), default=math.nan)
    return [0.0 if strongest <= NO_ANSWER else share / strongest for share in motors]


def _not_reported(name: str, parameter: str, why: str) -> CheckRow:
    fix = "wait; reduce the load of the link; check whether the vehicle requires signatures"
    return CheckRow(name, Grade.REFUSED, f"{parameter} was not reported", why, fix)


_ROWS: tuple[Callable[[Observed, Config], CheckRow | None], ...] = (
    _signing,
    _firmware,
    _frame,
    _steering_id,
    _pilot_failsafe,
    _pilot_gain,
    _input_hold,
    _receiver,
    _streams,
    _depth,
    _origin,
    _ekf,
    _compass,
    _mode,
    _battery,
    _leak,
    _clock,
    _thrusters,
)
