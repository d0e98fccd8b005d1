"""What a program does with MAVSDK, and what a vehicle has to do about it. Runs as a program of its own.

usage: dialogue_mavsdk.py PORT    where the vehicle calls; exit status 0 if all was as it should be
"""

import asyncio
import math
import sys
import tempfile
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

PATIENCE_S = 15.0


async def first(stream: AsyncIterator[Any]) -> Any:
    """Return the first of a stream."""
    async for one in stream:
        return one
    raise AssertionError("the stream ended")


async def until(stream: AsyncIterator[Any], holds: Any) -> Any:
    """Return the first of a stream that is as wanted."""
    async for one in stream:
        if holds(one):
            return one
    raise AssertionError("the stream ended")


async def refused(awaited: Any) -> str:
    """Return why something was refused."""
    try:
        await awaited
    except Exception as error:
        return str(error)
    raise AssertionError("it was not refused")


async def telemetry(plugin: Any) -> None:
    """Attitude as quaternion, IMU, battery and the rest, at the rates that are asked for."""
    await plugin.set_rate_attitude_quaternion(20.0)
    await plugin.set_rate_imu(20.0)
    await plugin.set_rate_scaled_imu(20.0)
    quaternion = await first(plugin.subscribe_attitude_quaternion())
    euler = await first(plugin.subscribe_attitude_euler())
    norm = math.hypot(quaternion.w, quaternion.x, quaternion.y, quaternion.z)
    assert abs(norm - 1.0) < 1e-3
    yaw = math.degrees(2.0 * math.atan2(quaternion.z, quaternion.w))
    assert abs((yaw - euler.yaw_deg + 180.0) % 360.0 - 180.0) < 3.0
    for imu in (await first(plugin.subscribe_imu()), await first(plugin.subscribe_scaled_imu())):
        assert abs(imu.acceleration_frd.down_m_s2 + 9.8) < 0.3
        assert abs(imu.angular_velocity_frd.forward_rad_s) < 0.1
    battery = await first(plugin.subscribe_battery())
    assert abs(battery.voltage_v - 16.0) < 0.5
    await until(
        plugin.subscribe_health(), lambda health: health.is_gyrometer_calibration_ok and health.is_armable
    )
    assert await first(plugin.subscribe_flight_mode()) is not None
    assert abs((await first(plugin.subscribe_position())).relative_altitude_m) < 1.0
    assert "COMMAND_DENIED" in await refused(plugin.set_rate_altitude(20.0))
    assert "COMMAND_DENIED" in await refused(plugin.set_rate_odometry(20.0))


async def origin(action: Any, plugin: Any) -> None:
    """The EKF's origin, which a program has to give where there is no GPS."""
    await action.set_gps_global_origin(33.8103, -118.3939, 0.0)
    found = await plugin.get_gps_global_origin()
    assert abs(found.latitude_deg - 33.8103) < 1e-6
    assert abs(found.longitude_deg + 118.3939) < 1e-6


async def information(plugin: Any) -> None:
    """Which firmware it is."""
    version = await plugin.get_version()
    assert (version.flight_sw_major, version.flight_sw_minor) == (4, 7)
    await plugin.get_identification()
    await plugin.get_product()


async def parameters(plugin: Any) -> None:
    """One by one, and all of them."""
    await plugin.set_param_float("JS_GAIN_DEFAULT", 0.25)
    assert await plugin.get_param_float("JS_GAIN_DEFAULT") == 0.25
    await plugin.set_param_int("FS_PILOT_INPUT", 1)
    assert await plugin.get_param_int("FS_PILOT_INPUT") == 1
    table = await plugin.get_all_params()
    values = {one.name: one.value for one in [*table.int_params, *table.float_params]}
    assert len(values) > 1300
    assert values["FS_PILOT_INPUT"] == 1
    assert values["JS_GAIN_DEFAULT"] == 0.25


