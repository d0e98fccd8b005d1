"""What keeps ArduSub from arming."""

from sim_bridge.firmware.params import Parameters
from sim_bridge.firmware.pilot_input import PITCH, ROLL, THROTTLE, YAW, Pilot

EARLIEST_S = 2.0
CHECK_RC = 1 | 64
"""Bits of ARMING_CHECK: everything, or the sticks."""
CHECK_THROTTLE, SKIP_ANGLES = 32, 64
"""Bits of RC_OPTIONS."""
THROTTLE_WITHIN_TRIM = 1
"""A value of THR_ARM_POS."""
RECENT_S = 1.0
"""Sticks that have been silent for longer are not looked at."""


def refusals(
    params: Parameters, pilot: Pilot, boot_s: float, pilot_seen_s: float | None, *, forced: bool
) -> list[str]:
    """Tell why the vehicle does not arm; nothing if it does.

    Force does not help against the throttle. The sticks of surge and sway are not looked at.
    """
    looks = int(params["ARMING_CHECK"]) & CHECK_RC
    options = int(params["RC_OPTIONS"])
    centred = options & CHECK_THROTTLE and params["THR_ARM_POS"] == THROTTLE_WITHIN_TRIM
    if looks and centred and pilot.off_centre(THROTTLE):
        return ["PreArm: Throttle not centered/close to trim"]
    if forced:
        return []
    if boot_s < EARLIEST_S:
        return ["Arm: System not initialised"]
    steers = pilot_seen_s is not None and boot_s - pilot_seen_s <= RECENT_S
    if not looks or options & SKIP_ANGLES or not steers:
        return []
    return [
        f"Arm: {name} (RC{channel + 1}) is not neutral"
        for name, channel in (("Roll", ROLL), ("Pitch", PITCH), ("Yaw", YAW))
        if pilot.off_centre(channel)
    ]
