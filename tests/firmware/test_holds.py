"""What the firmware's own mixer, EKF and parameters do to a vehicle that is held."""

from pathlib import Path

import numpy as np
import pytest
from extension import DvlExtension
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Somebody, blocked, hold, rewritten

from companion.records import Condition, GlobalOrigin, Parameter, State
from companion.telemetry.operator_commands import Goto
from lab.studies.fault_dives import dive_group

CURRENT = ("current.enabled=true", "current.speed_m_s=0.4")
DVL = "sensors.dvl=true"
ONE_COMPASS = ("parameters.COMPASS_USE2=0", "parameters.COMPASS_USE3=0")


def at(z, psi=0.0):
    return f"initial.eta=[0,0,{z},0,0,{psi}]"


def eta(steps):
    """True poses, (n, 6)."""
    return np.array([step.truth.eta for step in steps])


def states(steps):
    return {step.sample.verdict.state for step in steps}


def test_it_tells_its_origin_and_boots_holds_its_depth_and_ends_with_its_process(dived):
    dive = dived(at(2.5), setpoint=hold(2.5, 0.0))
    events, process = [], Path(f"/proc/{dive.vehicle.pid}")
    for _ in range(400):
        dive.run(0.02)
        events += dive.engine.last.heard.events
    (origin,) = (e for e in events if isinstance(e, GlobalOrigin))
    assert 47.0 < origin.latitude_deg < 48.0, "it is asked for once"
    (boots,) = {e.value for e in events if isinstance(e, Parameter) and e.name == "STAT_BOOTCNT"}
    assert boots >= 1.0
    dive.run(4.0)
    error_m = eta(dive.run(18.0))[:, 2] - 2.5
    assert dive.step.truth.armed
    assert error_m.std() < 0.010
    assert abs(error_m.mean()) < 0.030, "the EKF takes its own zero on arming"
    dive.vehicle.close()
    assert not process.exists()


def test_the_same_seed_repeats_the_dive_bit_by_bit(dived):
    once, again = (dived(at(2.5), "waves.enabled=true").run(8.0) for _ in range(2))
    assert eta(once).tolist() == eta(again).tolist()


def test_a_reboot_in_mid_dive_is_survived(dived):
    steps = dived(at(2.5), 'faults=[{kind="reboot", at_s=5}]', setpoint=hold(2.5, 0.0)).run(14.0)
    assert steps[249].sample.verdict.state is State.ACTIVE
    after = [step for step in steps if step.t_s > 6.5]  # 4.5 is silent, which is ridden out for a second
    assert State.ACTIVE not in states(after)
    assert not after[-1].truth.armed
    assert np.abs(np.diff(eta(steps)[:, 2])).max() < 0.02, "the body stays where it was"


@pytest.mark.parametrize("plant", [(), ("waves.enabled=true",)], ids=["calm", "waves"])
def test_a_barometer_that_hangs_is_told_within_three_seconds(holding, plant):
    """The EKF goes on with its accelerometer: depth and climb rate stay noisy, the vehicle drifts away."""
    dive = holding(at(3), *plant, setpoint=hold(3.0, 0.0), seconds=10.0)
    dive.tap.to_vehicle.append(Somebody().parameter("SIM_BARO_FREEZE", 1.0))
    steps = dive.run(3.0)
    told = [step.sample.verdict for step in steps if step.sample.verdict.state is not State.ACTIVE]
    assert told[0].state is State.FAULT
    assert told[0].reason.startswith("no fresh depth (the pressure repeats")
    assert np.ptp(eta(steps)[:, 2]) < 0.1


def test_a_dozen_dives_in_which_something_breaks_keep_every_promise(ardusub):
    assert [row["broken"] for row in dive_group(range(12), ardusub) if row["broken"]] == []


def test_a_place_is_held_level_in_a_current_and_waves(holding):
    """A wrong sign of roll or pitch would turn it over within a second."""
    dive = holding(at(3), DVL, "waves.enabled=true", *CURRENT, setpoint=hold(3.0, 0.3, 0.0, 0.0), seconds=9.0)
    steps = dive.run(35.0)
    assert states(steps) == {State.ACTIVE}
    assert np.degrees(np.abs(eta(steps)[:, 3:5]).max()) < 12.0
    assert np.hypot(*eta(steps)[:, :2].T).max() < 0.3
    assert eta(steps)[:, 2].std() < 0.010


