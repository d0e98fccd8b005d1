"""The whole vehicle: bytes in, one physics step, bytes out. Pure, seeded, in virtual time."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from sim_bridge.fault_kinds import Fault
from sim_bridge.faults import Faults
from sim_bridge.firmware.input_loop import INPUT_PERIOD_S, Autopilot
from sim_bridge.firmware.link import KeyStore, Link
from sim_bridge.firmware.params import Parameters
from sim_bridge.physics.body import STEP_S, Physics
from sim_bridge.physics.plant import Body, Six, State, Three, disturbance, euler
from sim_bridge.physics.rangefinder import RangeFault
from sim_bridge.physics.sensors import SURFACE_PRESSURE_HPA, Sensors
from sim_bridge.sim_config import SimConfig

SLOW_PERIOD_STEPS = 20

FITTED: dict[str, float] = {
    "BARO_PRIMARY": 1,
    "BARO1_GND_PRESS": 100.0 * SURFACE_PRESSURE_HPA,
    "BARO2_GND_PRESS": 100.0 * SURFACE_PRESSURE_HPA,
}
"""What a BlueROV2's set-up changes: the second barometer is the one in the water, and both are zeroed."""


BY_MAVLINK: dict[str, float] = {"VISO_TYPE": 1, "EK3_SRC1_POSXY": 6, "EK3_SRC1_VELXY": 6}
"""What the guide of a DVL's BlueOS extension has its owner set."""


class Truth(msgspec.Struct, frozen=True):
    """What really happens, which no companion ever sees. NED and body (Fossen), SI."""

    t_s: float
    body: Body
    state: State
    nu_dot: Six
    """Acceleration in the middle of the last step."""
    thrust_n: tuple[float, ...]
    """Thrust of each thruster along its direction."""
    tau: Six
    """Body wrench that the thrusters deliver."""
    force: Three
    flow: Six
    """What the water and what hangs on the vehicle do to it (`environment.py`)."""
    motor_pwm: tuple[int, ...]
    armed: bool
    mode: int
    load_on: bool
    voltage_v: float

    @property
    def eta(self) -> NDArray[np.float64]:
        """(6,) x, y, z, phi, theta, psi."""
        return np.array([*self.state[:3], *euler(self.state)])

    @property
    def nu(self) -> NDArray[np.float64]:
        """(6,) u, v, w, p, q, r."""
        return np.array(self.state[7:])

    @property
    def disturbance(self) -> NDArray[np.float64]:
        """(6,) force in NED (N), moment in the body frame (N·m) of all that moves it beside its thrusters.

        Waves, current, tether, load and net buoyancy: see `plant.disturbance`.
        """
        return np.array(disturbance(self.body, self.state, self.force, self.flow))


def truth_of(physics: Physics, t_s: float, pwm: Sequence[int], armed: bool, mode: int) -> Truth:
    """Tell the truth of a body whose autopilot drives its motors with `pwm`."""
    return Truth(
        t_s=t_s,
        body=physics.body,
        state=physics.state,
        nu_dot=physics.nu_dot,
        thrust_n=physics.thrust_n[: physics.thrusters],
        tau=physics.tau,
        force=physics.force,
        flow=physics.flow,
        motor_pwm=tuple(pwm),
        armed=armed,
        mode=mode,
        load_on=physics.environment.load_on,
        voltage_v=physics.voltage_v,
    )


