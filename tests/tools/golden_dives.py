"""What `tests.tools.golden` records: eleven minutes of diving in which each part of the engine acts."""

from math import nan

import msgspec
import numpy as np

from companion.config import load_config
from companion.records import ZERO, Request, State
from companion.telemetry.schemas import Start
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import trajectory
from tests.tools.golden import Tick, signing
from tests.virtual import Dive, Somebody, hold

DVL = ("sensors.dvl=true", "current.enabled=true", "current.speed_m_s=0.35")
PLACE = hold(z=2.5, x=0.0, y=0.0)
BUTTONS = ("ground_station.engage_button=0", "ground_station.release_button=15")
ALT_HOLD = 2


class Recorder:
    """An engine that notes each tick; a setpoint with its rate and acceleration as 12 numbers."""

    def __init__(self, engine, setpoint):
        self._engine = engine
        config, setpoint = msgspec.to_builtins(engine.config), setpoint.eta_d
        self._given = {"start": Start(config=config, setpoint=setpoint, arm=True, version="")}
        self.ticks = []

    def __getattr__(self, name):
        return getattr(self._engine, name)

    def aim(self, setpoint):
        self._engine.aim(setpoint)
        self._given["setpoint"] = [*setpoint.eta_d, *setpoint.eta_d_dot, *setpoint.eta_d_ddot]

    def retune(self, *overrides):
        config = load_config(overrides=overrides)
        self._engine.retune(config)
        self._given["config"] = msgspec.to_builtins(config)

    def step(self, now_s, heard, loop, requests=(), ground=(), excitation=ZERO):
        out, sample = self._engine.step(now_s, heard, loop, requests, ground, excitation)
        given, self._given = self._given, {}
        asked = [request.name for request in requests]
        self.ticks.append(
            Tick(tick=loop.tick, now_s=now_s, heard=heard, ground=ground, out=out, requests=asked, **given)
        )
        return out, sample


def begin(*plant, setpoint=PLACE, **arguments):
    """Return a dive whose engine is recorded; with a position source the EKF has its origin."""
    dive = Dive("initial.eta=[0,0,2.5,0,0,0]", *plant, setpoint=setpoint, arm=True, **arguments)
    dive.tap.engine = dive.engine = Recorder(dive.engine, setpoint)
    if "sensors.dvl=true" in plant:
        dive.tap.to_vehicle.append(Somebody().origin())
    return dive


def calm():
    dive = begin(setpoint=hold(z=2.5, psi=nan))
    dive.run(12.0)
    dive.engine.aim(hold(z=1.8, psi=2.5))
    dive.run(12.0)
    return dive


def waves():
    dive = begin("waves.enabled=true", "waves.height_m=0.4", "tether.enabled=true")
    dive.run(26.0)
    return dive


def path():
    """From the slow part of the path over to its fast one, with rates and accelerations."""
    dive = begin("tether.enabled=true", "battery.resistance_ohm=0.05", setpoint=trajectory(0.0))
    list(dive.loop.run(32.0, lambda t_s: trajectory(t_s + 52.0)))
    return dive


def load():
    dive = begin("load.enabled=true", "load.weight_n=18", "load.on_s=8", "load.off_s=22", seed=3)
    dive.run(30.0)
    return dive


def dvl_and_levelling():
    """In a current and waves; told to go while it turns, then without the DVL."""
    dive = begin(*DVL, "waves.enabled=true")
    dive.run(18.0)
    dive.engine.aim(hold(z=3.0, psi=-2.0, x=2.0, y=-1.0))
    dive.run(16.0)
    dive.fault("message_stopped", 4.0, message="LOCAL_POSITION_NED")
    dive.run(8.0)
    return dive


def six_thrusters():
    dive = begin(*DVL, base="sim-bluerov2.toml", companion=("vehicle.frame=vectored",))
    dive.run(20.0)
    dive.engine.aim(hold(z=2.0, psi=1.5, x=1.0, y=1.0))
    dive.run(12.0)
    return dive


