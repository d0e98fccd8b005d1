// Made from companion/supervision/conditions.py by `python -m lab.supervisor_page`.
export default {
  "LINK_LOST": [
    "nothing, or no heartbeat, came from the autopilot",
    "look at cable, router and link.endpoint; then clear the fault"
  ],
  "DEPTH_STALE": [
    "no new, believable depth came",
    "look whether vehicle.depth_source streams and moves; then clear the fault"
  ],
  "ATTITUDE_STALE": [
    "no new attitude came",
    "look whether ATTITUDE streams; then clear the fault"
  ],
  "POSITION_STALE": [
    "position is held, and no new one came",
    "look at the DVL; engage again without it to hold depth and heading"
  ],
  "DEPTH_JUMPED": [
    "a depth lay so far from the expected one that it was left out; if it stays there, depth is stale",
    "look at the depth sensor"
  ],
  "DEPTH_OUT_OF_BOUNDS": [
    "the depth is above the surface or below what was allowed",
    "take over; look at the sensor's zero, and at max_depth_m"
  ],
  "TILTED": [
    "it rolls or pitches so far that only heave and levelling are left: x, y and heading are let go",
    "slower, less current, or a heading that meets it; look for a thruster that is dead or reversed"
  ],
  "TILT_PERSISTS": [
    "it stayed tilted for so long that we cannot right it: the autopilot's STABILIZE, then ALT_HOLD, tries",
    "look for what tilts it: a load beside the centre, a snagged tether, a dead or reversed thruster"
  ],
  "EKF_UNHEALTHY": [
    "the autopilot's estimator has no attitude or no depth, or has doubted compass, velocity or depth for a while",
    "wait until it has settled; calibrate the compass, look at the depth sensor"
  ],
  "LEAK": [
    "the autopilot said Leak Detected, less than 25 s ago (it repeats itself every 20 s)",
    "bring it up"
  ],
  "BATTERY_LOW": [
    "the battery is nearly empty",
    "bring it up"
  ],
  "AUTOPILOT_FAILSAFE": [
    "a failsafe of the autopilot's own is latched (system status 5) though we steer",
    "read the autopilot's messages"
  ],
  "REBOOTED": [
    "the autopilot's clock went backwards: it started anew",
    "find out why (power?); then clear the fault"
  ],
  "DISARMED": [
    "the motors are off",
    "arm it"
  ],
  "WRONG_MODE": [
    "the flight mode is another than vehicle.steering_mode: somebody changed it",
    "engage again, which asks for the mode"
  ],
  "FAILSAFE_UNSAFE": [
    "FS_PILOT_INPUT is 0 or not known, or FS_PILOT_TIMEOUT too long: nothing would stop the thrusters if this computer died",
    "set FS_PILOT_INPUT to 2"
  ],
  "PREFLIGHT_FAILURE": [
    "a row of the pre-dive list is refused (frame, steering id, InputHold...); the reason names it",
    "`holdfast check` says how to fix it"
  ],
  "SATURATED": [
    "an axis has given all it can for long: it is about to be carried off",
    "less current, a slower path, or more max_force"
  ],
  "OFF_TRACK": [
    "it is far from where it should be, and stays there",
    "look for what holds or drives it: tether, current, a dead thruster"
  ],
  "DELAY_TOO_LONG": [
    "telemetry and commands are later than any gains bear",
    "look at the link's load; run on the vehicle instead of topside"
  ],
  "INNOVATION_LARGE": [
    "where it is held, it keeps not being where the estimator expects: sensor, model or clock is wrong",
    "look at the depth's and heading's noise and at the delays"
  ],
  "NON_FINITE": [
    "a computed value was not finite: a bug",
    "keep the recording and tell us; then clear the fault"
  ],
  "TICK_LATE": [
    "this process did not run in time",
    "look at the computer's load"
  ],
  "QUEUE_FULL": [
    "telemetry was dropped, because nobody took it in time",
    "look at whoever subscribes; holding is not affected"
  ],
  "CONFIG_CHANGED": [
    "our configuration or a parameter of the autopilot changed while running, less than 2 s ago",
    "see that it was you"
  ],
  "PEER_CHANGED": [
    "a link that listens turned to another sender less than 2 s ago: the one before had fallen silent",
    "see that it was you; list the addresses in link.allow or ground_station.allow, or set a signing key"
  ],
  "PILOT_TAKEOVER": [
    "somebody else moves a stick",
    "let go of the stick; engage again"
  ],
  "PILOT_LOST": [
    "no heartbeat came from the ground station for ground_station.timeout_s",
    "look at the tether and the ground station; its sticks have the vehicle again at once"
  ],
  "PILOT_LOST_SURFACE": [
    "the same, and ground_station.on_loss says to surface",
    "the same"
  ],
  "OPERATOR_STOP": [
    "the operator asked to stop",
    "nothing"
  ],
  "ENGAGE_ASKED": [
    "the operator asked to engage",
    "nothing"
  ],
  "CLEAR_ASKED": [
    "the operator cleared the fault",
    "nothing"
  ],
  "RAMPED_DOWN": [
    "authority has come down to nothing",
    "nothing"
  ],
  "HANDED_OVER": [
    "ALT_HOLD has the vehicle, and a pilot steers or `keep_alt_hold_s` is over",
    "nothing"
  ],
  "HAND_OVER_REFUSED": [
    "ALT_HOLD was not there 8 s after handing over began",
    "nothing"
  ]
};
