"""ArduSub's own place: POSHOLD holds it, GUIDED follows a place that moves; on board, without a companion.

A ground station arms in STABILIZE, sets the mode and rests its sticks. In GUIDED it sends place, velocity and
heading by SET_POSITION_TARGET_LOCAL_NED at 50 Hz. POSHOLD takes no place: it holds the one where the vehicle
comes to rest. Only the real firmware has these modes; our simulator refuses them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.records import PSI, Setpoint, X, Y, Z
from lab.loop.dive import Dive, by_autopilot
from lab.loop.lockstep import LinkDelay, SteppedVehicle
from lab.rivals.alt_hold import HOLD_S, TICK_S, VEHICLE, AutopilotStation, steered
from sim_bridge.firmware.mode_behaviour import GUIDED, POSHOLD
from sim_bridge.sim_config import SimConfig
from sim_bridge.vehicle import Truth

NO_ACCELERATION = 0b111 << 6
"""The type mask: place, velocity, heading and its rate count."""


def truths(
    vehicle: SteppedVehicle,
    link: LinkDelay,
    seed: int,
    duration_s: float,
    path: Callable[[float], Setpoint] | None,
) -> Iterator[Truth]:
    """Give the truth after each tick: in POSHOLD, or in GUIDED along a `path` over time."""
    station = AutopilotStation(POSHOLD if path is None else GUIDED)

    def say(tick: int) -> Iterator[bytes]:
        yield from station.enter(tick)
        if path is not None and tick * TICK_S > HOLD_S:
            yield station.pack(_target(tick, path(tick * TICK_S)))

    yield from steered(vehicle, link, seed, duration_s, say)


def recorded(
    found: Sequence[Truth],
    plant: SimConfig,
    since_s: float,
    path: Callable[[float], Setpoint] | None = None,
) -> Dive:
    """Make a Dive of these truths.

    Its reference without a path is where it was on the mean from `since_s` on: nobody named POSHOLD's place.
    """
    dived = by_autopilot(found, plant, POSHOLD if path is None else GUIDED, np.zeros((len(found), 4)))
    if path is None:
        reference = np.tile(dived.truth[dived.t_s >= since_s].mean(0), (len(found), 1))
    else:
        reference = np.array([path(truth.t_s).eta_d for truth in found])
    return replace(dived, reference=reference)


def _target(tick: int, to: Setpoint) -> mavlink.MAVLink_message:
    place, rate = to.eta_d, to.eta_d_dot
    return mavlink.MAVLink_set_position_target_local_ned_message(
        round(tick * TICK_S * 1e3),
        VEHICLE,
        1,
        mavlink.MAV_FRAME_LOCAL_NED,
        NO_ACCELERATION,
        *(place[X], place[Y], place[Z]),
        *(rate[X], rate[Y], rate[Z]),
        *(0.0, 0.0, 0.0),
        place[PSI],
        rate[PSI],
    )
