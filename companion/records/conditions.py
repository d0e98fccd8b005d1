"""Every condition of the supervisor, each declared once: its bit and its words."""

from enum import IntFlag
from typing import Any, Self


class Condition(IntFlag):
    """What the supervisor tests every tick, one bit each; what comes first causes what comes later.

    Log, events, screens, documents and the reasons of states have these words;
    `companion.supervision.conditions` has the tests.
    """

    text: str
    """What is so while the condition holds."""
    awaited: str
    """What is awaited: "waiting for: ..."."""
    ended: str
    """That it has ended."""
    description: str
    """Exactly when it holds, beyond `text`."""
    remedy: str
    """The operator's next step; empty for none."""

    def __new__(
        cls, text: Any, awaited: str = "", ended: str = "", description: str = "", remedy: str = ""
    ) -> Self:
        """Give the next bit to the words; `Condition(bits)` looks up what has them."""
        value = 1 << len(cls.__members__)
        condition = int.__new__(cls, value)
        condition._value_ = value
        condition.text, condition.awaited, condition.ended = text, awaited, ended
        condition.description, condition.remedy = description, remedy
        return condition

    LINK_LOST = (
        "the vehicle is not heard",
        "the vehicle's heartbeat",
        "the vehicle is heard",
        "no message, or no heartbeat, arrived from the autopilot in time; or no message at all while "
        "depth or attitude is stale",
        "check the cable, the router and link.endpoint",
    )
    REBOOTED = (
        "the autopilot rebooted",
        "the autopilot's start",
        "the autopilot has started again",
        "its clock went backwards",
        "find the cause, such as the power supply",
    )
    TICK_LATE = (
        "a tick was too late",
        "punctual ticks",
        "ticks are punctual",
        "a tick of this process",
        "reduce the load of this computer",
    )
    OTHER_FIRST = (
        "another Holdfast with our ids was here first",
        "the end of the other Holdfast",
        "the other Holdfast, which was here first, has gone",
        "frames of our ids that this process did not send, or answers to such frames, within 3 s of its "
        "first contact; or such frames steer for more than 3 s. If two came together, neither steers",
        "end one of the two: BlueOS extension, service, or run on another computer",
    )
    OTHER_CAME = (
        "another Holdfast with our ids has come",
        "being the only Holdfast with our ids",
        "the other Holdfast, which came later, has gone",
        "as OTHER FIRST, but later: the other one releases the vehicle, and this one continues",
        "end one of the two: BlueOS extension, service, or run on another computer",
    )
    INTERRUPTED = (
        "telemetry or a tick is late",
        "punctual telemetry and ticks",
        "telemetry and ticks are punctual",
        "while ACTIVE depth or attitude is too old to steer by, or a tick was too late: thrust is neutral "
        "([short interruptions](#short-interruptions))",
        "",
    )
    UNSTEADY = (
        "telemetry or ticks pause at times",
        "a minute without a pause",
        "telemetry and ticks have not paused for a minute",
        "INTERRUPTED less than a minute ago",
        "check cable and router; reduce the load of this computer",
    )
    NON_FINITE = (
        "a computed value was not finite",
        "finite values",
        "computed values are finite",
        "a bug",
        "keep the recording and report it to us",
    )
    CLOCK_INCONSISTENT = (
        "the vehicle's clock contradicts itself",
        "a consistent clock of the vehicle",
        "the vehicle's clock is consistent",
        "time stamps and answers to TIMESYNC contradict each other for longer than one jump explains",
        "look for a second autopilot with this system id on the link, or a router that changes TIMESYNC",
    )
    DELAY_TOO_LONG = (
        "the delay is too long",
        "a shorter delay",
        "the delay is short enough",
        "telemetry and commands together are too late for any gains",
        "reduce the load of the link; run Holdfast on the vehicle instead of topside",
    )
    DEPTH_JUMPED = (
        "the measured depth jumped",
        "a plausible depth",
        "the measured depth is plausible",
        "it was too far from the predicted one and was rejected; if this continues, DEPTH STALE follows",
        "check the depth sensor",
    )
    DEPTH_STALE = (
        "no fresh depth",
        "a fresh depth",
        "fresh depth arrives",
        "no new, plausible one arrived in time",
        "check that vehicle.depth_source is streamed and changes",
    )
    ATTITUDE_STALE = (
        "no fresh attitude",
        "a fresh attitude",
        "fresh attitude arrives",
        "no new one arrived in time",
        "check that ATTITUDE is streamed",
    )
    POSITION_STALE = (
        "no fresh position",
        "a fresh position",
        "fresh position arrives",
        "x and y are wanted: they are released to the pilot, or to neutral, and held again when a position "
        "returns; depth and heading are held",
        "check the DVL; steer by hand meanwhile",
    )
    POSITION_UNUSED = (
        "a position has come, and x and y are not held",
        "x and y that are held",
        "x and y are held, or the position is gone",
        "Holdfast engaged without a position: x and y stay the pilot's until somebody asks for them",
        "hold here (`holdfast hold`), engage again (`holdfast engage`), or go to a place",
    )
    GROUND_LOST = (
        "no fresh altitude over the ground",
        "a fresh altitude over the ground",
        "fresh altitude over the ground arrives",
        "it is to be kept, and no plausible echo came for a second: the depth is held until the ground is "
        "found again",
        "check the rangefinder or the DVL; command a depth",
    )
    GROUND_DOUBTED = (
        "the range does not answer the vehicle's motion",
        "a range that answers the vehicle's motion",
        "the range answers the vehicle's motion again",
        "an altitude is to be kept, and the range does not show how the vehicle itself moves: the depth is "
        "held, and the vehicle nods by 10 cm until the range shows it",
        "clean the transducer, check the rangefinder's driver; command a depth",
    )
    YAW_RESET = (
        "the EKF reset its yaw",
        "a steady yaw of the EKF",
        "the EKF's yaw is steady",
        "less than 3 s ago; the heading setpoint was shifted with it, so the vehicle does not turn",
        "command the heading again if you want another; calibrate the compass if this happens often",
    )
    POSITION_RESET = (
        "the EKF reset its position",
        "a steady position of the EKF",
        "the EKF's position is steady",
        "less than 3 s ago; the position setpoint was shifted with it, so the vehicle does not move",
        "command the position again if you want another; check the DVL if this happens often",
    )
    DEPTH_RESET = (
        "the autopilot's zero of depth moved",
        "a steady zero of the autopilot's depth",
        "the autopilot's zero of depth is steady",
        "less than 3 s ago, as where home or origin is set: its depth jumped, and neither climb rate nor "
        "pressure shows a motion. Depth counts on from the surface that was known, so the vehicle stays",
        "read the depth here, the ground station's differs; set home and origin at the surface",
    )
    HEADING_WRONG = (
        "the heading is wrong",
        "a heading that agrees with the gyro and the course over ground",
        "the heading agrees with the gyro and the course over ground",
        "it turned by 10° without the gyro, or the vehicle surely moves 30° aside of its thrust; "
        "from 40° on x and y are released until somebody engages again; depth and heading are held",
        "move away from steel, calibrate the compass, check its orientation; then engage again "
        "(`holdfast engage`, button or dashboard)",
    )
    DEPTH_OUT_OF_BOUNDS = (
        "the measured depth is out of bounds",
        "a depth within its bounds",
        "the measured depth is within its bounds",
        "it is above the surface, or below max_depth_m, by more than the margin",
        "take over; check the zero of the depth sensor, and max_depth_m",
    )
    THRUSTER_MISSED = (
        "a motor gives no thrust, and the others cannot do its work",
        "the thrust of the dead motor",
        "no motor is missed",
        "such as a vertical one of two; the event and `dead_motor` give its number",
        "bring the vehicle up, and repair it",
    )
    THRUSTER_DEAD = (
        "a motor gives no thrust",
        "the thrust of the dead motor",
        "the others no longer do a motor's work",
        "the others of its group do its work with less force; the event and `dead_motor` give its number",
        "go on with care: there is no second one to spare; if a horizontal one is dead and the vehicle "
        "drifts, turn it by 90°",
    )
    TILTED = (
        "tilted too far",
        "a vehicle at its angle",
        "no longer tilted too far",
        "roll or pitch is too far from its held angle, or from level: only heave and levelling remain; x, y "
        "and heading are released",
        "move slower, avoid the current or turn into it; look for a dead or reversed thruster",
    )
    TILT_PERSISTS = (
        "tilted too far for too long",
        "a level vehicle",
        "the lasting tilt has ended",
        "Holdfast can neither level the vehicle nor hold its depth within 0.3 m: the autopilot tries, in "
        "STABILIZE and then ALT_HOLD",
        "look for the cause: an off-centre load, a snagged tether, a dead or reversed thruster",
    )
    EKF_UNHEALTHY = (
        "the autopilot's EKF is unhealthy",
        "a healthy EKF",
        "the autopilot's EKF is healthy",
        "it reports no attitude or no depth, or its variance of compass, velocity or depth has been too "
        "high for ekf_doubt_s",
        "wait until the EKF has settled; calibrate the compass, check the depth sensor",
    )
    LEAK = (
        "the autopilot reports a leak",
        "25 s without a report of a leak",
        "no leak has been reported for 25 s",
        "Leak Detected less than 25 s ago (it repeats this every 20 s)",
        "bring the vehicle up",
    )
    BATTERY_LOW = (
        "the battery is low",
        "a charged battery",
        "the battery is no longer low",
        "its voltage is too low for battery_low_s",
        "bring the vehicle up",
    )
    AUTOPILOT_FAILSAFE = (
        "a failsafe of the autopilot is latched",
        "the end of the autopilot's failsafe",
        "no failsafe of the autopilot is latched",
        "system status 5, while Holdfast steers",
        "read the autopilot's messages",
    )
    FAILSAFE_SURFACES = (
        "a failsafe of the autopilot surfaces the vehicle",
        "the end of the autopilot's failsafe",
        "no failsafe surfaces the vehicle",
        "a leak, or the battery, changed the flight mode to SURFACE",
        "read the autopilot's messages",
    )
    FAILSAFE_UNSAFE = (
        "the pilot-input failsafe does not act",
        "the pilot-input failsafe",
        "the pilot-input failsafe acts",
        "FS_PILOT_INPUT is 0 or was never read, or FS_PILOT_TIMEOUT is too long: nothing would stop the "
        "thrusters if this computer failed. A request to engage reads both again, and waits for the "
        "answers",
        "set FS_PILOT_INPUT to 2, FS_PILOT_TIMEOUT to 3 or less; if they are not read, look for a filter "
        "on the link",
    )
    PREFLIGHT_FAILURE = (
        "a row of the pre-dive list is refused",
        "the pre-dive list",
        "no row of the pre-dive list is refused",
        "such as frame, steering id, InputHold; the reason names it",
        "run `holdfast check`: it says how to fix it",
    )
    SATURATED = (
        "not enough thrust",
        "enough thrust",
        "the thrust is enough again",
        "an axis has been saturated for saturated_s; the vehicle may drift away",
        "avoid the current, slow the path down, or raise max_force",
    )
    OFF_TRACK = (
        "too far from the setpoint",
        "a smaller error",
        "near the setpoint again",
        "the error is too large for off_track_s; the 5 s after a motor was found dead do not count",
        "look for the cause: tether, current, a dead thruster",
    )
    CLOCK_JUMPED = (
        "the vehicle's clock jumped",
        "a steady clock of the vehicle",
        "the vehicle's clock is steady",
        "a time stamp or an answer to TIMESYNC contradicts the estimated clock offset",
        "a simulator does this on a busy computer; if a real vehicle goes on doing it, look for a second "
        "autopilot with this system id",
    )
    INNOVATION_LARGE = (
        "measurements miss the prediction",
        "measurements that match the prediction",
        "measurements match the prediction",
        "in a held degree of freedom: sensor, model or clock fails",
        "check the noise of depth and heading, and the delays",
    )
    QUEUE_FULL = (
        "telemetry was dropped",
        "room for telemetry",
        "no telemetry is dropped",
        "Zenoh did not take it in time",
        "check the subscribers; control is not affected",
    )
    CONFIG_CHANGED = (
        "a setting changed",
        "settings that stay",
        "the settings stay as they are",
        "less than 2 s ago: the configuration or a parameter of the autopilot",
        "find out who changed it, unless it was you",
    )
    PEER_CHANGED = (
        "a link got another peer",
        "links that keep their peers",
        "the links keep their peers",
        "less than 2 s ago: the one before had fallen silent",
        "unless you changed it, list addresses in link.allow or ground_station.allow, or set a signing key",
    )
    PILOT_TAKEOVER = (
        "the pilot steers",
        "the pilot's sticks at rest",
        "the pilot's sticks are at rest",
        "somebody else moves a stick, or the pilot overrides all axes",
        "release the stick; then engage again (`holdfast engage`, button or dashboard)",
    )
    PILOT_LOST = (
        "no heartbeat of the pilot's ground station",
        "the ground station's heartbeat",
        "the pilot's ground station is heard",
        "for ground_station.timeout_s",
        "check the tether and the ground station; when it returns, its sticks take effect at once",
    )
    PILOT_LOST_SURFACE = (
        "no heartbeat of the pilot's ground station: to the surface",
        "the ground station's heartbeat",
        "the pilot's ground station is heard: no ascent",
        'as PILOT LOST, and ground_station.on_loss is "surface"',
        "check the tether and the ground station; when it returns, its sticks take effect at once",
    )
    DISARMED = (
        "the vehicle is disarmed",
        "arming",
        "the vehicle is armed",
        "the motors are disarmed",
        "arm the vehicle",
    )
    WRONG_MODE = (
        "the flight mode is not the one for steering",
        "the flight mode for steering",
        "the flight mode is right",
        "it is not vehicle.steering_mode",
        "engage (`holdfast engage`, button or dashboard): Holdfast then requests the mode",
    )
    RAMPED_DOWN = (
        "ramped down to neutral",
        "the end of the ramp",
        "thrust is permitted",
        "the authority has reached 0",
        "",
    )
    HAND_OVER_HELD = (
        "ALT_HOLD holds the depth until somebody steers",
        "ALT_HOLD",
        "the autopilot no longer holds depth after a hand-over",
        "the autopilot confirmed ALT_HOLD; neutral frames keep the vehicle armed until a pilot steers or "
        "`keep_alt_hold_s` has passed",
        "",
    )
    HANDED_OVER = (
        "the autopilot holds depth",
        "the end of the hand-over",
        "no hand-over is complete",
        "the autopilot holds depth in ALT_HOLD, and a pilot steers or `keep_alt_hold_s` has passed",
        "",
    )
    SURFACED = (
        "surfaced; the autopilot holds depth",
        "the surface",
        "the ascent has ended",
        "the vehicle reached the surface, and the firmware changed from SURFACE to ALT_HOLD",
        "",
    )
    HAND_OVER_REFUSED = (
        "the autopilot did not change the mode",
        "ALT_HOLD",
        "the refused hand-over has ended",
        "the flight mode was not ALT_HOLD in time after the hand-over began",
        "",
    )
    OPERATOR_STOP = (
        "the operator released the vehicle",
        "a release",
        "the request to release has passed",
        "the operator asked to stop",
        "",
    )
    ENGAGE_ASKED = (
        "the operator asks to engage",
        "a request to engage",
        "nobody asks to engage",
        "the operator asked to engage",
        "",
    )
    CLEAR_ASKED = (
        "the operator cleared the fault",
        "a request to clear the fault",
        "the request to clear has passed",
        "the operator cleared the fault",
        "",
    )
