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
from companion.mavlink.streams import SLOW_SHARE
from companion.predive.survey import NotReportedError, Observed
from companion.records import Condition, Z
from companion.supervision.rules import BLOCKING, NOTHING, RESET_SETTLE_S
from companion.supervision.situation import (
    depth_is_fresh,
    ekf_is_doubtful,
    pilot_failsafe_acts,
    voltage_is_low,
)
from companion.supervision.supervisor import first_remedy
from companion.telemetry.glossary import text
from holdfast.version import OLDEST_ARDUSUB

C = Condition

PRESET_OF = {"vectored": "bluerov2", "vectored_6dof": "heavy"}
"""The shipped vehicle of each frame."""

SUBMARINE, ARDUPILOT = 12, 3
"""MAV_TYPE and MAV_AUTOPILOT."""
MIN_REACH = 0.3
"""With a smaller pilot gain MANUAL_CONTROL reaches less than a third of the thrust."""
NOT_ON_EVERY_VEHICLE = frozenset(
    {"DISTANCE_SENSOR", "LOCAL_POSITION_NED", "SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"}
)
"""Streams that a vehicle may lack; another row reports a missing one if it is needed."""
FULL_CELL_SHARE = 1.08
"""A battery below this multiple of the low voltage gives a warning before a dive."""
REVERSED, WEAK = 0.0, 0.35
"""A motor's share, of the strongest in its group, below which it is reversed or gives too little: of four
motors one that is reversed shows -0.33, a dead one 0.2."""
NO_ANSWER = 0.1
"""The strongest motor of a group has to answer with this share of what the configured vehicle would."""

WAIT = "wait; reduce the load of the link; check whether the vehicle requires signatures"
"""What to do about a row that needs what was not reported yet."""


class Grade(IntEnum):
    """The result of a row; the worst one is the exit status of `holdfast check`."""

    GOOD = 0
    WARNING = 1
    REFUSED = 2


GOOD, WARNING, REFUSED = Grade


@dataclass(frozen=True, slots=True)
class CheckRow:
    """One line of the list: what was found, why it matters, how to fix it; or what it needs is `unread`."""

    name: str
    grade: Grade
    found: str
    why: str
    fix: str = ""
    unread: bool = False


class Finding(NamedTuple):
    """What a row found: how grave it is, and how to fix it."""

    grade: Grade
    found: str
    fix: str = ""
    unread: bool = False


class Judge(NamedTuple):
    """A row: its name, why it matters, how it judges, and the condition that the supervisor has for it.

    Where it has one, it tests that in every tick, and the row forbids nothing by itself; one that `settles`
    forbids engaging, and leaves to the condition whether holding goes on.
    """

    name: str
    why: str
    judge: Callable[[Observed, Config], Finding | None]
    condition: Condition
    settles: bool


JUDGES: list[Judge] = []
"""The judges in the order of the list, which is that of this file."""


def _row(
    name: str, why: str, condition: Condition = NOTHING, *, settles: bool = False
) -> Callable[[Callable[[Observed, Config], Finding | None]], None]:
    """Make a function a row of the list; it returns None for what was not tested."""
    return lambda judge: JUDGES.append(Judge(name, why, judge, condition, settles))


def rows(seen: Observed, config: Config) -> list[CheckRow]:
    """Return the list, without the rows of what was not tested; of a vehicle that is not heard the first."""
    found = []
    for row in JUDGES if _is_heard(seen, config) else JUDGES[:1]:
        try:
            it = row.judge(seen, config)
        except NotReportedError as error:
            it = Finding(REFUSED, str(error), WAIT, unread=True)
        if it is not None:
            found.append(CheckRow(row.name, it.grade, it.found, row.why, it.fix, it.unread))
    return found


def refusals(listed: Sequence[CheckRow], *, holding: bool = False) -> str:
    """Return the rows that forbid engaging, or while `holding` to go on, in words; empty if none does."""
    names = {row.name for row in JUDGES if not row.condition or (row.settles and not holding)}
    found: dict[str, list[str]] = {}
    for row in listed:
        if row.grade is REFUSED and row.name in names:
            found.setdefault(row.fix, []).append(f"{row.name}: {row.found}")
    return "; ".join(f"{', '.join(rows)}. Fix: {fix}" for fix, rows in found.items())


