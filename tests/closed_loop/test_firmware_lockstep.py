"""Lockstep with a firmware in another process, tried with a fake one; tests/firmware has the real one."""

import os
import stat
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual import Dive

from companion.config import load_config
from companion.engine import Engine
from companion.records import GlobalOrigin, Request, Setpoint, State
from lab.loop import firmware
from lab.loop.firmware import Firmware, FirmwareError, held, parameters_of, program
from lab.loop.lockstep import LinkDelay, Lockstep
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.fault_kinds import Fault
from sim_bridge.physics.plant import GRAVITY
from sim_bridge.sim_config import load_config as load_plant

TESTS = Path(__file__).parents[1]


def plant(*overrides):
    return load_plant(DEFAULT_CONFIG, ("current.enabled=false", *overrides))


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """The path of a program; boots are short."""
    path = tmp_path / "ardusub"
    root = TESTS.parent
    path.write_text(f'#!/bin/sh\nPYTHONPATH={root} exec {sys.executable} {TESTS}/fake_ardusub.py "$@"\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(firmware, "BOOT_S", 3.0)
    monkeypatch.setattr(firmware, "LOWERING_S", 1.0)
    monkeypatch.setattr(firmware, "SETTLED_S", 0.5)
    monkeypatch.setattr(firmware, "POLL_MS", 50)
    return path


def running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def dived(fake, seconds, *overrides):
    config = load_config()
    with Firmware(fake, plant("initial.eta=[0,0,1,0,0,0.3]", *overrides), 1) as vehicle:
        setpoint = Setpoint((np.nan, np.nan, 1.0, 0.3))
        loop = Lockstep(vehicle, Engine(config, setpoint, arm=True), LinkDelay(), 1, config.loop.rate_hz)
        loop.requests = [Request.ENGAGE]
        return list(loop.run(seconds))


def test_the_engine_holds_a_vehicle_whose_firmware_is_another_process(fake):
    steps = dived(fake, 10.0)
    assert steps[-1].sample.verdict.state is State.ACTIVE
    assert steps[-1].truth.armed
    assert abs(steps[-1].truth.eta[2] - 1.0) < 0.05
    assert steps[-1].t_s == pytest.approx(10.0)


def test_a_dive_repeats_itself_even_when_frames_come_twice_or_late(fake, monkeypatch):
    dives = []
    for wrong in ("", "twice", "late"):
        monkeypatch.setenv("FAKE_ARDUSUB", wrong)
        dives.append([step.truth.eta.tolist() for step in dived(fake, 4.0)])
    assert dives[0] == dives[1] == dives[2]


@pytest.mark.parametrize("surveyed", [True, False])
def test_its_ekf_has_an_origin_where_the_dive_is_surveyed_alone(fake, surveyed):
    dive = Dive(engage=False, firmware=fake, surveyed=surveyed)
    assert isinstance(dive.vehicle, Firmware)
    with dive.vehicle:
        events: list[Any] = []
        for _ in range(200):
            dive.run(0.02)
            assert dive.engine.last is not None
            events += dive.engine.last.heard.events
    assert any(isinstance(event, GlobalOrigin) for event in events) is surveyed


def test_a_reboot_in_mid_dive_leaves_the_body_in_the_water_and_the_loop_running(fake):
    # Disarmed first: our stand-in's autopilot, unlike ArduSub, cannot be forced to reboot while armed.
    steps = dived(fake, 9.0, 'faults=[{kind="disarm", at_s=5}, {kind="reboot", at_s=5.1}]')
    assert State.ACTIVE in {step.sample.verdict.state for step in steps}
    states = {step.sample.verdict.state for step in steps if step.t_s > 6.2}
    assert State.ACTIVE not in states
    assert not steps[-1].truth.armed
    depths = np.array([step.truth.eta[2] for step in steps])
    assert np.abs(np.diff(depths)).max() < 0.05


def test_faults_reach_the_firmware_and_others_are_refused(fake):
    with Firmware(fake, plant(), 1) as vehicle:
        vehicle.inject(Fault(kind="mode", at_s=0.0, value=2.0))
        vehicle.inject(Fault(kind="thruster", at_s=0.0, thruster=3, value=0.0))
        for _ in range(200):
            vehicle.step()
        assert vehicle.truth().mode == 2
        with pytest.raises(ValueError, match="message_nan"):
            vehicle.inject(Fault(kind="message_nan", message="ATTITUDE"))


def test_the_process_is_gone_after_the_dive_whatever_ended_it(fake):
    seen: list[Any] = []

    def fails():
        with Firmware(fake, plant(), 1) as vehicle:
            seen.extend((vehicle.pid, vehicle.directory))
            assert running(vehicle.pid)
            raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        fails()
    pid, directory = seen
    assert not running(pid)
    assert not directory.exists()


def test_a_firmware_that_dies_is_reported_with_its_last_words(fake, monkeypatch):
    monkeypatch.setenv("FAKE_ARDUSUB", "dies")
    with pytest.raises(FirmwareError, match=r"(?s)ended with status 3.*something broke"):
        Firmware(fake, plant(), 1)


def test_a_firmware_without_a_heartbeat_is_given_up(fake, monkeypatch):
    monkeypatch.setenv("FAKE_ARDUSUB", "mute")
    with pytest.raises(FirmwareError, match="no heartbeat"):
        Firmware(fake, plant(), 1)


def test_a_parameter_that_the_firmware_does_not_know_is_refused(fake):
    with pytest.raises(FirmwareError, match="NO_SUCH_THING"):
        Firmware(fake, plant("parameters.NO_SUCH_THING=1"), 1)


def test_the_configurations_own_parameters_win_and_the_water_is_that_of_the_firmware():
    given = parameters_of(plant("parameters.SIM_BARO_RND=0.2", "sensors.depth_scale=1.025"))
    assert given["SIM_BARO_RND"] == 0.2
    assert given["BARO_SPEC_GRAV"] == pytest.approx(1.0, abs=1e-3), "reads 2.5 % deep in its own sea water"
    assert given["FRAME_CONFIG"] == 2
    assert given["SIM_BATT_VOLTAGE"] == 16.0


def test_a_gain_is_given_under_its_later_name_as_well():
    """Since the end of 2025 ArduSub has PSC_D_ACC_P for PSC_ACCZ_P, a tenth of it."""
    given = parameters_of(plant("parameters.PSC_ACCZ_P=2.0", "parameters.PSC_POSZ_P=4.0"))
    assert given["PSC_ACCZ_P"] == 2.0
    assert given["PSC_D_ACC_P"] == pytest.approx(0.2)
    assert given["PSC_D_POS_P"] == 4.0


def test_without_a_program_one_line_says_what_to_set(monkeypatch, tmp_path):
    monkeypatch.delenv("HOLDFAST_ARDUSUB", raising=False)
    with pytest.raises(FirmwareError, match="set HOLDFAST_ARDUSUB"):
        program(None)
    with pytest.raises(FirmwareError, match="not a program"):
        program(str(tmp_path))
    monkeypatch.setenv("HOLDFAST_ARDUSUB", sys.executable)
    assert program("") == Path(sys.executable).resolve()


def test_the_way_down_is_smooth_and_its_rates_are_its_derivatives():
    eta, dt = (1.0, 2.0, 5.0, 0.0, 0.0, 0.7), 1e-4
    assert held(eta, -3.0).state[:3] == (1.0, 2.0, 0.0)
    assert held(eta, 99.0).state[2] == pytest.approx(5.0)
    for t_s in (1.0, 3.0, 6.5):
        before, now, after = held(eta, t_s - dt), held(eta, t_s), held(eta, t_s + dt)
        assert now.state[9] == pytest.approx((after.state[2] - before.state[2]) / (2 * dt), rel=1e-5)
        assert now.acceleration[2] == pytest.approx((after.state[9] - before.state[9]) / (2 * dt), abs=1e-5)
        assert abs(now.acceleration[2]) < 0.1 * GRAVITY
