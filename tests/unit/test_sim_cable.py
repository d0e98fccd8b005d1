"""The tether against statics: weights, drag of a straight cable, and no pull from slack."""

import math

import pytest
from sim_wire import vehicle

from sim_bridge.physics.cable import DENSITY, CableChain
from sim_bridge.sim_config import Cable

DT = 0.005


def still(_):
    return 0.0, 0.0


def hung(place, seconds=30.0, current=still, seabed_m=math.inf, **changes):
    cable = CableChain(Cable(enabled=True, **changes), DT, place, seabed_m)
    force = (0.0, 0.0, 0.0)
    for _ in range(round(seconds / DT)):
        force = cable.pull(place, (0.0, 0.0, 0.0), current)
    return force, cable.at_boat


@pytest.mark.parametrize("weight", [0.5, 2.0])
def test_a_slack_cable_hangs_in_a_bight_and_each_end_bears_its_part(weight):
    """Below the vehicle hang (L − h) / 2 on each side; the boat bears the length between as well."""
    at_vehicle, at_boat = hung((0.0, 0.0, 10.0), length_m=16.0, weight_n_per_m=weight)
    assert at_vehicle == pytest.approx((0, 0, 3.0 * weight), abs=1e-3)
    assert at_boat == pytest.approx((0, 0, 13.0 * weight), abs=1e-3)


def test_across_a_current_the_ends_of_a_straight_cable_bear_its_drag():
    """½ ρ d L c_n V², half at each end."""
    at_vehicle, at_boat = hung(
        (0.0, 0.0, 20.2), current=lambda _: (0.3, 0.0), length_m=20.0, weight_n_per_m=0.0, segments=12
    )
    drag = 0.5 * DENSITY * 0.0076 * 20.0 * 1.2 * 0.3**2
    assert at_vehicle[0] + at_boat[0] == pytest.approx(drag, rel=0.02)
    assert at_vehicle[0] == pytest.approx(at_boat[0], rel=0.02)


def test_its_pull_grows_with_depth_and_with_the_current():
    def pull(depth_m, speed_m_s):
        force, _ = hung((0.0, 0.0, depth_m), 60.0, lambda _: (speed_m_s, 0.0), length_m=1.2 * depth_m)
        return math.hypot(*force)

    assert pull(10, 0.2) < 0.7 * pull(20, 0.2)
    assert pull(10, 0.2) < 0.5 * pull(10, 0.4)


def test_paid_out_it_stops_the_vehicle():
    rov = vehicle("cable={enabled=true, length_m=6}", "initial.eta=[0,0,4,0,0,0]", "hull.net_buoyancy_n=-10")
    for _ in range(12000):
        rov.step()
    assert rov.truth().eta[2] == pytest.approx(6.0, abs=0.2)
    assert abs(rov.truth().nu).max() < 1e-3


def test_on_the_seabed_it_lies():
    cable = CableChain(Cable(enabled=True, length_m=20.0, weight_n_per_m=1.0), DT, (3.0, 0.0, 5.0), 5.5)
    for _ in range(4000):
        force = cable.pull((3.0, 0.0, 5.0), (0.0, 0.0, 0.0), still)
    assert 0.5 < force[2] < 4.0
    assert force[2] + cable.at_boat[2] < 10.0, "half of its weight lies on the seabed"


def test_whatever_the_vehicle_does_the_chain_stays_finite():
    cable = CableChain(Cable(enabled=True, length_m=10.0, weight_n_per_m=0.3), DT, (0.0, 0.0, 5.0))
    largest = 0.0
    for step in range(4000):
        t = step * DT
        place = (8.0 * math.sin(3.0 * t), 8.0 * math.cos(2.0 * t) - 8.0, 5.0 + 2.0 * math.sin(5.0 * t))
        speed = (24.0 * math.cos(3.0 * t), -16.0 * math.sin(2.0 * t), 10.0 * math.cos(5.0 * t))
        largest = max(largest, math.hypot(*cable.pull(place, speed, lambda _: (1.0, -1.0))))
    assert largest < 1e4
