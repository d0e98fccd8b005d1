"""Dives with the real ArduSub in virtual time: hold, take over, give up, come back."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from virtual import Dive, Somebody, hold

from companion.config import load_config
from companion.records import Condition, Request, State
from lab.loop.dive import dive as scenario_dive
from lab.loop.lockstep import START_S, LinkDelay
from lab.loop.scenarios import four, up_and_down
from lab.studies.courses import COURSES, sail
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant

DEPTH_M = 2.0
DIVED = (f"initial.eta=[0,0,{DEPTH_M},0,0,0.3]",)
STABILIZE, ALT_HOLD, SURFACE, MANUAL = 0, 2, 9, 19
FAILSAFE_S = 3.0


@pytest.fixture
def dived(dived):
    """Make dives at one depth; `holding` makes of these dives that hold."""
    return lambda *plant, **more: dived(*DIVED, *plant, **{"setpoint": hold(DEPTH_M)} | more)


def errors_mm(steps):
    return 1e3 * np.array([step.truth.eta[2] - DEPTH_M for step in steps])


# --- It holds ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["waves", "path", "load", "calm"])
def test_it_holds_its_depth_to_what_the_sensor_shows(ardusub, name):
    """The firmware's depth errs by 3 to 5 mm; its zero moves on arming, so the mean does not count."""
    scenario = next(one for one in four(3, vary=lambda base, seed: base) if one.name == name)
    recorded = scenario_dive(
        scenario, load_config(), load_plant(DEFAULT_CONFIG), LinkDelay(), firmware=ardusub
    )
    held = recorded.t_s > 12.0
    assert recorded.active[held].all()
    assert 1e3 * recorded.depth_error_m[held].std() < 9.0
    assert math.degrees(recorded.heading_error_rad[held].std()) < 1.0


@pytest.mark.parametrize(
    ("name", "each_way_s", "most_mm", "most_n"),
    [("calm", 0.0, 6.5, 3.0), ("waves", 0.0, 7.0, 3.0), ("path", 0.0, 8.0, 3.0), ("waves", 0.05, 9.0, 4.0)],
)
def test_it_holds_as_well_without_a_home_where_4_5_gives_the_raw_barometer(
    ardusub, name, each_way_s, most_mm, most_n
):
    scenario = next(one for one in four(11, vary=lambda base, seed: base) if one.name == name)
    plant = load_plant(DEFAULT_CONFIG, ("parameters.SIM_BARO_RND=0.02",))
    link = LinkDelay(up_s=each_way_s, down_s=each_way_s) if each_way_s else LinkDelay()
    figures = scenario_dive(scenario, load_config(), plant, link, firmware=ardusub).figures()
    assert figures["depth_sd_mm"] < most_mm
    assert figures["chatter_n"] < most_n


def test_the_firmwares_own_vehicle_is_held_though_it_answers_so_strongly(holding):
    dive = holding(base="sim-ardusub.toml")
    dive.run(20.0)
    steps = dive.run(30.0)
    assert dive.state is State.ACTIVE
    assert errors_mm(steps).std() < 10.0
    assert math.degrees(np.std([step.truth.eta[5] for step in steps])) < 1.0


def test_depth_only_leaves_the_heading_to_the_firmware(holding):
    dive = holding(
        "waves.enabled=true",
        companion=['vehicle.steering_mode="stabilize"'],
        setpoint=hold(DEPTH_M, math.nan),
    )
    steps = dive.run(20.0)
    assert {step.truth.mode for step in steps} == {STABILIZE}
    assert errors_mm(steps[250:]).std() < 10.0
    assert all(axes[3] == 0.0 for _, axes in dive.tap.frames)


@pytest.mark.parametrize(("period_s", "size_m"), [(6.0, 0.25), (3.0, 0.12)])
def test_our_simulator_tells_a_path_as_small_and_as_late(dived, period_s, size_m):
    """More than 0.5 m below where it was armed: docs/ardusub.md, "The height of the EKF"."""
    theirs = told(dived(), period_s, size_m)
    ours = told(Dive(*DIVED, setpoint=hold(DEPTH_M)), period_s, size_m)
    assert ours == pytest.approx(theirs, abs=0.012)


