"""What a pilot does in MAVProxy, and what a vehicle has to do about it."""

from pathlib import Path

from autopilot import Autopilot
from clients import MavProxy

MISSION = """\
QGC WPL 110
0	1	0	16	0	0	0	0	33.8103	-118.3939	0	1
1	0	3	16	0	0	0	0	33.8104	-118.3939	-2	1
2	0	3	16	0	0	0	0	33.8104	-118.3938	-3	1
"""
MODES = {"STABILIZE": 0, "ALT_HOLD": 2, "MANUAL": 19}


def everything(vehicle: Autopilot, station: MavProxy, directory: Path) -> None:
    """Hold the whole dialogue."""
    parameters(vehicle, station, directory)
    modes(vehicle, station)
    files(station, directory)  # before it arms: then the firmware begins a log
    arming_and_steering(vehicle, station)
    servo(vehicle, station)
    missions(station, directory)
    reboot(vehicle, station)


def parameters(vehicle: Autopilot, station: MavProxy, directory: Path) -> None:
    """All are fetched on its own; one is set, shown, saved."""
    found = station.expect(r"Detected vehicle 1:1", r"Received (\d+) parameters", r"Saved (\d+) defaults")
    assert found is not None
    station.type("param set JS_GAIN_DEFAULT 0.25")
    vehicle.until(lambda: vehicle.parameters.get("JS_GAIN_DEFAULT") == 0.25)
    station.type("param show JS_GAIN_DEFAULT", r"JS_GAIN_DEFAULT +0\.25")
    station.type("param fetch FS_PILOT_INPUT", r"FS_PILOT_INPUT += 2")
    station.type("param save all.parm", rf"Saved {found[1]} parameters to all\.parm")
    rows = dict(row.split() for row in (directory / "all.parm").read_text().splitlines())
    assert len(rows) == int(found[1]) > 1300
    assert float(rows["JS_GAIN_DEFAULT"]) == 0.25
    assert float(rows["MAV_GCS_SYSID"]) == 255


def modes(vehicle: Autopilot, station: MavProxy) -> None:
    """Each mode is entered; one that the vehicle lacks the position for, or does not know, is refused."""
    for name, number in MODES.items():
        station.type(f"mode {name}", rf"Mode {name}", "DO_SET_MODE: ACCEPTED")
        vehicle.until(lambda number=number: vehicle.mode == number)
    station.type("mode 99", "No such mode 99", "DO_SET_MODE: FAILED")
    assert vehicle.mode == MODES["MANUAL"]


def arming_and_steering(vehicle: Autopilot, station: MavProxy) -> None:
    """Sticks move the motors they should, and nobody at the sticks stops them."""
    station.type("arm throttle", "Arming motors", "ARMED")
    vehicle.until(lambda: vehicle.armed)
    station.type("rc 5 1700")
    vehicle.until(lambda: vehicle.motors[:4] == [1300, 1300, 1700, 1700])
    assert vehicle.motors[4:] == [1500] * 4
    station.type("rc 5 1500")
    station.type("rc 3 1400")
    vehicle.until(lambda: vehicle.motors == [1500] * 4 + [1600, 1600, 1600, 1600])
    station.type("disarm", "Disarming motors", "DISARMED")
    vehicle.until(lambda: vehicle.motors_rest and not vehicle.armed)
    station.type("rc all 0")


def servo(vehicle: Autopilot, station: MavProxy) -> None:
    """The free output is set; a motor's is not."""
    station.type("servo set 9 1650", "DO_SET_SERVO: ACCEPTED")
    vehicle.until(lambda: vehicle.messages["SERVO_OUTPUT_RAW"].servo9_raw == 1650)
    station.type("servo set 1 1650", "Channel 1 is already in use", "DO_SET_SERVO: FAILED")


def missions(station: MavProxy, directory: Path) -> None:
    """A mission goes there, and comes back as it went; fence and rally points are none."""
    (directory / "there.txt").write_text(MISSION)
    station.type("wp load there.txt", "Loaded 3 waypoints", "Flight plan received")
    station.type("wp list", "Requesting 3 waypoints", r"Saved 3 waypoints to (\S+)")
    station.type("wp save back.txt", "Saved 3 waypoints to back.txt")
    back = [list(map(float, row.split())) for row in (directory / "back.txt").read_text().splitlines()[1:]]
    there = [list(map(float, row.split())) for row in MISSION.splitlines()[1:]]
    assert back[1:] == there[1:]
    station.type("wp set 2", "DO_SET_MISSION_CURRENT: ACCEPTED")
    station.type("wp clear")
    station.type("wp list", "Requesting [01] waypoints")
    station.type("fence list", "Requesting 0 fence items")
    station.type("rally list", "Requesting 0 rally items")


def files(station: MavProxy, directory: Path) -> None:
    """Logs and MAVLink FTP."""
    station.type("log list", "Requesting log list", "No logs")
    station.type("ftp list /", "Listing /", "Total size")
    station.type("ftp crc @MISSION/fence.dat", r"crc: .*0x[0-9a-f]+")
    station.type("ftp get @PARAM/param.pck got.pck", r"Wrote \d+ bytes to got.pck", "ArduSub V4.7")
    assert (directory / "got.pck").stat().st_size > 10_000
    station.type("ftp get @MISSION/fence.dat fence.dat", "Wrote 10 bytes to fence.dat")
    station.type("ftp get /none.txt", "ftp open failed")


def reboot(vehicle: Autopilot, station: MavProxy) -> None:
    """The answer comes, then the vehicle boots."""
    station.type("reboot", "PREFLIGHT_REBOOT_SHUTDOWN: ACCEPTED", "ArduPilot Ready")
    vehicle.until(lambda: "ArduPilot Ready" in vehicle.texts)
