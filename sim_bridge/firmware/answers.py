"""What ArduSub answers to MAV_CMDs that move nothing here, and the texts of its boot."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
CRITICAL, WARNING, NOTICE, INFO = 2, 4, 5, 6

BANNER = ("ArduSub V4.7.0-dev (90700977)", "holdfast stand-in for ArduSub")
FRAMES = {"vectored": "VECTORED", "vectored_6dof": "VECTORED_6DOF"}

BOOT_TEXTS: tuple[tuple[float, str], ...] = (
    (0.0, "Barometer 1 calibration complete"),
    (0.0, "Barometer 2 calibration complete"),
    (0.05, "ArduPilot Ready"),
    (0.05, "AHRS: DCM active"),
    (2.1, "EKF3 IMU0 initialised"),
    (2.1, "EKF3 IMU1 initialised"),
    (2.1, "AHRS: EKF3 active"),
    (3.6, "EKF3 IMU0 tilt alignment complete"),
    (3.6, "EKF3 IMU1 tilt alignment complete"),
    (3.7, "EKF3 IMU0 MAG0 initial yaw alignment complete"),
    (3.7, "EKF3 IMU1 MAG0 initial yaw alignment complete"),
)
"""Seconds after the boot, and what is said then."""

WITHOUT_EFFECT: dict[int, int] = {
    mavlink.MAV_CMD_CONDITION_YAW: ACCEPTED,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: DENIED,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: DENIED,
    mavlink.MAV_CMD_DO_SET_HOME: FAILED,
    mavlink.MAV_CMD_DO_SET_RELAY: ACCEPTED,
    mavlink.MAV_CMD_DO_SET_SERVO: FAILED,
    mavlink.MAV_CMD_DO_REPEAT_RELAY: ACCEPTED,
    mavlink.MAV_CMD_DO_REPEAT_SERVO: FAILED,
    mavlink.MAV_CMD_DO_SET_ROI_LOCATION: ACCEPTED,
    mavlink.MAV_CMD_DO_SET_ROI_NONE: ACCEPTED,
    mavlink.MAV_CMD_DO_SET_ROI_SYSID: ACCEPTED,
    mavlink.MAV_CMD_DO_SET_ROI: ACCEPTED,
    mavlink.MAV_CMD_DO_DIGICAM_CONFIGURE: ACCEPTED,
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: ACCEPTED,
    mavlink.MAV_CMD_DO_MOUNT_CONFIGURE: ACCEPTED,
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: ACCEPTED,
    mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST: ACCEPTED,
    mavlink.MAV_CMD_DO_FENCE_ENABLE: ACCEPTED,
    mavlink.MAV_CMD_DO_GRIPPER: FAILED,
    mavlink.MAV_CMD_DO_SPRAYER: FAILED,
    mavlink.MAV_CMD_DO_AUX_FUNCTION: FAILED,
    mavlink.MAV_CMD_PREFLIGHT_STORAGE: DENIED,
    mavlink.MAV_CMD_GET_HOME_POSITION: FAILED,
    mavlink.MAV_CMD_MISSION_START: FAILED,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: ACCEPTED,
    mavlink.MAV_CMD_START_RX_PAIR: ACCEPTED,
    mavlink.MAV_CMD_SET_CAMERA_FOCUS: DENIED,
    mavlink.MAV_CMD_SET_CAMERA_SOURCE: DENIED,
    mavlink.MAV_CMD_DO_JUMP_TAG: FAILED,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: ACCEPTED,
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: ACCEPTED,
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: FAILED,
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: ACCEPTED,
    mavlink.MAV_CMD_VIDEO_START_CAPTURE: FAILED,
    mavlink.MAV_CMD_VIDEO_STOP_CAPTURE: FAILED,
    mavlink.MAV_CMD_CONTROL_HIGH_LATENCY: ACCEPTED,
    mavlink.MAV_CMD_DO_SET_SAFETY_SWITCH_STATE: ACCEPTED,
    mavlink.MAV_CMD_DO_ADSB_OUT_IDENT: FAILED,
    mavlink.MAV_CMD_CAN_FORWARD: ACCEPTED,
    mavlink.MAV_CMD_FIXED_MAG_CAL_YAW: FAILED,
    mavlink.MAV_CMD_SET_EKF_SOURCE_SET: DENIED,
    mavlink.MAV_CMD_DO_START_MAG_CAL: ACCEPTED,
    mavlink.MAV_CMD_DO_ACCEPT_MAG_CAL: FAILED,
    mavlink.MAV_CMD_DO_CANCEL_MAG_CAL: ACCEPTED,
    mavlink.MAV_CMD_ACCELCAL_VEHICLE_POS: FAILED,
    mavlink.MAV_CMD_BATTERY_RESET: ACCEPTED,
    mavlink.MAV_CMD_DEBUG_TRAP: DENIED,
    mavlink.MAV_CMD_SCRIPTING: DENIED,
}
"""Result by command, whatever the parameters."""

SAYS: dict[int, tuple[int, str]] = {
    mavlink.MAV_CMD_DO_AUX_FUNCTION: (INFO, "Invalid channel option (0)"),
    mavlink.MAV_CMD_CONTROL_HIGH_LATENCY: (NOTICE, "High Latency disabled"),
    mavlink.MAV_CMD_FIXED_MAG_CAL_YAW: (3, "Mag: no position available"),
}
"""What some of them make it say: severity and text."""
