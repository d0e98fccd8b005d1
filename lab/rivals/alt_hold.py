"""ArduSub's own depth hold, on board and without any companion: what an owner has today.

A ground station, which does not listen, arms in STABILIZE, sets ALT_HOLD (entered that way it does not dip),
moves the target by SET_POSITION_TARGET_GLOBAL_INT at 50 Hz and rests its sticks. Its link is the companion's;
the depth loop itself runs on board at the vehicle's step, with the EKF's depth and no link in between.
"""

from collections.abc import Callable, Generator, Iterable, Iterator
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.records import Z
from lab.loop.dive import Dive, by_autopilot
from lab.loop.firmware import vehicle_of
from lab.loop.lockstep import COMPANION_LINK, LinkDelay, SteppedVehicle, Wire
from lab.loop.scenarios import Scenario
from sim_bridge.firmware.mode_behaviour import ALT_HOLD, STABILIZE
from sim_bridge.sim_config import SimConfig
from sim_bridge.vehicle import Truth

TICK_S = 0.02
ARM_S = 2.6
HOLD_S = 3.2
VEHICLE = 1
TUNED = {"PSC_POSZ_P": 4.951, "PSC_VELZ_P": 8.737, "PSC_ACCZ_P": 2.982, "PSC_ACCZ_I": 0.09086}
"""Searched with the width and budget of the others on 2026-11-25 (`holdfast lab tune alt_hold`, 65e8a66)."""
FRAME = mavlink.MAV_FRAME_GLOBAL_INT
"""The frame in which ALT_HOLD takes a target."""
Z_ONLY = 0b0000_1111_1111_1011
"""The type mask: everything but the altitude is ignored."""


class AutopilotStation:
    """Bytes for each tick: heartbeats, arming, a mode that holds, resting sticks, and where to be."""

    def __init__(self, hold: int = ALT_HOLD) -> None:
        self._hold = hold
        self._mavlink = mavlink.MAVLink(None, 255, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    def step(self, tick: int, depth_m: float) -> Iterator[bytes]:
        """Give the datagrams of one tick; `depth_m` is where the vehicle has to be."""
        t_s = tick * TICK_S
        yield from self.enter(tick)
        if t_s > HOLD_S:
            yield self.pack(
                mavlink.MAVLink_set_position_target_global_int_message(
                    round(t_s * 1e3), VEHICLE, 1, FRAME, Z_ONLY, 0, 0, -depth_m, 0, 0, 0, 0, 0, 0, 0, 0
                )
            )

    def enter(self, tick: int) -> Iterator[bytes]:
        """Give heartbeats, resting sticks, arming at ARM_S, and the mode at HOLD_S."""
        if tick % 50 == 0:
            yield self.pack(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
            yield self.pack(mavlink.MAVLink_manual_control_message(VEHICLE, 0, 0, 500, 0, 0))
        if tick == round(ARM_S / TICK_S):
            yield self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, STABILIZE)
            yield self._command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0)
        if tick == round(HOLD_S / TICK_S):
            yield self._command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, self._hold)

    def _command(self, command: int, first: float, second: float) -> bytes:
        return self.pack(
            mavlink.MAVLink_command_long_message(VEHICLE, 1, command, 0, first, second, 0, 0, 0, 0, 0)
        )

    def pack(self, message: mavlink.MAVLink_message) -> bytes:
        """Return a message's bytes."""
        data: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return data


def dive(
    scenario: Scenario,
    plant: SimConfig,
    link: LinkDelay,
    parameters: dict[str, float],
    firmware: Path | None = None,
) -> Dive:
    """Dive `scenario` in ALT_HOLD with these parameters; thrust is what `plant`'s curve makes of the PWM."""
    found = list(truths(scenario, plant, link, parameters, firmware))
    reference = np.array([scenario.target(truth.t_s).eta_d for truth in found])
    return by_autopilot(found, plant, ALT_HOLD, reference)


def truths(
    scenario: Scenario,
    plant: SimConfig,
    link: LinkDelay,
    parameters: dict[str, float],
    firmware: Path | None = None,
) -> Generator[Truth, None, None]:
    """Dive `scenario` in ALT_HOLD, ours or the real `firmware`'s; give the truth after each tick."""
    config = scenario.plant(plant, scenario.seed)
    config = replace(config, parameters=config.parameters | parameters)
    station = AutopilotStation()
    with vehicle_of(config, scenario.seed, firmware, surveyed=config.sensors.positioned) as vehicle:
        yield from steered(
            vehicle,
            link,
            scenario.seed,
            scenario.duration_s,
            lambda tick: station.step(tick, scenario.target(vehicle.time_s).eta_d[Z]),
        )


def steered(
    vehicle: SteppedVehicle,
    link: LinkDelay,
    seed: int,
    duration_s: float,
    say: Callable[[int], Iterable[bytes]],
) -> Iterator[Truth]:
    """Give the truth after each tick of a vehicle to which a ground station says what `say` returns."""
    wire, jitter = Wire(), np.random.default_rng(seed)
    vehicle.open_link(COMPANION_LINK)
    for tick in range(round(duration_s / TICK_S)):
        now_s = vehicle.time_s
        for data in say(tick):
            delay_s = link.down_s + link.extra_s(now_s) + jitter.uniform(0.0, link.jitter_s)
            wire.put(now_s + delay_s, data)
        for _ in range(round(TICK_S / vehicle.step_s)):
            vehicle.step([(COMPANION_LINK, data) for _, data in wire.arrived(vehicle.time_s)])
        yield vehicle.truth()