class Vehicle:
    """An ArduSub vehicle in the water.

    The same configuration, seed and datagrams give the same bytes. `step` never raises, whatever the bytes.
    """

    step_s: float = STEP_S
    """One physics step."""

    def __init__(self, config: SimConfig, seed: int) -> None:
        """Boot at the configured place, disarmed, in MANUAL; ValueError for an unknown parameter or fault."""
        _, sensor_rng, fault_rng, phase_rng = np.random.default_rng(seed).spawn(4)
        self.time_s = 0.0
        self._config = config
        self._steps = 0
        self._boot_steps = -int(phase_rng.integers(0, round(INPUT_PERIOD_S / STEP_S)))
        self._first_armed_s: float | None = None
        self._links: dict[int, Link] = {}
        self._keys = KeyStore(config.signing_passphrase)
        self.physics = Physics(config, seed)
        """The body in the water, which somebody may push: assign its `state`."""
        self._sensors = Sensors(
            config.sensors,
            STEP_S,
            sensor_rng,
            config.seabed if config.seabed.enabled else None,
            config.steel if config.steel.enabled else None,
        )
        self._faults = Faults(config.faults, fault_rng)
        self._params = Parameters(
            FITTED
            | {
                "FRAME_CONFIG": 2 if config.thrusters.frame == "vectored_6dof" else 1,
                "BATT_CAPACITY": config.battery.capacity_ah * 1000.0,
                "RC_PROTOCOLS": 1 if config.rc_receiver else 0,
            }
            | (BY_MAVLINK if config.sensors.dvl_by_mavlink else {})
            | config.parameters
        )
        self._sensors.record(self.physics.state, self.physics.acceleration(), 0.0)
        self.autopilot = self._boot(rebooted=False)
        """The firmware; another one after a reboot."""

    def open_link(self, link: int) -> None:
        """Declare a link, so that telemetry goes there before anything was heard from it."""
        if link not in self._links:
            self._links[link] = Link()
            self._links[link].sign(self._keys, link)

    def close_link(self, link: int) -> None:
        """Forget a link whose peer is gone."""
        self._links.pop(link, None)

    def inject(self, fault: Fault) -> None:
        """Add a fault to the script while the simulation runs; `at_s` counts from its start as well."""
        self._faults.add(fault)
        self.autopilot.alter = self._faults.alter if self._faults.falsifies_messages else None

    def step(self, datagrams: Sequence[tuple[int, bytes]] = ()) -> list[tuple[int, bytes]]:
        """Advance one physics step; `datagrams` are (link, bytes). Returns (link, bytes) to send.

        A link is a small int; it exists once it has been heard or declared with `open_link`.
        """
        for fault in self._faults.advance(self.time_s):
            self._begin(fault)
        self._receive(datagrams)
        last_words: list[tuple[int, bytes]] = []
        if self.autopilot.reboot_requested:
            last_words = self.autopilot.telemetry()
            self._reboot()

        pwm = self.autopilot.update((self._steps - self._boot_steps) * STEP_S, STEP_S)
        if self.autopilot.armed and self._first_armed_s is None:
            self._first_armed_s = self.time_s
        self._move(pwm)
        self._change_slowly()

        self._steps += 1
        self.time_s = self._steps * STEP_S
        return self._faults.carry("out", [*last_words, *self.autopilot.telemetry()], self.time_s)

    def truth(self) -> Truth:
        """Tell the present truth."""
        return truth_of(
            self.physics, self.time_s, self.autopilot.motor_pwm, self.autopilot.armed, self.autopilot.mode
        )

    def _receive(self, datagrams: Sequence[tuple[int, bytes]]) -> None:
        for link, data in self._faults.carry("in", datagrams, self.time_s):
            self.open_link(link)
            self.autopilot.receive(link, data)

    def _move(self, pwm: list[int]) -> None:
        """Water and thrusters act on the plant for one step; the sensors watch."""
        physics = self.physics
        since_arming_s = -1.0 if self._first_armed_s is None else self.time_s - self._first_armed_s
        physics.step(pwm, since_arming_s)
        sea = physics.environment.sea
        self._sensors.record(physics.state, physics.acceleration(), sea.pressure_m if sea else 0.0)
        self.autopilot.state = physics.state

    def _change_slowly(self) -> None:
        """Battery and health of the thrusters, ten times a second."""
        if self._steps % SLOW_PERIOD_STEPS:
            return
        physics, autopilot, faults = self.physics, self.autopilot, self._faults
        physics.drain(faults.value("voltage", self._config.battery.voltage_v), SLOW_PERIOD_STEPS * STEP_S)
        autopilot.failsafes.leaking = faults.holds("leak") is not None
        autopilot.ekf_doubt = faults.value("ekf") if faults.holds("ekf") else None
        autopilot.aid(self._sensors.aided)
        self._supply(autopilot)
        if stick := faults.holds("stick"):
            autopilot.move_stick(stick.axis, stick.value)
        physics.health, physics.stuck = faults.health(), faults.stuck()
        autopilot.withhold_origin(faults.holds("origin_late") is not None)
        false_range_m = faults.value("range_false") if faults.holds("range_false") else None
        autopilot.range_quality = round(faults.value("range_quality"))
        self._sensors.disturb(
            math.radians(faults.value("compass")),
            dvl_out=faults.holds("dvl_out") is not None,
            ranges=RangeFault(
                math.nan if faults.holds("range_out") else false_range_m,
                faults.value("range_answers", 1.0),
                faults.value("range_scaled", 1.0),
            ),
            depth_noise_m=faults.value("depth_noise"),
            depth_lag_s=faults.value("depth_lag"),
        )

    def _supply(self, autopilot: Autopilot) -> None:
        physics = self.physics
        autopilot.voltage_v, autopilot.current_a = physics.voltage_v, physics.current_a
        autopilot.consumed_mah = physics.consumed_mah

    def _begin(self, fault: Fault) -> None:
        if fault.kind == "reboot":
            self._reboot()
        elif fault.kind == "disarm":
            self.autopilot.disarm()
        elif fault.kind == "mode":
            self.autopilot.set_mode(int(fault.value))
        elif fault.kind == "parameter":
            self._params.set(fault.parameter, fault.value)
        elif fault.kind == "depth_shifted":
            self._sensors.shift_relative(fault.value)
        elif fault.kind == "yaw_reset":
            turn_rad = math.radians(fault.value)
            self._sensors.reset_yaw(turn_rad, *self.physics.state[:2])
            self.autopilot.yaw_was_reset(turn_rad)
        elif fault.kind == "position_reset":
            self._sensors.reset_position(fault.value)

    def _boot(self, *, rebooted: bool) -> Autopilot:
        config = self._config
        autopilot = Autopilot(
            self._params,
            self._sensors,
            config.thrusters.frame,
            config.sensors.positioned,
            config.rc_receiver,
            self._links,
            self._keys,
            rebooted=rebooted,
        )
        autopilot.capacity_mah = config.battery.capacity_ah * 1000.0
        self._supply(autopilot)
        autopilot.state = self.physics.state
        autopilot.alter = self._faults.alter if self._faults.falsifies_messages else None
        return autopilot

    def _reboot(self) -> None:
        """Restart the firmware: parameters stay; origin, streams, mode and arming are lost."""
        self._boot_steps = self._steps
        self._params.set("STAT_BOOTCNT", self._params["STAT_BOOTCNT"] + 1.0)
        for link in self._links:
            self._links[link] = Link()
            self._links[link].sign(self._keys, link)
        self.autopilot = self._boot(rebooted=True)