def told(dive, period_s, size_m):
    """Return relative_alt and VFR_HUD.climb on a path, each as a part of the truth, with its phase."""
    reader, heard, omega = mavlink.MAVLink(None), [], math.tau / period_s

    def listen(now_s, inbox):
        for arrived_ns, data in inbox:
            for message in reader.parse_buffer(data) or ():
                kind, at_s = message.get_type(), arrived_ns / 1e9 - START_S
                if kind == "GLOBAL_POSITION_INT":
                    heard.append((0, at_s, -message.relative_alt / 1e3))
                elif kind == "VFR_HUD":
                    heard.append((1, at_s, -message.climb))
        return inbox

    def wave(values):
        at_s, value = np.array([pair for pair in values if pair[0] > 16.0]).T
        phases = [np.exp(1j * n * omega * at_s) for n in (1, 2, 3)]
        like = np.array([*(part for one in phases for part in (one.real, one.imag)), at_s, at_s**0]).T
        cosine, sine, *_ = np.linalg.lstsq(like, value)[0]
        return cosine - 1j * sine

    dive.tap.spoil = listen
    steps = list(dive.loop.run(76.0, lambda t_s: up_and_down(t_s - 10.0, size_m, omega, DEPTH_M + 0.8)))
    assert steps[-1].sample.verdict.state is State.ACTIVE
    truth = wave([(step.t_s, step.truth.eta[2]) for step in steps])
    depth, sink = (wave([row[1:] for row in heard if row[0] == which]) for which in (0, 1))
    return [depth / truth, sink / (1j * omega * truth)]


# --- The pilot --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["stick", "mode"])
def test_a_stick_or_a_mode_of_somebody_else_takes_over_at_once(holding, how):
    dive = holding()
    began_s = dive.t_s
    if how == "stick":
        frame = Somebody().stick()
        dive.tap.spoil = lambda now_s, inbox: [*inbox, (round((1000.0 + now_s) * 1e9), frame)]
    else:
        dive.fault("mode", value=ALT_HOLD)
    dive.run(1.5)
    assert dive.state is State.PILOT
    assert dive.tap.last_thrust_s - began_s < (0.1 if how == "stick" else 1.1)
    assert dive.step.truth.mode == (MANUAL if how == "stick" else ALT_HOLD)
    assert dive.step.truth.armed


def test_the_pilots_stick_moves_the_depth_and_full_deflection_takes_the_axis_back(holding):
    dive = holding(pilot=True)
    dive.cockpit.push()
    dive.run(1.0)
    dive.cockpit.push(heave=0.5)
    dive.run(3.0)
    dive.cockpit.push()
    steps = dive.run(5.0)
    assert dive.state is State.ACTIVE
    assert dive.step.truth.eta[2] > DEPTH_M + 0.3
    assert errors_mm(steps[150:]).std() < 12.0
    dive.cockpit.push(yaw=1.0)
    steps = dive.run(2.0)
    assert not dive.step.sample.dofs.engaged[3]
    assert dive.state is State.ACTIVE
    assert abs(steps[-1].truth.eta[5] - steps[0].truth.eta[5]) > 0.2


def test_release_gives_the_mode_back_and_the_vehicle_is_neutral(dived):
    dive = dived(arm=True, engage=False)
    dive.run(1.0)
    dive.fault("mode", value=STABILIZE)
    dive.run(1.0)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE, 12.0).run(4.0)
    assert dive.step.truth.mode == MANUAL
    dive.ask(Request.STOP)
    dive.run(3.0)
    assert dive.step.truth.mode == STABILIZE
    assert dive.step.sample.verdict.authority == 0.0


# --- Giving up --------------------------------------------------------------------------------------------


def test_after_our_death_the_firmware_disarms_within_its_timeout(holding):
    dive = holding()
    vehicle, began_s = dive.vehicle, dive.t_s
    while vehicle.truth().armed and vehicle.time_s - began_s < 8.0:
        vehicle.step([])
    assert FAILSAFE_S - 0.5 < vehicle.time_s - began_s < FAILSAFE_S + 1.5
    assert set(vehicle.truth().motor_pwm) == {1500}


def test_after_the_farewell_the_motors_rest_at_once(holding):
    dive = holding("waves.enabled=true")
    for _ in range(5):
        for _ in range(8):
            dive.vehicle.step([(1, dive.engine.shutdown_frames())])
    for _ in range(40):
        dive.vehicle.step([])
    assert set(dive.vehicle.truth().motor_pwm) == {1500}
    assert dive.vehicle.truth().armed