def sticks(*plant, on_loss="surface"):
    """Each axis by hand: in part, in full, back to the hold, a button for all; then no ground station."""
    dive = begin(*plant, pilot=True, companion=(*BUTTONS, f"ground_station.on_loss={on_loss}"))
    dive.tap.promises.asked_otherwise = True
    dive.cockpit.push()
    dive.run(9.0)
    pushes = ({"heave": 0.5}, {"yaw": -0.6}, {"surge": 0.4, "sway": -0.3}, {"heave": -1.0}, {"heave": 0.3})
    for push in pushes:
        dive.cockpit.push(**push)
        dive.run(2.0)
        dive.cockpit.push()
        dive.run(0.6)
    dive.ask(Request.ENGAGE)
    dive.run(3.0)
    for buttons in (1 << 15, 0, 1 << 0, 0):
        dive.cockpit.push(buttons=buttons, surge=0.2)
        dive.run(1.5)
    dive.cockpit.push(enabled_extensions=3, s=300, t=-200, yaw=1.0, heave=1.0, surge=1.0, sway=1.0)
    dive.run(3.0)
    dive.cockpit.push()
    dive.ask(Request.ENGAGE)
    dive.run(4.0)
    dive.cockpit.alive, dive.cockpit.sticks = False, None
    dive.run(9.0)
    return dive


def sticks_with_dvl():
    return sticks(*DVL, on_loss="silence")


def leak():
    """Handed over to ALT_HOLD, kept alive there, then the pilot's."""
    dive = begin(companion=("supervisor.keep_alt_hold_s=8",))
    dive.run(8.0)
    dive.fault("leak")
    dive.until(State.HAND_OVER)
    dive.run(18.0)
    return dive


def innovation():
    """A position that is reset with every sample: not believed, and handed over."""
    dive = begin(*DVL)
    dive.run(10.0)
    dive.fault("position_reset", 4.0, value=0.6, count=200)
    dive.until(State.HAND_OVER)
    dive.run(6.0)
    dive.ask(Request.STOP)
    dive.run(4.0)
    return dive


def pilot_gain():
    dive = begin(*DVL, companion=["vehicle.thrust_path=manual_control"])
    dive.run(10.0)
    for name, value in (("JS_GAIN_DEFAULT", 1.0), ("JS_THR_GAIN", 0.7), ("FS_PILOT_INPUT", 0.0)):
        dive.tap.to_vehicle.append(Somebody().parameter(name, value))
        dive.run(6.0)
    return dive


def stabilize():
    """Depth alone in STABILIZE; ALT_HOLD is given back on release."""
    dive = begin("waves.enabled=true", companion=("vehicle.steering_mode=stabilize",), engage=False)
    dive.fault("mode", value=ALT_HOLD)
    dive.run(2.5)
    dive.ask(Request.ENGAGE)
    dive.run(18.0)
    dive.ask(Request.STOP)
    dive.run(5.0)
    return dive


def signed():
    """Between two who sign, with a reboot that sets the vehicle's clock back."""
    key = ("link.signing_key_file=kelp",)
    dive = begin('signing_passphrase="kelp"', companion=key, signing=signing())
    dive.run(15.0)
    dive.fault("reboot")
    dive.run(8.0)
    return dive


def reboot():
    dive = begin(*DVL)
    dive.run(10.0)
    dive.fault("reboot")
    dive.run(9.0)
    dive.tap.to_vehicle.append(Somebody().origin())
    dive.ask(Request.CLEAR_FAULT)
    dive.run(1.0)
    dive.ask(Request.ENGAGE)
    dive.run(12.0)
    return dive


def retune():
    dive = begin(*DVL)
    for overrides in (
        ("heave.lambda_per_s=4", "heave.kappa_per_s=7", "yaw.mass=0.6", "surge.max_force=50"),
        ('heave.compensator="integrator"', "heave.learning_rate=400", "supervisor.ramp_down_s=2"),
        ('heave.compensator="integrator"', "heave.learning_rate=100", "sway.lambda_per_s=1.2"),
        ('heave.compensator="network"', "heave.learning_rate=160", "supervisor.max_depth_m=20"),
        (),
    ):
        dive.run(6.0)
        dive.engine.retune(*overrides)
        dive.run(1.0)
        dive.engine.aim(hold(z=2.5 + 0.1 * len(overrides), psi=nan, x=nan, y=0.3))
    return dive