def _is_heard(seen: Observed, config: Config) -> bool:
    return seen.state.ages.heartbeat_s <= config.supervisor.heartbeat_timeout_s


@_row("link", "nothing else can be looked at without the autopilot's heartbeat", C.LINK_LOST)
def _link(seen: Observed, config: Config) -> Finding:
    link = config.link
    whom = f"heartbeat of system {link.vehicle_system}, component {link.vehicle_component}"
    if _is_heard(seen, config):
        return Finding(GOOD, f"the {whom} arrives at {link.endpoint}")
    found, fix = seen.contact(seen.state.t_s)
    return Finding(REFUSED, f"no {whom}: {found}", fix, unread=True)


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
    wanted, value = config.vehicle.frame, seen.parameter("FRAME_CONFIG")
    has = FRAMES.get(value, f"number {value:g}")
    if has == wanted:
        return Finding(GOOD, has)
    fix = f'vehicle.preset = "{PRESET_OF[has]}"' if has in PRESET_OF else "a frame that Holdfast knows"
    return Finding(REFUSED, f"{has}, expected {wanted}", fix)


@_row("steering id", "ArduSub silently refuses steering from any other system id")
def _steering_id(seen: Observed, config: Config) -> Finding:
    ours, value = config.link.system, seen.parameter("MAV_GCS_SYSID")
    if value == ours:
        return Finding(GOOD, f"MAV_GCS_SYSID is {value:g}, as Holdfast's")
    fix = f"link.system = {value:g}, or MAV_GCS_SYSID = {ours}"
    return Finding(REFUSED, f"it accepts {value:g}, Holdfast is {ours}", fix)


@_row("pilot failsafe", "if this computer fails, only it stops the thrusters", C.FAILSAFE_UNSAFE)
def _pilot_failsafe(seen: Observed, config: Config) -> Finding:
    action, timeout_s = seen.parameter("FS_PILOT_INPUT"), seen.parameter("FS_PILOT_TIMEOUT")
    does = {0.0: "does nothing", 1.0: "neutral", 2.0: "disarm"}.get(action, f"action {action:g}")
    safe = pilot_failsafe_acts(seen.parameters, config.supervisor)
    fix = f"FS_PILOT_INPUT = 2, FS_PILOT_TIMEOUT <= {config.supervisor.max_pilot_timeout_s:g}"
    return Finding(GOOD if safe else REFUSED, f"{does} after {timeout_s:g} s", fix)


@_row("pilot gain", "the autopilot scales MANUAL_CONTROL by it; Holdfast compensates this")
def _pilot_gain(seen: Observed, config: Config) -> Finding:
    if config.vehicle.thrust_path == "rc_override":
        return Finding(GOOD, "not used: RC_CHANNELS_OVERRIDE is not scaled")
    gain, throttle = seen.pilot_gain, seen.parameter("JS_THR_GAIN")
    if gain is None:
        raise NotReportedError("PilotGain was not reported")
    full = min(1.0, gain * throttle)
    found = f"{gain:g}, throttle x {throttle:g}: full stick is {100.0 * full:.0f} % thrust"
    grade = GOOD if min(gain, gain * throttle) >= MIN_REACH else WARNING
    fix = 'raise the gain by joystick, or JS_GAIN_DEFAULT and reboot, or thrust_path = "rc_override"'
    return Finding(grade, found, fix)


@_row("input hold", "InputHold adds offsets to the sticks; RollPitch lets x and y control pitch and roll")
def _input_hold(seen: Observed, config: Config) -> Finding:
    if not seen.toggles:
        return Finding(WARNING, "not reported", "check that NAMED_VALUE_FLOAT is sent")
    if on := " and ".join(name for name, is_on in seen.toggles.items() if is_on):
        return Finding(REFUSED, f"{on} on", f"switch {on} off with its joystick button")
    return Finding(GOOD, "InputHold and RollPitch off")


