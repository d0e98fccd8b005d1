"""A pilot's dialogue with MAVProxy, for the `vehicle` and `port` of the importing file."""

from pathlib import Path

from autopilot import Autopilot
from clients import MavProxy, mavproxy, needs_clients

MODES = {"STABILIZE": 0, "ALT_HOLD": 2, "MANUAL": 19}


@needs_clients
def test_mavproxy(vehicle: Autopilot, port: int, tmp_path: Path) -> None:
    with mavproxy(port, tmp_path) as station:
        parameters(vehicle, station, tmp_path)
        modes(vehicle, station)
        station.type(
            "log list", "Requesting log list", "No logs"
        )  # before it arms: then the firmware begins one
        arming_and_steering(vehicle, station)
        station.type("fence list", "Requesting 0 fence items")
        station.type("rally list", "Requesting 0 rally items")
        station.type("reboot", "PREFLIGHT_REBOOT_SHUTDOWN: ACCEPTED", "ArduPilot Ready")
        vehicle.until(lambda: "ArduPilot Ready" in vehicle.texts)


def parameters(vehicle: Autopilot, station: MavProxy, directory: Path) -> None:
    """All are fetched on its own; one is set, shown, saved."""
    found = station.expect(r"Detected vehicle 1:1", r"Received (\d+) parameters")
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
    """Each mode is entered; one that the vehicle does not know is refused."""
    for name, number in MODES.items():
        station.type(f"mode {name}", rf"Mode {name}", "DO_SET_MODE: ACCEPTED")
        vehicle.until(lambda number=number: vehicle.mode == number)
    station.type("mode 99", "No such mode 99", "DO_SET_MODE: FAILED")
    assert vehicle.mode == MODES["MANUAL"]


def arming_and_steering(vehicle: Autopilot, station: MavProxy) -> None:
    """Sticks move the motors they should."""
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
