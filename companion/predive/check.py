"""The pre-dive list: judges what was observed, row by row. Pure: it requests nothing from the vehicle.

`holdfast check` prints it, `holdfast run` refuses to engage while a row is REFUSED and names the row.
Source: docs/ardusub.md.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from companion.config import Config
from companion.core.allocation import HORIZONTAL
from companion.mavlink.ardusub import FRAMES
from companion.predive.survey import Observed
from companion.records import Condition
from companion.supervision.conditions import BLOCKING, RESET_SETTLE_S
from companion.supervision.situation import (
    depth_is_fresh,
    ekf_is_doubtful,
    pilot_failsafe_acts,
    voltage_is_low,
)
from companion.supervision.supervisor import first_remedy
from companion.telemetry.conditions import text
from holdfast.version import OLDEST_ARDUSUB

PRESET_OF = {"vectored": "bluerov2", "vectored_6dof": "heavy"}
"""The shipped vehicle of each frame."""

SUBMARINE, ARDUPILOT = 12, 3
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


GOOD, WARNING, REFUSED = Grade


class Finding(NamedTuple):
    """What a row found: how grave it is, and how to fix it."""

    grade: Grade
    found: str
    fix: str = ""


Judge = Callable[[Observed, Config], Finding | None]


_ROWS: list[tuple[str, str, Judge]] = []
"""Name, why it matters, and judge of each row, in the order of the list, which is that of this file."""


def _row(name: str, why: str) -> Callable[[Judge], Judge]:
    """Make a function a row of the list; it returns None for what was not tested."""

    def add(judge: Judge) -> Judge:
        _ROWS.append((name, why, judge))
        return judge

    return add


def rows(seen: Observed, config: Config) -> list[CheckRow]:
    """Return the list, without the rows of what was not tested; of a vehicle that is not heard the first."""
    judges = _ROWS if _is_heard(seen, config) else _ROWS[:1]
    found = ((name, why, judge(seen, config)) for name, why, judge in judges)
    return [CheckRow(name, it.grade, it.found, why, it.fix) for name, why, it in found if it is not None]


def _is_heard(seen: Observed, config: Config) -> bool:
    return seen.state.ages.heartbeat_s <= config.supervisor.heartbeat_timeout_s


C = Condition
WITHOUT_ROW = (
    (BLOCKING | C.PILOT_TAKEOVER)
    & ~(C.LINK_LOST | C.DEPTH_STALE | C.EKF_UNHEALTHY | C.LEAK | C.BATTERY_LOW | C.FAILSAFE_UNSAFE)
    & ~(C.PREFLIGHT_FAILURE | C.TICK_LATE | C.DISARMED | C.WRONG_MODE)
)
"""Conditions that forbid engaging a vehicle, and have no row of their own."""

WATCHED = frozenset({"link", "pilot failsafe", "depth", "battery", "leak", "supervisor"})
"""Rows for which the supervisor has conditions, which it tests in every tick."""


SETTLES = frozenset({"EKF", "compass"})
"""Rows that only forbid engaging: while Holdfast holds, the supervisor has conditions for them."""


def refusals(listed: Sequence[CheckRow], *, holding: bool = False) -> str:
    """Return the rows that forbid engaging, in words; empty if there are none. WATCHED rows are left out.

    While `holding`, the rows of SETTLES are left out too.
    """
    ignored = WATCHED | SETTLES if holding else WATCHED
    found: dict[str, list[str]] = {}
    for row in listed:
        if row.grade is REFUSED and row.name not in ignored:
            found.setdefault(row.fix, []).append(f"{row.name}: {row.found}")
    return "; ".join(f"{', '.join(rows)}. Fix: {fix}" for fix, rows in found.items())


@_row("link", "nothing else can be looked at without the autopilot's heartbeat")
def _link(seen: Observed, config: Config) -> Finding:
    link = config.link
    whom = f"heartbeat of system {link.vehicle_system}, component {link.vehicle_component}"
    if _is_heard(seen, config):
        return Finding(GOOD, f"the {whom} arrives at {link.endpoint}")
    found, fix = seen.contact
    return Finding(REFUSED, f"no {whom}: {found}", fix)


@_row("signing", "frames that are not signed with link.signing_key_file are dropped")
def _signing(seen: Observed, config: Config) -> Finding | None:
    if config.link.signing_key_file:
        return Finding(GOOD, "the vehicle signs with the same key")
    fix = "link.signing_key_file: it ignores what is not signed with its key"
    return Finding(WARNING, "the vehicle signs its frames, Holdfast has no key", fix) if seen.signs else None


@_row("firmware", "Holdfast uses the signs, scales and failsafes of ArduSub 4.5 and newer")
def _firmware(seen: Observed, config: Config) -> Finding:
    beat = seen.heartbeat
    if beat and (beat.vehicle_type, beat.autopilot) != (SUBMARINE, ARDUPILOT):
        found = f"a vehicle of MAVLink type {beat.vehicle_type} with autopilot {beat.autopilot}, not ArduSub"
        return Finding(REFUSED, found, "set link.vehicle_system to that of an ArduSub vehicle")
    if seen.firmware is None:
        return Finding(WARNING, "the version was not reported", "reduce the load of the link")
    grade = GOOD if seen.firmware.version >= OLDEST_ARDUSUB else WARNING
    return Finding(grade, f"ArduSub {seen.firmware.text}", "update to ArduSub 4.5 or newer")


@_row("frame", "the thrust is distributed over the motors of this frame")
def _frame(seen: Observed, config: Config) -> Finding:
    wanted, value = config.vehicle.frame, seen.parameters.get("FRAME_CONFIG")
    if value is None:
        return _not_reported("FRAME_CONFIG")
    has = FRAMES.get(value, f"number {value:g}")
    grade = GOOD if has == wanted else REFUSED
    fix = f'vehicle.preset = "{PRESET_OF[has]}"' if has in PRESET_OF else "a frame that Holdfast knows"
    return Finding(grade, f"{has}, expected {wanted}" if grade else has, fix)


@_row("steering id", "ArduSub silently refuses steering from any other system id")
def _steering_id(seen: Observed, config: Config) -> Finding:
    ours, value = config.link.system, seen.parameters.get("MAV_GCS_SYSID")
    if value is None:
        return _not_reported("MAV_GCS_SYSID")
    if value != ours:
        fix = f"link.system = {value:g}, or MAV_GCS_SYSID = {ours}"
        return Finding(REFUSED, f"it accepts {value:g}, Holdfast is {ours}", fix)
    tried = seen.directions
    if tried is None or tried.refused:
        return Finding(GOOD, f"MAV_GCS_SYSID is {value:g}, as Holdfast's")
    found = f"{100.0 * tried.echo:.0f} % of the demand reached the motors"
    if tried.echo > HEEDED:
        return Finding(GOOD, found)
    grade = WARNING if tried.echo > SHARED else REFUSED
    fix = "look for another sender, such as a pilot's neutral sticks: two overwrite each other"
    return Finding(grade, found, fix)


@_row("pilot failsafe", "if this computer fails, only FS_PILOT_INPUT stops the thrusters")
def _pilot_failsafe(seen: Observed, config: Config) -> Finding:
    action = seen.parameters.get("FS_PILOT_INPUT")
    timeout_s = seen.parameters.get("FS_PILOT_TIMEOUT")
    if action is None or timeout_s is None:
        return _not_reported("FS_PILOT_INPUT" if action is None else "FS_PILOT_TIMEOUT")
    does = {0.0: "does nothing", 1.0: "neutral", 2.0: "disarm"}.get(action, f"action {action:g}")
    found = f"{does} after {timeout_s:g} s"
    safe = pilot_failsafe_acts(seen.parameters, config.supervisor)
    fix = f"FS_PILOT_INPUT = 2, FS_PILOT_TIMEOUT <= {config.supervisor.max_pilot_timeout_s:g}"
    return Finding(GOOD if safe else REFUSED, found, fix)


@_row("pilot gain", "the autopilot scales MANUAL_CONTROL by it; Holdfast compensates this")
def _pilot_gain(seen: Observed, config: Config) -> Finding:
    if config.vehicle.thrust_path == "rc_override":
        return Finding(GOOD, "not used: RC_CHANNELS_OVERRIDE is not scaled")
    gain, throttle = seen.pilot_gain, seen.parameters.get("JS_THR_GAIN")
    if gain is None or throttle is None:
        return _not_reported("PilotGain" if gain is None else "JS_THR_GAIN")
    full = min(1.0, gain * throttle)
    found = f"{gain:g}, throttle x {throttle:g}: full stick is {100.0 * full:.0f} % thrust"
    grade = GOOD if min(gain, gain * throttle) >= MIN_REACH else WARNING
    fix = 'raise the gain by joystick, or JS_GAIN_DEFAULT and reboot, or thrust_path = "rc_override"'
    return Finding(grade, found, fix)


@_row("input hold", "InputHold adds offsets to the sticks; RollPitch lets x and y control pitch and roll")
def _input_hold(seen: Observed, config: Config) -> Finding:
    on = [name for name, is_on in seen.toggles.items() if is_on]
    if on:
        fix = f"switch {' and '.join(on)} off with its joystick button"
        return Finding(REFUSED, f"{' and '.join(on)} on", fix)
    if not seen.toggles:
        return Finding(WARNING, "not reported", "check that NAMED_VALUE_FLOAT is sent")
    return Finding(GOOD, "InputHold and RollPitch off")


@_row(
    "RC receiver",
    "with an RC receiver the pilot failsafe never acts; only RC_OVERRIDE_TIME stops the thrusters",
)
def _receiver(seen: Observed, config: Config) -> Finding:
    if seen.parameters.get("RC_PROTOCOLS") == 0.0 or seen.receiver_channels == 0:
        return Finding(GOOD, "none")
    if seen.failsafe_seen:
        return Finding(GOOD, "none: the pilot failsafe has acted")
    override_s = seen.parameters.get("RC_OVERRIDE_TIME")
    if override_s is None:
        return _not_reported("RC_OVERRIDE_TIME")
    limit_s = config.supervisor.max_pilot_timeout_s
    safe = 0.0 < override_s <= limit_s
    ends = f"overrides end after {override_s:g} s" if safe else f"RC_OVERRIDE_TIME is {override_s:g}"
    found = f"perhaps one, or another sender steers; {ends}"
    fix = f"RC_PROTOCOLS = 0, or unplug the receiver; and RC_OVERRIDE_TIME <= {limit_s:g}"
    return Finding(WARNING if safe else REFUSED, found, fix)


@_row("streams", "the estimate needs these rates; a parameter transfer reduces them to a quarter for a while")
def _streams(seen: Observed, config: Config) -> Finding:
    asked, came = seen.asked_hz, seen.measured_hz
    slow = [name for name, hz in asked.items() if name in came and came[name] < SLOW_SHARE * hz]
    slow = [name for name in slow if came[name] > 0.0 or name not in NOT_ON_EVERY_VEHICLE]
    if not came:
        return Finding(WARNING, "not measured yet")
    if slow:
        found = ", ".join(f"{name} {came[name]:.0f} of {asked[name]:.0f} Hz" for name in slow)
        return Finding(WARNING, found, "look for another client that sets rates; reduce the load of the link")
    return Finding(GOOD, f"ATTITUDE {came.get('ATTITUDE', 0.0):.0f} Hz and the others as requested")


@_row("depth", "Holdfast controls the depth")
def _depth(seen: Observed, config: Config) -> Finding:
    source, state = config.vehicle.depth_source, seen.state
    if not depth_is_fresh(state, config.supervisor):
        fix = "check that its message is streamed, or choose another vehicle.depth_source"
        if source == "pressure":
            lacking = [name for name in _pressure_parameters(seen) if name not in seen.parameters]
            fix = f"it needs {', '.join(lacking)}, which were not reported" if lacking else fix
        return Finding(REFUSED, f"no fresh depth from {source}", fix)
    delays = state.delays
    late = f"{1e3 * max(0.0, delays.telemetry_s):.0f} ms" if delays.telemetry_known else "not measured"
    gravity = seen.parameters.get("BARO_SPEC_GRAV", math.nan)
    found = f"{state.eta[2]:.2f} m from {source}, {seen.depth_hz:.0f} Hz, late by {late}; density {gravity:g}"
    fix = "BARO_SPEC_GRAV = 1.025 in sea water; otherwise depth reads 2.5 % too deep"
    grade = GOOD if seen.depth_hz >= MIN_DEPTH_HZ else WARNING
    return Finding(grade, found, fix)


def _pressure_parameters(seen: Observed) -> tuple[str, ...]:
    primary = int(seen.parameters.get("BARO_PRIMARY", 1.0))
    return "BARO_PRIMARY", f"BARO{primary + 1}_GND_PRESS", "BARO_SPEC_GRAV"


@_row("EKF origin", "relative_alt shifts permanently by about 0.1 m if it is set under water")
def _origin(seen: Observed, config: Config) -> Finding:
    if seen.origin_known:
        return Finding(GOOD, "set")
    return Finding(WARNING, "not set", "at the surface: holdfast check --set-origin LAT,LON")


@_row("EKF", "attitude, heading and depth come from the autopilot's EKF, which settles after boot")
def _ekf(seen: Observed, config: Config) -> Finding:
    ekf, limits = seen.ekf, config.supervisor
    if ekf is None:
        return Finding(REFUSED, "no EKF_STATUS_REPORT arrived", "wait; reduce the load of the link")
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
        return Finding(REFUSED, f"{found}: wait", fix)
    has = "no position: x and y are not held"
    if ekf.position:
        has = "and position" if ekf.absolute else "and position by dead reckoning: it drifts"
    return Finding(GOOD, f"attitude, depth, {has}")


@_row("compass", "while the EKF aligns its yaw to the compass, the heading jumps")
def _compass(seen: Observed, config: Config) -> Finding:
    state = seen.state
    aligned_s = min(state.ages.yaw_reset_s, state.t_s - seen.yaw_aligned_t_s)
    if aligned_s <= RESET_SETTLE_S:
        found = f"the EKF aligned its yaw less than {RESET_SETTLE_S:g} s ago: wait"
        return Finding(REFUSED, found, "wait; calibrate the compass if this continues")
    return Finding(GOOD, "yaw is steady")


@_row("mode", "Holdfast steers in vehicle.steering_mode and hands over through STABILIZE")
def _mode(seen: Observed, config: Config) -> Finding | None:
    if seen.modes is None:
        return None
    if not seen.modes:
        return Finding(GOOD, "not tested: the vehicle is armed")
    missing = [name for name, came in seen.modes.items() if not came]
    if not missing:
        return Finding(GOOD, f"{' and '.join(seen.modes)} are possible; the previous mode is restored")
    wanted = config.vehicle.steering_mode.upper() in missing
    grade = REFUSED if wanted else WARNING
    return Finding(grade, f"{' and '.join(missing)} refused", "read the autopilot's messages")


@_row("battery", "thrust is proportional to the square of the voltage; the charge must last for the dive")
def _battery(seen: Observed, config: Config) -> Finding:
    low_v = config.supervisor.min_voltage_v
    if seen.voltage_v is None:
        return Finding(WARNING, "no voltage", "set BATT_MONITOR")
    grade = WARNING if seen.voltage_v < FULL_CELL_SHARE * low_v else GOOD
    grade = REFUSED if voltage_is_low(seen.voltage_v, config.supervisor) else grade
    return Finding(grade, f"{seen.voltage_v:.1f} V, low is {low_v:g}", "charge it")


@_row("leak", "Holdfast hands over when the autopilot reports a leak; FS_LEAK_ENABLE enables the report")
def _leak(seen: Observed, config: Config) -> Finding:
    action = seen.parameters.get("FS_LEAK_ENABLE")
    if action is None:
        return Finding(WARNING, "FS_LEAK_ENABLE was not reported", "reduce the load of the link")
    if action == 0.0:
        return Finding(
            WARNING, "not detected: FS_LEAK_ENABLE is 0", "FS_LEAK_ENABLE = 1 to warn, 2 to surface"
        )
    if Condition.LEAK in seen.conditions:
        return Finding(REFUSED, Condition.LEAK.text, Condition.LEAK.remedy)
    does = {1.0: "warns", 2.0: "surfaces"}.get(action, f"does {action:g}")
    return Finding(GOOD, f"no leak; the autopilot {does} if one is detected")


@_row("clock", "it measures the delays; an unknown delay causes a limit cycle")
def _clock(seen: Observed, config: Config) -> Finding:
    if not seen.syncs:
        return Finding(WARNING, "TIMESYNC is not answered", "look for a filter on the link")
    found = f"round trip {1e3 * seen.round_trip_s:.1f} ms, {seen.clock_jumps} jumps in {seen.syncs} answers"
    total_s, tolerated_s = seen.state.delays.total_s, config.delays.gains_bear_s
    if seen.clock_jumps or seen.round_trip_s > MAX_ROUND_TRIP_S:
        return Finding(WARNING, found, "use a faster link; look for a second autopilot on it")
    if total_s > tolerated_s:
        found += f"; total delay {1e3 * total_s:.0f} ms, full gains up to {1e3 * tolerated_s:.0f} ms"
        return Finding(WARNING, found, "the gains are reduced; run on the vehicle, not topside")
    return Finding(GOOD, found)


@_row("supervisor", "Holdfast refuses to engage meanwhile")
def _supervisor(seen: Observed, config: Config) -> Finding | None:
    held = seen.conditions & WITHOUT_ROW
    return Finding(REFUSED, text(held), first_remedy(held)) if held else None


@_row("thrusters", "one reversed motor turns every force into a rotation")
def _thrusters(seen: Observed, config: Config) -> Finding | None:
    tried = seen.directions
    if tried is None:
        return None
    if tried.refused:
        return Finding(WARNING, f"not tested: {tried.refused}", "dive, and check again")
    shares = [*_of_strongest(tried.motors[:HORIZONTAL]), *_of_strongest(tried.motors[HORIZONTAL:])]
    wrong = [str(n) for n, share in enumerate(shares, start=1) if share < REVERSED]
    weak = [str(n) for n, share in enumerate(shares, start=1) if REVERSED <= share < WEAK]
    answers = "measured " + ", ".join(f"{share:+.1f}" for share in tried.motors)
    if wrong:
        fix = " and ".join(f"MOT_{n}_DIRECTION" for n in wrong) + ": change the sign"
        found = f"motor {' and '.join(wrong)} pushes in the wrong direction; {answers}"
        return Finding(REFUSED, found, fix)
    if weak:
        found = f"motor {' and '.join(weak)} gives too little thrust; {answers}"
        return Finding(REFUSED, found, "check propeller, ESC and cable")
    return Finding(GOOD, f"all {len(tried.motors)} push in the right direction; {answers}")


def _of_strongest(motors: Sequence[float]) -> list[float]:
    """Return what the motors of a group give of the strongest one; NaN where it is unknown.

    How strong they all are together says nothing of a motor: the vehicle may be light, or its battery low.
    """
    strongest = max((share for share in motors if math.isfinite(share)), default=math.nan)
    return [0.0 if strongest <= NO_ANSWER else share / strongest for share in motors]


def _not_reported(parameter: str) -> Finding:
    fix = "wait; reduce the load of the link; check whether the vehicle requires signatures"
    return Finding(REFUSED, f"{parameter} was not reported", fix)
