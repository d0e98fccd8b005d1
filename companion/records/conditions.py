"""Every condition of the supervisor, each declared once: its bit and its words."""

from enum import IntFlag
from typing import Any, Self


class Condition(IntFlag):
    """What the supervisor tests every tick, one bit each; what comes first causes what comes later.

    Log, events, screens, documents and the reasons of states have these words;
    `companion.supervision.rules` has the tests.
    """

    text: str
    """What is so while the condition holds."""
    description: str
    """Exactly when it holds, beyond `text`; docs/supervisor.md gives the values of keys of [supervisor]."""
    remedy: str
    """The operator's next step."""
    ended: str
    """The words for its end. Conditions that are only requests or steps have neither these nor a remedy."""
    awaited: str
    """What is awaited where it forbids engaging: "waiting for: ..."."""

    def __new__(
        cls, text: Any, description: str = "", remedy: str = "", ended: str = "", awaited: str = ""
    ) -> Self:
        """Give the next bit to the words; `Condition(bits)` looks up what has them."""
        value = 1 << len(cls.__members__)
        condition = int.__new__(cls, value)
        condition._value_ = value
        condition.text, condition.description, condition.remedy = text, description, remedy
        condition.ended, condition.awaited = ended, awaited
        return condition

    LINK_LOST = (
        "the vehicle is not heard",
        "no message for link_timeout_s, no heartbeat for heartbeat_timeout_s; no message at all while a "
        "sample is stale",
        "check the cable, the router and link.endpoint",
        "the vehicle is heard",
        "the vehicle's heartbeat",
    )
    REBOOTED = (
        "the autopilot rebooted",
        "its clock went backwards",
        "find the cause, such as the power supply",
        "the autopilot has started again",
        "the autopilot's start",
    )
    TICK_LATE = (
        "a tick was too late",
        "of this process, by more than late_tick_s",
        "reduce the load of this computer",
        "ticks are punctual",
        "punctual ticks",
    )
    OTHER_FIRST = (
        "another Holdfast with our ids was here first",
        "another program used our ids when we came (frames or answers within 3 s of our first contact), or "
        "steers with them for more than 3 s. If two came together, neither steers",
        "end one of the two: BlueOS extension, service, or run on another computer",
        "the other Holdfast, which was here first, has gone",
        "the end of the other Holdfast",
    )
    OTHER_CAME = (
        "another Holdfast with our ids has come",
        "as OTHER FIRST, but later: the other one releases the vehicle, and this one continues",
        "end one of the two: BlueOS extension, service, or run on another computer",
        "the other Holdfast, which came later, has gone",
    )
    INTERRUPTED = (
        "telemetry or a tick is late",
        "while ACTIVE depth or attitude is too old to steer by, or a tick was too late: thrust is neutral "
        "([short interruptions](#short-interruptions))",
    )
    INTERRUPTED_OFTEN = (
        "telemetry or ticks pause too often",
        "interruptions leave less than 0.8 of the authority as a mean over 10 s: ALT_HOLD does better",
        "look for what lowers the rate of ATTITUDE or of vehicle.depth_source, such as a ground station; "
        "check cable and router; reduce the load of this computer",
        "telemetry and ticks no longer pause too often",
    )
    UNSTEADY = (
        "telemetry or ticks pause at times",
        "INTERRUPTED less than a minute ago",
        "check cable and router; reduce the load of this computer",
        "telemetry and ticks have not paused for a minute",
    )
    NON_FINITE = (
        "a computed value was not finite",
        "a bug",
        "keep the recording and report it to us",
        "computed values are finite",
        "finite values",
    )
    CLOCK_INCONSISTENT = (
        "the vehicle's clock contradicts itself",
        "stamps and answers to TIMESYNC contradict each other for longer than after one jump",
        "look for a second autopilot with this system id on the link, or a router that changes TIMESYNC",
        "the vehicle's clock is consistent",
        "a consistent clock of the vehicle",
    )
    DELAY_TOO_LONG = (
        "the delay is too long",
        "longer than max_delay_s: too late for any gains",
        "reduce the load of the link; run Holdfast on the vehicle instead of topside",
        "the delay is short enough",
        "a shorter delay",
    )
    DEPTH_JUMPED = (
        "the measured depth jumped",
        "more than max_depth_jump_m from the predicted one: it was rejected; if this continues, DEPTH "
        "STALE follows",
        "check the depth sensor",
        "the measured depth is plausible",
        "a plausible depth",
    )
    DEPTH_DOUBTED = (
        "the measured depth does not answer the vehicle's motion",
        "climb rate or pressure repeat exactly, or the depth does while the climb rate moves, or they "
        "differ; or the autopilot reports its sensor. Such a depth is not used: DEPTH STALE follows",
        "restart the autopilot; check the depth sensor and its cable",
        "the measured depth answers the vehicle's motion again",
        "a depth that answers the vehicle's motion",
    )
    DEPTH_STALE = (
        "no fresh depth",
        "no new, plausible one for depth_timeout_s",
        "check that vehicle.depth_source is streamed and changes",
        "fresh depth arrives",
        "a fresh depth",
    )
    ATTITUDE_DOUBTED = (
        "the measured attitude does not answer the vehicle's motion",
        "an angle or a body rate repeats exactly, or gyro and angle turn against each other: such an "
        "attitude is not used, and ATTITUDE STALE follows",
        "restart the autopilot",
        "the measured attitude answers the vehicle's motion again",
        "an attitude that answers the vehicle's motion",
    )
    ATTITUDE_STALE = (
        "no fresh attitude",
        "no new one for attitude_timeout_s",
        "check that ATTITUDE is streamed",
        "fresh attitude arrives",
        "a fresh attitude",
    )
    POSITION_DOUBTED = (
        "the measured position does not answer the vehicle's motion",
        "position or velocity repeats exactly, or the position does while the velocity moves; x and y are "
        "wanted. Such a position is not used: POSITION STALE follows",
        "restart the DVL, check its driver; steer by hand meanwhile",
        "the measured position answers the vehicle's motion again",
    )
    POSITION_STALE = (
        "no fresh position",
        "for position_timeout_s; x and y are wanted: they are released until a position returns; depth and "
        "heading are held",
        "check the DVL; steer by hand meanwhile",
        "fresh position arrives",
    )
    POSITION_UNUSED = (
        "a position has come, and x and y are not held",
        "Holdfast engaged without it: x and y stay the pilot's until somebody asks for them",
        "hold here (`holdfast hold`), engage again (`holdfast engage`), or go to a place",
        "x and y are held, or the position is gone",
    )
    GROUND_LOST = (
        "no fresh altitude over the ground",
        "it is to be kept, and no plausible echo came for a second: the depth is held meanwhile",
        "check the rangefinder or the DVL; command a depth",
        "fresh altitude over the ground arrives",
    )
    GROUND_DOUBTED = (
        "the range does not answer the vehicle's motion",
        "an altitude is to be kept: the depth is held, and the vehicle nods by 10 cm meanwhile",
        "clean the transducer, check the rangefinder's driver; command a depth",
        "the range answers the vehicle's motion again",
    )
    YAW_RESET = (
        "the EKF reset its yaw",
        "less than 3 s ago; the heading setpoint turned with it, so the vehicle does not",
        "command the heading again if you want another; calibrate the compass if this happens often",
        "the EKF's yaw is steady",
    )
    POSITION_RESET = (
        "the EKF reset its position",
        "less than 3 s ago; the setpoint was shifted with it, so the vehicle does not move",
        "command the position again if you want another; check the DVL if this happens often",
        "the EKF's position is steady",
    )
    DEPTH_RESET = (
        "the autopilot's zero of depth moved",
        "less than 3 s ago: its depth jumped without a motion, as where home or origin is set. Depth counts"
        " on from the surface that was known, so the vehicle stays",
        "read the depth here, the ground station's differs; set home and origin at the surface",
        "the autopilot's zero of depth is steady",
    )
    HEADING_WRONG = (
        "the heading is wrong",
        "it turned by 10° without the gyro, or the vehicle moves 30° aside of its thrust, or as its mirror "
        "image; from 40° on, and in a mirror, x and y are released, and tried again after 30 s, then after "
        "twice as long each time; depth and heading are held",
        "move away from steel, calibrate the compass, check its orientation, the DVL's and the order of the "
        "horizontal motors; then engage again (`holdfast engage`, button or dashboard)",
        "the heading agrees with the gyro and the course over ground",
    )
    DEPTH_OUT_OF_BOUNDS = (
        "the measured depth is out of bounds",
        "above the surface, or below max_depth_m, by more than depth_margin_m",
        "take over; check the zero of the depth sensor, and max_depth_m",
        "the measured depth is within its bounds",
        "a depth within its bounds",
    )
    THRUSTER_MISSED = (
        "a motor gives no thrust, and the others cannot do its work",
        "such as a vertical one of two; the event and `dead_motor` give its number",
        "bring the vehicle up, and repair it",
        "no motor is missed",
        "the thrust of the dead motor",
    )
    THRUSTER_DEAD = (
        "a motor gives no thrust",
        "the others of its group replace it with less force; event and `dead_motor` give its number",
        "go on with care: there is no second one to spare; if a horizontal one is dead and the vehicle "
        "drifts, turn it by 90°",
        "the others no longer do a motor's work",
    )
    THRUSTER_REVERSED = (
        "a motor pushes the other way",
        "such as after work on it: it is used with its sign turned; event and `reversed_motor` give its "
        "number. The autopilot does not know: its modes may turn the vehicle over",
        "bring the vehicle up with Holdfast, not with the sticks; then change the sign of MOT_n_DIRECTION",
        "the motors are taken to push the right way",
    )
    TURNED_OVER = (
        "the vehicle turned over",
        "tilted by more than 100° for 2 s, less a quarter of the other time, while Holdfast steers or hands "
        "over; without thrust it rights itself",
        "look for motors that are reversed or exchanged (`holdfast check --thrusters`), a wrong frame, a "
        "load off its centre",
        "the vehicle is upright",
    )
    TILTED = (
        "tilted too far",
        "more than max_tilt_deg from its held angle, or from level: only heave and levelling remain",
        "move slower, avoid the current or turn into it; look for a dead or reversed thruster",
        "no longer tilted too far",
        "a vehicle at its angle",
    )
    TILT_PERSISTS = (
        "tilted too far for too long",
        "for off_track_s, less the time in which it was not, and not within 0.3 m of its depth: the "
        "autopilot tries, in STABILIZE and then ALT_HOLD; with a reversed motor thrust ends instead",
        "look for the cause: an off-centre load, a snagged tether, a dead, reversed or exchanged thruster",
        "the lasting tilt has ended",
    )
    EKF_UNHEALTHY = (
        "the autopilot's EKF is unhealthy",
        "no attitude or no depth, or a variance above max_ekf_variance for ekf_doubt_s",
        "wait until the EKF has settled; calibrate the compass, check the depth sensor",
        "the autopilot's EKF is healthy",
        "a healthy EKF",
    )
    LEAK = (
        "the autopilot reports a leak",
        "Leak Detected less than 25 s ago (it repeats this every 20 s)",
        "bring the vehicle up",
        "no leak has been reported for 25 s",
        "25 s without a report of a leak",
    )
    BATTERY_LOW = (
        "the battery is low",
        "below min_voltage_v for battery_low_s",
        "bring the vehicle up",
        "the battery is no longer low",
        "a charged battery",
    )
    AUTOPILOT_FAILSAFE = (
        "a failsafe of the autopilot is latched",
        "system status 5, while Holdfast steers",
        "read the autopilot's messages",
        "no failsafe of the autopilot is latched",
    )
    FAILSAFE_SURFACES = (
        "a failsafe of the autopilot surfaces the vehicle",
        "a leak, or the battery, changed the flight mode to SURFACE",
        "read the autopilot's messages",
        "no failsafe surfaces the vehicle",
    )
    FAILSAFE_UNSAFE = (
        "the pilot-input failsafe does not act",
        "FS_PILOT_INPUT is 0 or unread, or FS_PILOT_TIMEOUT longer than max_pilot_timeout_s: nothing would "
        "stop the thrusters if this computer failed. A request to engage reads both again, and waits for "
        "the answers",
        "set FS_PILOT_INPUT to 2, FS_PILOT_TIMEOUT to 3 or less; if they are not read, look for a filter on"
        " the link",
        "the pilot-input failsafe acts",
        "the pilot-input failsafe",
    )
    PREFLIGHT_FAILURE = (
        "a row of the pre-dive list is refused",
        "such as frame, steering id, InputHold; the reason names it",
        "run `holdfast check`: it says how to fix it",
        "no row of the pre-dive list is refused",
        "the pre-dive list",
    )
    SATURATED = (
        "not enough thrust",
        "an axis has been saturated for saturated_s, less half of the time in which it was not; the vehicle "
        "may drift away",
        "avoid the current, go deeper below waves, slow the path down, or raise max_force; look for dead, "
        "reversed or exchanged thrusters",
        "the thrust is enough again",
    )
    THRUST_UNANSWERED = (
        "full vertical thrust does not move the vehicle",
        "the depth changes by less than 5 cm in 3 s of it: something holds the vehicle, or its depth sensor "
        "does not answer, as one whose port is blocked",
        "look where the vehicle is; free it, or take it up by hand and clear the port of the depth sensor",
        "full vertical thrust moves the vehicle",
    )
    THRUST_OPPOSED = (
        "the vehicle moves against its vertical thrust",
        "by its climb rate, for about 2 s, and faster than a load or waves explain",
        "take over with care: sticks may act the wrong way, too; check MOT_5_DIRECTION to MOT_8_DIRECTION, "
        "RC3_REVERSED, and the sign of the depth",
        "vertical thrust moves the vehicle its way",
    )
    OFF_TRACK = (
        "too far from the setpoint",
        "by more than max_error_m or max_error_deg for off_track_s, less the time in which it was not; the "
        "5 s after a motor was found dead or reversed do not count; with a reversed motor thrust ends",
        "look for the cause: tether, current, a dead, reversed or exchanged thruster",
        "near the setpoint again",
    )
    CLOCK_JUMPED = (
        "the vehicle's clock jumped",
        "a stamp or an answer to TIMESYNC contradicts the estimated clock offset",
        "a simulator does this on a busy computer; if a real vehicle goes on doing it, look for a second "
        "autopilot with this system id",
        "the vehicle's clock is steady",
    )
    INNOVATION_LARGE = (
        "measurements miss the prediction",
        "in a held degree of freedom, by more than max_innovation_m or max_innovation_deg: sensor, model "
        "or clock fails",
        "check the noise of depth and heading, and the delays",
        "measurements match the prediction",
        "measurements that match the prediction",
    )
    QUEUE_FULL = (
        "telemetry was dropped",
        "Zenoh did not take it in time",
        "check the subscribers; control is not affected",
        "no telemetry is dropped",
    )
    CONFIG_CHANGED = (
        "a setting changed",
        "less than 2 s ago: the configuration or a parameter of the autopilot",
        "find out who changed it, unless it was you",
        "the settings stay as they are",
    )
    PEER_CHANGED = (
        "a link got another peer",
        "less than 2 s ago: the one before had fallen silent",
        "unless you changed it, list addresses in link.allow or ground_station.allow, or set a signing key",
        "the links keep their peers",
    )
    PILOT_TAKEOVER = (
        "the pilot steers",
        "somebody else moved a stick by more than pilot_deflection less than pilot_hold_s ago, or the "
        "pilot overrides all axes",
        "release the stick; then engage again (`holdfast engage`, button or dashboard)",
        "the pilot's sticks are at rest",
    )
    PILOT_LOST = (
        "no heartbeat of the pilot's ground station",
        "for ground_station.timeout_s",
        "check the tether and the ground station; when it returns, its sticks take effect at once",
        "the pilot's ground station is heard",
        "the ground station's heartbeat",
    )
    PILOT_LOST_SURFACE = (
        "no heartbeat of the pilot's ground station: to the surface",
        'as PILOT LOST, and ground_station.on_loss is "surface"',
        "check the tether and the ground station; when it returns, its sticks take effect at once",
        "the pilot's ground station is heard: no ascent",
    )
    DISARMED = (
        "the vehicle is disarmed",
        "",
        "arm the vehicle at the ground station, or start Holdfast with --arm",
        "the vehicle is armed",
        "arming",
    )
    WRONG_MODE = (
        "the flight mode is not the one for steering",
        "it is not vehicle.steering_mode",
        "engage (`holdfast engage`, button or dashboard): Holdfast then requests the mode",
        "the flight mode is right",
        "the flight mode for steering",
    )
    RAMPED_DOWN = ("ramped down to neutral", "the authority has reached 0, after ramp_down_s")
    HAND_OVER_HELD = (
        "ALT_HOLD holds the depth until somebody steers",
        "neutral frames keep the vehicle armed until a pilot steers or keep_alt_hold_s has passed",
    )
    HANDED_OVER = (
        "the autopilot holds depth",
        "in ALT_HOLD, and a pilot steers or keep_alt_hold_s has passed",
    )
    SURFACED = (
        "surfaced; the autopilot holds depth",
        "the vehicle reached the surface, and the firmware changed from SURFACE to ALT_HOLD",
    )
    HAND_OVER_REFUSED = (
        "the autopilot did not change the mode",
        "not ALT_HOLD in time after the hand-over began",
    )
    OPERATOR_STOP = ("the operator released the vehicle",)
    ENGAGE_ASKED = ("the operator asks to engage",)
    CLEAR_ASKED = ("the operator cleared the fault",)