async def missions(plugin: Any, make: Any) -> None:
    """Missions, fences and rally points come back as they went, and are cleared."""
    latitude, longitude = 338103000, -1183939000
    items = [
        make(number, 3 if number else 0, 16, int(not number), 1, 0, 0, 0, 0, latitude, longitude, -number, 0)
        for number in range(4)
    ]
    await plugin.upload_mission(items)
    back = await plugin.download_mission()
    assert [(one.command, one.x, one.z) for one in back[1:]] == [
        (one.command, one.x, one.z) for one in items[1:]
    ]
    await plugin.set_current_mission_item(2)
    await until(plugin.subscribe_mission_progress(), lambda progress: progress.current == 2)
    await plugin.clear_mission()
    assert len(await plugin.download_mission()) <= 1
    fence = [
        make(
            number, 0, 5001, 0, 0, 4, 0, 0, 0, latitude + 1000 * (number % 2), longitude + 500 * number, 0, 1
        )
        for number in range(4)
    ]
    await plugin.upload_geofence(fence)
    assert [one.x for one in await plugin.download_geofence()] == [one.x for one in fence]
    await plugin.upload_rally_points([make(0, 3, 5100, 0, 0, 0, 0, 0, 0, latitude, longitude, 5, 2)])
    assert len(await plugin.download_rallypoints()) == 1


async def files(logs: Any, ftp: Any) -> None:
    """Logs and MAVLink FTP. MAVSDK lists with an opcode that ArduPilot does not know."""
    assert "NO_LOGFILES" in await refused(logs.get_entries())
    assert "PROTOCOL_ERROR" in await refused(ftp.list_directory("/"))
    with tempfile.TemporaryDirectory() as directory:
        for burst in (False, True):
            got = Path(directory) / "param.pck"
            got.unlink(missing_ok=True)
            async for _ in ftp.download("@PARAM/param.pck", directory, burst):
                pass
            assert got.stat().st_size > 10_000


async def actions(action: Any, manual: Any, plugin: Any) -> None:
    """Arm, steer, disarm. What MAVSDK does not know of a submarine it refuses by itself."""
    for _ in range(10):
        await manual.set_manual_control_input(0.0, 0.0, 0.5, 0.0)
        await asyncio.sleep(0.05)
    await action.arm()
    await until(plugin.subscribe_armed(), bool)
    await plugin.set_rate_raw_imu(5.0)
    for _ in range(20):
        await manual.set_manual_control_input(0.0, 0.0, 0.5, 0.6)
        await asyncio.sleep(0.05)
    await until(plugin.subscribe_attitude_angular_velocity_body(), lambda rate: rate.yaw_rad_s > 0.1)
    await action.disarm()
    await until(plugin.subscribe_armed(), lambda armed: not armed)
    assert "FAILED" in await refused(action.set_actuator(1, 0.5))
    await action.kill()
    await action.terminate()


async def reboot(action: Any, plugin: Any) -> None:
    """The answer comes, and it says what it says as it boots."""
    said = asyncio.ensure_future(until(plugin.subscribe_status_text(), lambda m: "ArduPilot Ready" in m.text))
    await asyncio.sleep(0)
    await action.reboot()
    await said


async def everything(port: int) -> None:
    """Hold the whole dialogue."""
    from mavsdk import ComponentType, Configuration
    from mavsdk.asyncio import Mavsdk
    from mavsdk.asyncio.plugins.action import ActionAsync
    from mavsdk.asyncio.plugins.ftp import FtpAsync
    from mavsdk.asyncio.plugins.info import InfoAsync
    from mavsdk.asyncio.plugins.log_files import LogFilesAsync
    from mavsdk.asyncio.plugins.manual_control import ManualControlAsync
    from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
    from mavsdk.asyncio.plugins.param import ParamAsync
    from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
    from mavsdk.plugins.mission_raw import MissionItem

    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    configuration.system_id = 255  # its own 245 may not steer
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = await mavsdk.first_autopilot(timeout_s=PATIENCE_S)
        assert system is not None, "no autopilot"
        plugin, action = TelemetryAsync(system), ActionAsync(system)
        for part in (
            telemetry(plugin),
            origin(action, plugin),
            information(InfoAsync(system)),
            parameters(ParamAsync(system)),
            missions(MissionRawAsync(system), MissionItem),
            files(LogFilesAsync(system), FtpAsync(system)),
            actions(action, ManualControlAsync(system), plugin),
            reboot(action, plugin),
        ):
            await asyncio.wait_for(part, PATIENCE_S)


if __name__ == "__main__":
    asyncio.run(everything(int(sys.argv[1])))
