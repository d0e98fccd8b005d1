"""What a script does with pymavlink's high-level calls, and what a vehicle has to do about it."""

from pathlib import Path
from typing import Any

from autopilot import Autopilot
from pymavlink import mavftp, mavparm, mavutil

PATIENCE_S = 15.0
FREE = ("STABILIZE", "ALT_HOLD", "SURFACE")


def everything(vehicle: Autopilot, port: int, directory: Path) -> None:
    """Hold the whole dialogue."""
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255, source_component=190)
    try:
        beat = link.wait_heartbeat(timeout=PATIENCE_S)
        assert (beat.type, beat.autopilot, link.target_system) == (12, 3, 1)
        modes(link)
        arming(vehicle, link)
        parameters(link)
        missions(link)
        commands(vehicle, link)
        files(link, directory)
        reboot(link)
    finally:
        link.close()


def wait(link: Any, kind: str, condition: str | None = None) -> Any:
    """Return the next message of a kind that meets a condition."""
    message = link.recv_match(condition=condition, type=kind, blocking=True, timeout=PATIENCE_S)
    assert message is not None, f"no {kind} with {condition}"
    return message


def acknowledged(link: Any, command: int) -> int:
    """Return the result of a command."""
    return int(wait(link, "COMMAND_ACK", f"COMMAND_ACK.command=={command}").result)


def modes(link: Any) -> None:
    """set_mode by name; the heartbeat tells it by name."""
    numbers = link.mode_mapping()
    for name in FREE:
        link.set_mode(name)
        assert acknowledged(link, mavutil.mavlink.MAV_CMD_DO_SET_MODE) == 0
        wait(link, "HEARTBEAT", f"HEARTBEAT.custom_mode=={numbers[name]}")
        assert link.flightmode == name
    link.set_mode_loiter()
    wait(link, "COMMAND_ACK")
    link.set_mode("MANUAL")
    wait(link, "HEARTBEAT", f"HEARTBEAT.custom_mode=={numbers['MANUAL']}")


def arming(vehicle: Autopilot, link: Any) -> None:
    """arducopter_arm works for a submarine too."""
    link.arducopter_arm()
    link.motors_armed_wait()
    assert link.motors_armed()
    vehicle.until(lambda: vehicle.armed)
    link.arducopter_disarm()
    link.motors_disarmed_wait()
    vehicle.until(lambda: not vehicle.armed)


def parameters(link: Any) -> None:
    """One, all, and a set value that comes back."""
    link.param_fetch_one("FS_PILOT_INPUT")
    assert wait(link, "PARAM_VALUE", "PARAM_VALUE.param_id=='FS_PILOT_INPUT'").param_value == 2
    link.param_fetch_all()
    names: set[str] = set()
    count = 1
    while len(names) < count:
        message = wait(link, "PARAM_VALUE")
        count = message.param_count
        names.add(message.param_id)
    assert link.param("MAV_GCS_SYSID") == 255
    assert mavparm.MAVParmDict().mavset(link, "JS_GAIN_DEFAULT", 0.25)
    assert wait_param(link, "JS_GAIN_DEFAULT") == 0.25


def wait_param(link: Any, name: str) -> float:
    """Return what a parameter is."""
    link.param_fetch_one(name)
    return float(wait(link, "PARAM_VALUE", f"PARAM_VALUE.param_id=='{name}'").param_value)


def missions(link: Any) -> None:
    """waypoint_* by hand."""
    mav = mavutil.mavlink
    link.waypoint_clear_all_send()
    assert wait(link, "MISSION_ACK").type == 0
    link.waypoint_count_send(3)
    for number in range(3):
        assert wait(link, "MISSION_REQUEST").seq == number
        place = (338103000 + number, -1183939000, -2.0)
        link.mav.mission_item_int_send(1, 1, number, 3, mav.MAV_CMD_NAV_WAYPOINT, 0, 1, 0, 0, 0, 0, *place)
    assert wait(link, "MISSION_ACK").type == 0
    link.waypoint_request_list_send()
    assert wait(link, "MISSION_COUNT").count == 3
    link.waypoint_request_send(2)
    assert abs(wait(link, "MISSION_ITEM").x - 33.8103) < 1e-4
    link.waypoint_set_current_send(2)
    wait(link, "MISSION_CURRENT", "MISSION_CURRENT.seq==2")
    link.waypoint_clear_all_send()
    assert wait(link, "MISSION_ACK").type == 0


def commands(vehicle: Autopilot, link: Any) -> None:
    """The rest of what has a call of its own."""
    mav = mavutil.mavlink
    link.set_servo(9, 1600)
    assert acknowledged(link, mav.MAV_CMD_DO_SET_SERVO) == 0
    vehicle.until(lambda: vehicle.messages["SERVO_OUTPUT_RAW"].servo9_raw == 1600)
    link.set_relay(0, True)
    assert acknowledged(link, mav.MAV_CMD_DO_SET_RELAY) == 0
    link.calibrate_pressure()
    assert acknowledged(link, mav.MAV_CMD_PREFLIGHT_CALIBRATION) == 0
    link.set_mode_rtl()
    assert acknowledged(link, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH) == mav.MAV_RESULT_UNSUPPORTED
    link.set_mode_auto()
    assert acknowledged(link, mav.MAV_CMD_MISSION_START) == mav.MAV_RESULT_FAILED
    wait(link, "ATTITUDE")
    assert abs(link.field("VFR_HUD", "alt")) < 1.0
    assert link.time_since("ATTITUDE") < 2.0


def files(link: Any, directory: Path) -> None:
    """pymavlink's own client of MAVLink FTP."""
    ftp = mavftp.MAVFTP(link, link.target_system, link.target_component)
    values, defaults = directory / "values.parm", directory / "defaults.parm"
    ftp.cmd_getparams([str(values), str(defaults)])
    assert ftp.process_ftp_reply("getparams", timeout=PATIENCE_S).error_code == 0
    table = dict(line.split(",") for line in values.read_text().split())
    assert len(table) > 1300
    assert float(table["JS_GAIN_DEFAULT"]) == 0.25
    assert float(dict(line.split(",") for line in defaults.read_text().split())["JS_GAIN_DEFAULT"]) == 0.5
    assert ftp.cmd_list(["/"]).error_code == 0
    assert ftp.cmd_crc(["@MISSION/fence.dat"]).error_code == 0


def reboot(link: Any) -> None:
    """Not while it is armed, but by force; it answers, and says that it boots."""
    number = mavutil.mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    link.arducopter_arm()
    link.motors_armed_wait()
    link.reboot_autopilot()
    assert acknowledged(link, number) == mavutil.mavlink.MAV_RESULT_FAILED
    link.reboot_autopilot(force=True)
    assert acknowledged(link, number) == 0
    wait(link, "STATUSTEXT", "STATUSTEXT.text=='ArduPilot Ready'")