@_row("RC receiver", "with one the pilot failsafe never acts, only RC_OVERRIDE_TIME stops the thrusters")
def _receiver(seen: Observed, config: Config) -> Finding:
    if seen.parameters.get("RC_PROTOCOLS") == 0.0 or seen.receiver_channels == 0:
        return Finding(GOOD, "none")
    if seen.failsafe_seen:
        return Finding(GOOD, "none: the pilot failsafe has acted")
    override_s, limit_s = seen.parameter("RC_OVERRIDE_TIME"), config.supervisor.max_pilot_timeout_s
    safe = 0.0 < override_s <= limit_s
    ends = f"overrides end after {override_s:g} s" if safe else f"RC_OVERRIDE_TIME is {override_s:g}"
    fix = f"RC_PROTOCOLS = 0, or unplug the receiver; and RC_OVERRIDE_TIME <= {limit_s:g}"
    return Finding(WARNING if safe else REFUSED, f"perhaps one, or another sender steers; {ends}", fix)


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


@_row("depth", "Holdfast controls the depth", C.DEPTH_STALE)
def _depth(seen: Observed, config: Config) -> Finding:
    source, delays = config.vehicle.depth_source, seen.state.delays
    if not depth_is_fresh(seen.state, config.supervisor):
        fix = "check that its message is streamed, or choose another vehicle.depth_source"
        if source == "pressure":
            fix = f"it needs BARO_PRIMARY, BAROn_GND_PRESS and BARO_SPEC_GRAV; {fix}"
        return Finding(REFUSED, f"no fresh depth from {source}", fix)
    late = f"{1e3 * max(0.0, delays.telemetry_s):.0f} ms" if delays.telemetry_known else "not measured"
    gravity = seen.parameters.get("BARO_SPEC_GRAV", math.nan)
    return Finding(GOOD, f"{seen.state.eta[Z]:.2f} m from {source}, late by {late}; water {gravity:g} kg/L")


@_row("EKF origin", "relative_alt shifts permanently by about 0.1 m if it is set under water")
def _origin(seen: Observed, config: Config) -> Finding:
    if seen.origin_known:
        return Finding(GOOD, "set")
    return Finding(WARNING, "not set", "at the surface: holdfast check --set-origin LAT,LON")


@_row("EKF", "attitude and depth come from it; after boot it settles", C.EKF_UNHEALTHY, settles=True)
def _ekf(seen: Observed, config: Config) -> Finding:
    ekf, limits = seen.ekf, config.supervisor
    if ekf is None:
        return Finding(REFUSED, "no EKF_STATUS_REPORT arrived", "wait; reduce the load of the link")
    no_position = seen.state.ages.position_s <= limits.position_timeout_s and not ekf.position
    lacks = {
        "attitude": not ekf.attitude,
        "depth": not ekf.depth,
        "position, though one is sent": no_position,
    }
    found = " and no ".join(name for name, is_lacking in lacks.items() if is_lacking)
    found = f"it has no {found}" if found else ""
    if not ekf.initialised:
        found = "not initialised"
    elif not found and ekf_is_doubtful(ekf, limits):
        found = f"its variance is {ekf.variance:.2f}, the limit {limits.max_ekf_variance:g}"
    if found:
        fix = "keep the vehicle at rest until the EKF has settled; if it does not, calibrate the compass"
        return Finding(REFUSED, f"{found}: wait", fix)
    has = "no position: x and y are not held"
    if ekf.position:
        has = "and position" if ekf.absolute else "and position by dead reckoning: it drifts"
    return Finding(GOOD, f"attitude, depth, {has}")


@_row("compass", "while the EKF aligns its yaw to the compass, the heading jumps", C.YAW_RESET, settles=True)
def _compass(seen: Observed, config: Config) -> Finding:
    state = seen.state
    aligned_s = min(state.ages.yaw_reset_s, state.t_s - seen.yaw_aligned_t_s)
    if aligned_s <= RESET_SETTLE_S:
        found = f"the EKF aligned its yaw less than {RESET_SETTLE_S:g} s ago: wait"
        return Finding(REFUSED, found, "wait; calibrate the compass if this continues")
    return Finding(GOOD, "yaw is steady")


