"""What ArduSub's storage keeps of a mission's items, as read back from the firmware."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

WITH_PLACE: dict[int, str] = {
    mavlink.MAV_CMD_NAV_WAYPOINT: "i000",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "00i0",
    mavlink.MAV_CMD_NAV_LOITER_TURNS: "i0ib",
    mavlink.MAV_CMD_NAV_LOITER_TIME: "i0bb",
    mavlink.MAV_CMD_NAV_LAND: "i00b",
    mavlink.MAV_CMD_NAV_TAKEOFF: "i000",
    mavlink.MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT: "i000",
    mavlink.MAV_CMD_NAV_LOITER_TO_ALT: "0i0b",
    mavlink.MAV_CMD_NAV_SPLINE_WAYPOINT: "i000",
    mavlink.MAV_CMD_NAV_VTOL_TAKEOFF: "0000",
    mavlink.MAV_CMD_NAV_VTOL_LAND: "i000",
    mavlink.MAV_CMD_NAV_GUIDED_ENABLE: "i000",
    mavlink.MAV_CMD_NAV_PAYLOAD_PLACE: "f000",
    mavlink.MAV_CMD_DO_SET_HOME: "i000",
    mavlink.MAV_CMD_DO_RETURN_PATH_START: "0000",
    mavlink.MAV_CMD_DO_LAND_START: "0000",
    mavlink.MAV_CMD_DO_GO_AROUND: "0000",
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: "i000",
    mavlink.MAV_CMD_DO_SET_ROI: "i000",
}
"""Commands that are stored with frame, x, y and z. What is kept of each parameter.

f is the number, i its whole part, b whether it is above zero, 0 nothing.
"""

WITHOUT_PLACE: dict[int, str] = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "0000",
    mavlink.MAV_CMD_NAV_ALTITUDE_WAIT: "ffi0",
    mavlink.MAV_CMD_NAV_DELAY: "fiii",
    mavlink.MAV_CMD_CONDITION_DELAY: "f000",
    mavlink.MAV_CMD_CONDITION_DISTANCE: "f000",
    mavlink.MAV_CMD_CONDITION_YAW: "ffii",
    mavlink.MAV_CMD_DO_JUMP: "ii00",
    mavlink.MAV_CMD_DO_CHANGE_SPEED: "iff0",
    mavlink.MAV_CMD_DO_SET_RELAY: "ii00",
    mavlink.MAV_CMD_DO_REPEAT_RELAY: "iif0",
    mavlink.MAV_CMD_DO_SET_SERVO: "ii00",
    mavlink.MAV_CMD_DO_REPEAT_SERVO: "iiif",
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: "i000",
    mavlink.MAV_CMD_DO_SET_REVERSE: "i000",
    mavlink.MAV_CMD_DO_SET_ROI_NONE: "i000",
    mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE: "iiii",
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: "iiii",
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: "fff0",
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST: "f0i0",
    mavlink.MAV_CMD_DO_FENCE_ENABLE: "i000",
    mavlink.MAV_CMD_DO_PARACHUTE: "i000",
    mavlink.MAV_CMD_DO_INVERTED_FLIGHT: "i000",
    mavlink.MAV_CMD_DO_GRIPPER: "ii00",
    mavlink.MAV_CMD_DO_AUTOTUNE_ENABLE: "i000",
    mavlink.MAV_CMD_NAV_SET_YAW_SPEED: "ffi0",
    mavlink.MAV_CMD_DO_SET_RESUME_REPEAT_DIST: "i000",
    mavlink.MAV_CMD_DO_SPRAYER: "i000",
    mavlink.MAV_CMD_DO_SEND_SCRIPT_MESSAGE: "ifff",
    mavlink.MAV_CMD_DO_AUX_FUNCTION: "ii00",
    mavlink.MAV_CMD_DO_GUIDED_LIMITS: "ifff",
    mavlink.MAV_CMD_DO_ENGINE_CONTROL: "ibf0",
    mavlink.MAV_CMD_SET_CAMERA_ZOOM: "if00",
    mavlink.MAV_CMD_SET_CAMERA_FOCUS: "if00",
    mavlink.MAV_CMD_SET_CAMERA_SOURCE: "iii0",
    mavlink.MAV_CMD_JUMP_TAG: "i000",
    mavlink.MAV_CMD_DO_JUMP_TAG: "ii00",
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: "iiii",
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: "ifii",
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: "i000",
    mavlink.MAV_CMD_VIDEO_START_CAPTURE: "i000",
    mavlink.MAV_CMD_VIDEO_STOP_CAPTURE: "i000",
    mavlink.MAV_CMD_DO_VTOL_TRANSITION: "i000",
    mavlink.MAV_CMD_DO_WINCH: "iiff",
    mavlink.MAV_CMD_NAV_SCRIPT_TIME: "iiff",
    mavlink.MAV_CMD_NAV_ATTITUDE_TIME: "iiii",
}
"""Commands that are stored without; what some of them keep in x, y or z is left out here."""


def kept(command: int, params: tuple[float, float, float, float]) -> tuple[float, float, float, float] | None:
    """Return the parameters that are read back; None for a command that no mission takes."""
    code = WITH_PLACE.get(command) or WITHOUT_PLACE.get(command)
    if code is None:
        return None
    first, second, third, fourth = map(_kept, code, params)
    return first, second, third, fourth


def _kept(code: str, value: float) -> float:
    if code == "f":
        return value
    whole = float(int(value)) if abs(value) < 2**31 else 0.0  # NaN, too, is nothing
    return {"i": whole, "b": float(whole > 0.0), "0": 0.0}[code]