def compensators(*four, rates=(300.0, 100.0, 60.0, 5.0)):
    """One compensator an axis, learning also in its hidden layer where it has one."""
    chosen = []
    for axis, name, rate in zip(("surge", "sway", "heave", "yaw"), four, rates, strict=True):
        learns = name not in ("none", "observer")
        chosen += [f'{axis}.compensator="{name}"', f"{axis}.learning_rate={rate * learns}"]
        chosen += [f"{axis}.hidden_learning_rate={0.5 * ('network' in name)}"]
    dive = begin(*DVL, "waves.enabled=true", companion=chosen, seed=5)
    dive.run(14.0)
    dive.engine.aim(hold(z=2.0, psi=1.0, x=0.5, y=0.5))
    dive.run(10.0)
    return dive


def compensators_1():
    return compensators("observer", "predictor", "network", "integrator")


def compensators_2():
    return compensators("integrator", "none", "observer", "predictor")


def ekf_resets():
    dive = begin(*DVL)
    dive.run(9.0)
    for kind, seconds, what in (
        ("yaw_reset", 1e9, {"value": 40.0}),
        ("position_reset", 1e9, {"value": 3.0}),
        ("yaw_reset", 2.0, {"value": 3.0, "count": 48}),
        ("position_reset", 2.0, {"value": -0.5, "count": 10}),
    ):
        dive.fault(kind, seconds, **what)
        dive.run(6.0)
    return dive


def delay():
    """80 ms more each way, a hidden 0.15 s in the depth, and at last more than it bears."""
    dive = begin("sensors.depth_delay_s=0.15", link=LinkDelay(change_s=(10.0, 0.08)))
    dive.run(25.0)
    dive.fault("link_delayed", value=0.3)
    dive.run(8.0)
    return dive


def absurd():
    """Not finite and largest values in every message, lost and doubled datagrams, bits flipped, a stall."""
    dive, rng = begin(*DVL), np.random.default_rng(1)
    dive.run(8.0)
    for kind, value in (("message_nan", 0.0), ("message_extreme", 3e38), ("message_extreme", -1e30)):
        dive.fault(kind, 0.4, value=value)
        dive.run(3.0)
    for kind in ("link_lossy", "link_duplicating"):
        dive.fault(kind, 3.0, value=0.4)
        dive.run(3.5)

    def flipped(t_s, inbox):
        spoilt = [(at, bytearray(data)) for at, data in inbox]
        for _, data in spoilt[::3]:
            data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        return [(at, bytes(data)) for at, data in spoilt]

    dive.tap.spoil = flipped
    dive.run(3.0)
    dive.tap.spoil = lambda t_s, inbox: inbox
    dive.tap.asleep_until_s = dive.t_s + 0.5
    dive.run(3.0)
    for request in (Request.CLEAR_FAULT, Request.ENGAGE):
        dive.ask(request)
        dive.run(2.0)
    return dive


def engage_again():
    dive = begin("current.enabled=true", engage=False)
    for request in (Request.ENGAGE, Request.STOP, Request.ENGAGE, Request.STOP, Request.ENGAGE):
        dive.run(1.7)
        dive.ask(request)
        dive.run(4.0)
    return dive


DIVES = (
    *(calm, waves, path, load, dvl_and_levelling, six_thrusters, sticks, sticks_with_dvl),
    *(leak, innovation, pilot_gain, stabilize, signed, reboot, retune, compensators_1, compensators_2),
    *(ekf_resets, delay, absurd, engage_again),
)


def record(dived, folder):
    """Dive and store the ticks; return the states and when each began."""
    dive = dived()
    file = folder / f"{dived.__name__}.msgpack"
    file.write_bytes(msgspec.msgpack.encode(dive.engine.ticks))
    said, was = "", None
    for t_s, state in dive.tap.history:
        if state is not was:
            said, was = f"{said} {t_s:.1f} {state.name}", state
    return f"{dived.__name__:20}{len(dive.engine.ticks):6} ticks {said}"