@pytest.mark.parametrize("asked", [(0.0, 30.0), (-30.0, 0.0), (0.0, -55.0)], ids=str)
def test_depth_and_place_are_held_at_an_angle(holding, asked):
    sea = (DVL, "waves.enabled=true", "current.enabled=true", "current.speed_m_s=0.2")
    dive = holding(at(2.5), *sea, setpoint=hold(2.5, 0.0), seconds=12.0)
    level = eta(dive.run(15.0))
    dive.engine.guide(Goto(roll_deg=asked[0], pitch_deg=asked[1]))
    dive.run(6.0)
    held = eta(dive.run(30.0))
    assert dive.state is State.ACTIVE
    np.testing.assert_allclose(np.degrees(held[:, 3:5]).mean(axis=0), asked, atol=1.5)
    assert 1e3 * held[:, 2].std() < 1.6e3 * level[:, 2].std() + 2.0
    assert np.hypot(*(held[:, :2] - level[:, :2].mean(axis=0)).T).max() < 0.25


@pytest.mark.parametrize("motor", [1, 5, 8])
def test_depth_and_heading_are_held_without_a_thruster(holding, motor):
    sea = ("waves.enabled=true", "current.enabled=true", "current.speed_m_s=0.25", "current.direction_deg=40")
    dive = holding(at(2.5), *sea, setpoint=hold(2.5, 0.0), seconds=10.0)
    dive.fault("thruster", thruster=motor)
    steps = dive.run(60.0)
    poses = eta(steps)
    assert dive.state is State.ACTIVE
    found = {step.sample.state.dead_motor for step in steps} - {0}
    assert found == ({motor} if motor > 4 else set()), "horizontal ones have nothing to do"
    depth_m = poses[:, 2] - 2.5
    assert np.sqrt(np.mean(depth_m[500:] ** 2)) < 0.03
    assert np.abs(depth_m).max() < 0.1
    assert np.degrees(np.abs(np.unwrap(poses[:, 5]))).max() < 5.0
    assert np.degrees(np.abs(poses[:, 3:5])).max() < 30.0


def test_several_reversed_motors_end_in_neutral_and_the_vehicle_rights_itself(dived):
    """STABILIZE and ALT_HOLD turn it over, as they do not know of them."""
    dive = dived(at(3), setpoint=hold(3.0, np.nan))
    for motor in (5, 6, 7):
        dive.fault("thruster", thruster=motor, value=-1.0)
    steps = dive.run(60.0)
    assert State.ACTIVE in states(steps)
    assert State.HAND_OVER not in states(steps)
    assert np.degrees(np.abs(eta(steps)[-50:, 3:5])).max() < 5.0


def test_full_thrust_that_moves_nothing_ends_control(dived):
    """The vehicle is hung up, or the port of its depth sensor is blocked."""
    dive = dived(at(3), setpoint=hold(3.0, np.nan))
    dive.run(15.0)
    dive.tap.spoil = rewritten(blocked())
    dive.tap.aim(hold(4.0, np.nan))
    steps = dive.run(8.0)
    ended = next(step for step in steps if step.sample.verdict.state is not State.ACTIVE)
    assert ended.sample.verdict.reason == Condition.THRUST_UNANSWERED.text
    assert ended.truth.eta[2] < 6.0


def test_a_vehicle_that_stays_tilted_is_kept_while_its_depth_is_held(dived):
    """Handed over, it sank by 3 m in 35 s in ALT_HOLD."""
    load = ("load.enabled=true", "load.on_s=5", "load.off_s=1e4", "load.weight_n=8")
    companion = ["supervisor.max_tilt_deg=25"]
    dive = dived(at(5), *load, "current.enabled=true", companion=companion, setpoint=hold(5.0, np.nan))
    dive.run(8.0)
    for motor in (5, 7):
        dive.fault("thruster", thruster=motor)
    steps = dive.run(32.0)
    assert states(steps) == {State.ACTIVE}
    assert np.degrees(np.abs(eta(steps)[:, 3])).max() > 25.0
    assert np.abs(eta(steps)[:, 2] - 5.0).max() < 0.2


@pytest.mark.parametrize(("orientation", "releases"), [(0, False), (4, True)])
def test_a_place_is_released_where_the_compass_points_backwards(dived, orientation, releases):
    turned = f"parameters.SIM_MAG1_ORIENT={orientation}"
    dive = dived(at(3), DVL, *ONE_COMPASS, turned, setpoint=hold(3.0, np.nan, 0.0, 0.0))
    steps = dive.run(30.0)
    reported = [bool(step.sample.verdict.warnings & Condition.HEADING_WRONG) for step in steps]
    assert any(reported) is releases
    assert any(any(step.sample.requested[:2]) for step in steps[-250:]) is not releases
    assert dive.state is State.ACTIVE
    assert dive.step.truth.eta[2] == pytest.approx(3.0, abs=0.05)
    assert np.abs(eta(steps)[:, :2]).max() < (6.0 if releases else 0.1)


