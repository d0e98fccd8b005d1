"""Results of MAV_CMDs, severities, and the texts of ArduSub's boot."""

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