@_row("battery", "thrust depends on its voltage; the charge must last for the dive", C.BATTERY_LOW)
def _battery(seen: Observed, config: Config) -> Finding:
    low_v = config.supervisor.min_voltage_v
    if seen.voltage_v is None:
        return Finding(WARNING, "no voltage", "set BATT_MONITOR")
    grade = WARNING if seen.voltage_v < FULL_CELL_SHARE * low_v else GOOD
    grade = REFUSED if voltage_is_low(seen.voltage_v, config.supervisor) else grade
    return Finding(grade, f"{seen.voltage_v:.1f} V, low is {low_v:g}", "charge it")


@_row("leak", "Holdfast hands over when the autopilot reports one", C.LEAK)
def _leak(seen: Observed, config: Config) -> Finding:
    if C.LEAK in seen.conditions:
        return Finding(REFUSED, C.LEAK.text, C.LEAK.remedy)
    action = seen.parameters.get("FS_LEAK_ENABLE")
    if not action:
        found = "FS_LEAK_ENABLE was not reported" if action is None else "not detected: FS_LEAK_ENABLE is 0"
        return Finding(WARNING, found, "FS_LEAK_ENABLE = 1 to warn, 2 to surface")
    does = {1.0: "warns", 2.0: "surfaces"}.get(action, f"does {action:g}")
    return Finding(GOOD, f"no leak; the autopilot {does} if one is detected")


@_row("clock", "it measures the delays; an unknown delay causes a limit cycle")
def _clock(seen: Observed, config: Config) -> Finding:
    delays, tolerated_s = seen.state.delays, config.delays.gains_bear_s
    if not delays.telemetry_known:
        return Finding(WARNING, "TIMESYNC is not answered", "look for a filter on the link")
    if C.CLOCK_JUMPED in seen.conditions:
        return Finding(WARNING, C.CLOCK_JUMPED.text, "use a faster link; look for a second autopilot on it")
    found = f"total delay {1e3 * delays.total_s:.0f} ms"
    if delays.total_s > tolerated_s:
        found += f", full gains up to {1e3 * tolerated_s:.0f} ms"
        return Finding(WARNING, found, "the gains are reduced; run on the vehicle, not topside")
    return Finding(GOOD, found)


@_row("thrusters", "one reversed motor turns every force into a rotation")
def _thrusters(seen: Observed, config: Config) -> Finding | None:
    tried = seen.directions
    if tried is None:
        return None
    if tried.refused:
        return Finding(WARNING, f"not tested: {tried.refused}", "dive, and check again")
    shares = [*_of_strongest(tried.motors[:HORIZONTAL]), *_of_strongest(tried.motors[HORIZONTAL:])]
    answers = "measured " + ", ".join(f"{share:+.1f}" for share in tried.motors)
    if wrong := [str(n) for n, share in enumerate(shares, start=1) if share < REVERSED]:
        fix = " and ".join(f"MOT_{n}_DIRECTION" for n in wrong) + ": change the sign"
        return Finding(REFUSED, f"motor {' and '.join(wrong)} pushes in the wrong direction; {answers}", fix)
    if weak := " and ".join(str(n) for n, share in enumerate(shares, start=1) if share < WEAK):
        found = f"motor {weak} gives too little thrust; {answers}"
        return Finding(REFUSED, found, "check propeller, ESC and cable")
    return Finding(GOOD, f"all {len(tried.motors)} push in the right direction; {answers}")


def _of_strongest(motors: Sequence[float]) -> list[float]:
    """Return what the motors of a group give of the strongest one; NaN where it is unknown.

    How strong they all are together says nothing of a motor: the vehicle may be light, or its battery low.
    """
    strongest = max((share for share in motors if math.isfinite(share)), default=math.nan)
    return [0.0 if strongest <= NO_ANSWER else share / strongest for share in motors]


WITHOUT_ROW = (BLOCKING | C.PILOT_TAKEOVER) & ~(C.PREFLIGHT_FAILURE | C.TICK_LATE | C.DISARMED | C.WRONG_MODE)
for _judge in JUDGES:
    WITHOUT_ROW &= ~_judge.condition
"""Conditions that forbid engaging a vehicle, and have no row of their own."""


@_row("supervisor", "Holdfast refuses to engage meanwhile", WITHOUT_ROW)
def _supervisor(seen: Observed, config: Config) -> Finding | None:
    held = seen.conditions & WITHOUT_ROW
    return Finding(REFUSED, text(held), first_remedy(held)) if held else None