@pytest.mark.parametrize("sea", [(), ("current.enabled=true", DVL)], ids=["still", "current and DVL"])
def test_a_yaw_that_is_aligned_while_diving_moves_nothing(holding, sea):
    """ "in-flight yaw alignment complete": the EKF's own correction of a yaw that was wrong at boot.

    A hundred milligauss turn the compass by 24°; they go before the vehicle has dived deep enough to align.
    """
    wrong = ("parameters.SIM_MAG1_OFS_Y=100", *ONE_COMPASS)
    dive = holding(at(1), *wrong, *sea, setpoint=hold(5.0, np.nan), seconds=2.4)
    dive.fault("parameter", parameter="SIM_MAG1_OFS_Y", value=0.0)
    held = dive.run(15.6)
    assert states(held) == {State.ACTIVE}
    texts = [text.text for step in held for text in step.sample.texts]
    assert any("in-flight yaw alignment complete" in text for text in texts)
    shifts = [step.sample.state.frame_shift for step in held]
    assert abs(np.degrees(sum(shift.turn_rad for shift in shifts if shift))) > 15.0
    assert any(Condition.YAW_RESET in step.sample.verdict.warnings for step in held)
    assert np.degrees(np.abs(eta(held)[:, 5])).max() < 2.0
    assert max(abs(step.sample.requested[3]) for step in held) < 0.3
    if sea:
        assert np.abs(eta(held)[:, :2] - eta(held)[0, :2]).max() < 0.03
    assert held[-1].truth.eta[2] == pytest.approx(5.0, abs=0.05)


PLACE_DEG_E7 = (338103130, -1183938670)


def home(altitude_m):
    place = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_DO_SET_HOME, *[0] * 6, *PLACE_DEG_E7, altitude_m)
    return Somebody().frame(mavlink.MAVLink_command_int_message(1, 1, *place))


@pytest.mark.parametrize(("after_s", "noise_m"), [(4.0, 0.02), (10.0, 0.02), (4.0, 0.2)])
def test_an_origin_and_homes_that_are_set_in_mid_dive_move_nothing(dived, after_s, noise_m):
    """relative_alt of 4.5 is the barometer before, the EKF after.

    `noise_m` is the barometer's; 4.5's simulator has the larger one.
    """
    noise = f"parameters.SIM_BARO_RND={noise_m}"
    dive = dived(at(3), noise, setpoint=hold(3.0), surveyed=False)
    dive.run(2.0 + after_s)
    assert dive.state is State.ACTIVE
    depth_m, steps, offsets_m = dive.step.truth.eta[2], [], []
    origin = Somebody().frame(mavlink.MAVLink_set_gps_global_origin_message(1, *PLACE_DEG_E7, 0))
    for said in (origin, home(0), home(-0.4), home(8), home(7.8)):
        dive.tap.to_vehicle.append(said)
        steps += dive.run(6.0)
        offsets_m.append(dive.step.sample.state.depth_offset_m)
    assert states(steps) == {State.ACTIVE}
    assert np.abs(eta(steps)[:, 2] - depth_m).max() < 0.04 + noise_m
    assert np.abs(np.diff(offsets_m)[1:]) == pytest.approx([0.4, 8.4, 0.2], abs=0.05 + 0.2 * noise_m), (
        "4.7-dev counts the height of home the other way"
    )


def test_a_dvl_extension_behind_the_relay_gives_a_position_which_is_held(dived):
    by_mavlink = (f"parameters.{name}" for name in ("VISO_TYPE=1", "EK3_SRC1_POSXY=6", "EK3_SRC1_VELXY=6"))
    sea = ("current.enabled=true", "current.speed_m_s=0.1")
    dive = dived(*by_mavlink, at(2, 0.5), *sea, setpoint=hold(2.0, 0.5), pilot=True)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.until(State.ACTIVE, 12.0)
    dive.engine.aim(hold(2.0, 0.5, 0.0, 0.0))
    extension, steps = DvlExtension(), []
    for _ in range(round(22.0 / 0.02)):
        dive.cockpit.extra += extension.says(dive.vehicle.truth(), dive.vehicle.time_s)
        steps += dive.run(0.02)
    assert all(frame in dive.cockpit.passed for frame in extension.sent)
    held = steps[-250:]
    assert held[-1].sample.dofs.engaged[:2] == (True, True)
    believed = np.array([step.sample.state.eta[:2] for step in held])
    assert np.abs(believed).max() < 0.15
    assert np.ptp(eta(held)[:, :2] - believed, axis=0).max() < 0.05, "the position moves as the vehicle does"
