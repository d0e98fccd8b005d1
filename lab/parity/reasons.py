"""Why an answer may differ: what is known, and left as it is."""

from fnmatch import fnmatchcase

from lab.loop.firmware import parameters_of
from sim_bridge.config import SimConfig

KNOWN: tuple[tuple[str, str, str], ...] = (
    ("fields", "AHRS.omegaI?", "our gyro has no bias to be estimated"),
    ("fields", "BATTERY_STATUS.*", "our electronics draw 0.5 A, the firmware's simulated vehicle none"),
    ("fields", "SYS_STATUS.*_battery", "our electronics draw 0.5 A, the firmware's simulated vehicle none"),
    ("fields", "GIMBAL_DEVICE_ATTITUDE_STATUS.q", "the camera's estimated angle has no noise"),
    ("fields", "SCALED_PRESSURE.*", "a BlueROV2's first barometer is in the dry hull"),
    ("fields", "SCALED_PRESSURE2.press_abs", "the firmware simulates salt water of 1024 kg/m³"),
    ("fields", "SIMSTATE.lng", "rounding of the last digit"),
    ("intervals", "PARAM_REQUEST_READ", "the text for the message asked before comes late"),
    ("commands", "MAV_CMD_DO_ACCEPT_MAG_CAL", "depends on how far the calibration begun before has come"),
    ("commands", "MAV_CMD_DO_SEND_BANNER", "the board's own number"),
    ("commands", "MAV_CMD_GIMBAL_FULL_RESET", "a text that happens to fall there"),
    ("parameters", "texts with the list", "the board's own number"),
    ("parameters", "count", "the firmware hides the parameters of a GPS that is off"),
    ("parameters", "*GPS1_*", "the firmware hides the parameters of a GPS that is off"),
    ("parameters", "SCR_ENABLE: *", "only builds with scripting have it"),
    ("parameters", "NET_*", "only builds with networking have it"),
    ("parameters", "BARO?_GND_PRESS: value", "set when the barometer is zeroed"),
    ("parameters", "BARO_PRIMARY: value", "a BlueROV2's depth sensor is the second barometer"),
    ("parameters", "BATT_CAPACITY: value", "the configured battery's"),
    ("parameters", "COMPASS_OFS*", "a calibrated compass"),
    ("parameters", "SIM_PLD_*", "the place of the dive"),
    ("parameters", "STAT_*", "counts what this board has lived through"),
    ("files", "list /", "our stand-in has no directories @ROMFS and @SYS"),
    ("files", "list @SYS", "our stand-in has no directories @ROMFS and @SYS"),
    ("files", "checksum of @PARAM/param.pck", "the firmware hides the parameters of a GPS that is off"),
    *(
        ("mission_items", name, "our stand-in leaves out what this command keeps in x, y or z")
        for name in (
            "MAV_CMD_DO_DIGICAM_*",
            "MAV_CMD_DO_MOUNT_CONTROL",
            "MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW",
            "MAV_CMD_NAV_SCRIPT_TIME",
            "MAV_CMD_NAV_ATTITUDE_TIME",
        )
    ),
    *(
        ("anything", name, "an old protocol of fences and rally points, which MISSION_* replaces")
        for name in ("FENCE_*POINT", "RALLY_*POINT")
    ),
    *(
        ("anything", name, "equipment that our stand-in does not have")
        for name in ("GOPRO_HEARTBEAT", "DEVICE_OP_*", "OSD_PARAM_*")
    ),
    (
        "arming",
        "*, armed",
        "its EKF turns its yaw when it is armed near the simulated steel; ours is aligned",
    ),
    ("reboot", "first status", "the firmware's first heartbeat after this reboot came before it"),
)
"""Scenario and answer, with wildcards, and the reason."""


def reason(scenario: str, name: str, config: SimConfig) -> str:
    """Return why an answer is known to differ; empty where it is not known."""
    if scenario == "parameters" and name.removesuffix(": value") in parameters_of(config):
        return "set for the firmware's simulator at its start"
    for where, pattern, why in KNOWN:
        if where == scenario and fnmatchcase(name, pattern):
            return why
    return ""