def test_who_never_steered_leaves_somebody_elses_vehicle_armed(dived):
    dive = dived(engage=False)
    dive.run(2.0)
    pilot = Somebody()
    sticks = pilot.frame(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    vehicle = dive.vehicle
    vehicle.step([(1, pilot.arm())])
    assert dive.engine.shutdown_frames() == b""
    for step in range(round(8.0 / vehicle.step_s)):
        vehicle.step([(1, sticks)] if step % 40 == 0 else [])
    assert vehicle.truth().armed


def test_after_a_reboot_it_waits_to_be_asked_again(holding):
    """4.7 disarms before it reboots, and says so: no fault is left to be cleared. 4.5 is silent."""
    dive = holding()
    dive.fault("reboot")
    steps = dive.run(40.0)
    said_so = not steps[25].truth.armed
    assert not any(step.truth.armed for step in steps[150:])
    assert dive.state is (State.IDLE if said_so else State.FAULT)
    if not said_so:
        dive.ask(Request.CLEAR_FAULT)
        dive.until(State.IDLE, 1.0)
    dive.ask(Request.ENGAGE)
    dive.until(State.ACTIVE, 30.0)
    assert dive.step.truth.armed


@pytest.mark.parametrize(
    ("fault", "seconds", "state", "condition", "armed"),
    [
        ({"kind": "parameter", "parameter": "FS_PILOT_INPUT"}, 4.0, None, Condition.FAILSAFE_UNSAFE, None),
        ({"kind": "link_cut"}, 6.0, State.FAULT, None, False),
        ({"kind": "disarm"}, 5.0, State.IDLE, None, False),
        ({"kind": "voltage", "value": 12.0}, 12.0, None, Condition.BATTERY_LOW, None),
    ],
    ids=lambda value: value["kind"] if isinstance(value, dict) else "",
)
def test_what_ends_the_hold_or_warns_on_the_firmware_too(holding, fault, seconds, state, condition, armed):
    dive = holding()
    dive.fault(**fault)
    dive.run(seconds)
    assert state is None or dive.state is state
    assert condition is None or condition in dive.step.sample.verdict.conditions
    assert armed is None or dive.step.truth.armed is armed
    assert State.RAMP_DOWN in dive.states_since(0.0) or condition is not Condition.FAILSAFE_UNSAFE


def test_a_link_that_pauses_is_ridden_out(holding):
    dive = holding()
    since_s, depth_m = dive.t_s, dive.step.truth.eta[2]
    for seconds in (0.4, 0.9):
        dive.fault("link_cut", seconds)
        dive.run(8.0)
    assert dive.states_since(since_s) == [State.ACTIVE]
    assert dive.step.truth.armed
    assert abs(dive.step.truth.eta[2] - depth_m) < 0.04


def test_handing_over_goes_through_stabilize_and_does_not_dip(holding):
    dive = holding()
    began_s, depth_m = dive.t_s, dive.step.truth.eta[2]
    dive.fault("link_delayed", value=0.25)
    steps = dive.run(20.0)
    assert State.HAND_OVER in dive.states_since(began_s)
    modes = [step.truth.mode for step in steps]
    assert modes.index(STABILIZE) < modes.index(ALT_HOLD)
    entered = modes.index(ALT_HOLD)
    depths_m = np.array([step.truth.eta[2] for step in steps[entered:]])
    assert np.abs(depths_m - depths_m[0]).max() < 0.10, "entered straight from MANUAL it dips by up to 0.5 m"
    assert abs(depths_m[-1] - depth_m) < 0.40, "it floats up in the second of neutral before"
    assert dive.step.truth.armed


# --- ArduSub's own position modes ---------------------------------------------------------------------------


def test_ardusub_goes_after_the_path_in_guided_and_stays_in_poshold(ardusub):
    """It is late and drifts, but it goes where it is told: not another way round, and not away."""
    base = load_plant(DEFAULT_CONFIG)
    held, followed = (
        sail("poshold_stock", COURSES[name], base, 1, lasts_s=lasts_s, firmware=ardusub)
        for name, lasts_s in (("station", 1.0), ("lemniscate", 8.0))
    )
    assert held.held
    assert followed.held
    assert np.ptp(held.reference, axis=0).max() == 0.0
    moved = followed.reference[-1] - followed.reference[0]
    assert np.hypot(*moved[:2]) > 0.4
    assert 0.05 < followed.figures()["place_rms_mm"] / 1e3 < 0.6
    assert math.isnan(followed.figures()["believed_rms_mm"])
