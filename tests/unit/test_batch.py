"""Thousands of dives at once are the same dives as one by one, and as the full loop's."""

# Options go on as a dictionary.
# mypy: disable-error-code="arg-type"

from dataclasses import replace as changed

import numpy as np
import pytest
from msgspec.structs import replace

from companion.config import load_config
from companion.records import Setpoint
from lab.batch.compiled import cached
from lab.batch.simulate import simulate
from lab.batch.stand_in import Links
from lab.loop.dive import dive
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import SETTLE_S, ensemble, four, hold, positioned
from lab.studies import trials
from lab.studies.reality import COUNTS_S, ENDS_S
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.fault_kinds import Fault
from sim_bridge.sim_config import load_config as load_plant

pytestmark = pytest.mark.compiles

CONFIG, BASE = load_config(), load_plant(DEFAULT_CONFIG)
SEEDS = [3, 14, 15, 92]
SHORT = {"target": hold(), "duration_s": 6.0, "since_s": 3.5}


def rough(seed):
    """Give waves and a tether to a vehicle drawn by its seed."""
    plant = four(seed)[0].plant(BASE, seed)
    return replace(plant, tether=replace(plant.tether, enabled=True), current=BASE.current)


def test_a_batch_is_its_dives_one_by_one():
    up_s = np.array([0.001, 0.013, 0.04, 0.07])
    together = simulate(CONFIG, [rough(s) for s in SEEDS], seeds=SEEDS, links=Links(up_s=up_s), **SHORT)
    for i, seed in ((0, SEEDS[0]), (3, SEEDS[3])):
        alone = simulate(CONFIG, [rough(seed)], seeds=[seed], links=Links(up_s=up_s[i]), **SHORT)
        for key, values in together.items():
            assert values[i] == pytest.approx(alone[key][0], abs=1e-9, rel=1e-9, nan_ok=True), key


def test_a_compiled_dive_is_the_one_in_plain_python_to_the_last_bit(monkeypatch):
    """Place, tilt and forces of every tick, with a DVL, waves, a current, a tether, and a dead motor."""
    sea = replace(BASE.waves, enabled=True)
    dead = replace(BASE.thrusters, gain=(1.0,) * 5 + (0.0, 1.0, 1.0))
    plant = positioned(replace(rough(3), waves=sea, thrusters=dead))
    there = Setpoint((0.4, -0.3, 2.6, 0.5))
    dived, found = {"plants": [plant], "target": lambda _: there, "duration_s": 24.0, "seeds": [3]}, []

    def noting(loop):
        def dives(*arguments):
            held = loop(*arguments)
            found.append((*held, arguments[-1]))
            return held

        return dives

    for made in (cached, lambda function, keeps: function):
        monkeypatch.setattr(
            "lab.batch.simulate.cached", lambda loop, keeps, made=made: noting(made(loop, keeps=keeps))
        )
        figures = simulate(CONFIG, **dived)
    for by_numba, plain in zip(*found, strict=True):
        np.testing.assert_array_equal(by_numba, plain)
    assert figures["tilt_deg"] < 12.0, "the dead motor was not found"
    assert figures["place_rms_mm"] < 100.0, "the place was not held"


def test_every_dive_may_have_its_own_gains():
    soft = replace(CONFIG, heave=replace(CONFIG.heave, kappa_per_s=5.0, position_noise=0.002))
    plants = [rough(3), rough(3)]
    both = simulate([CONFIG, soft], plants, seeds=[3, 3], **SHORT)
    for i, config in enumerate((CONFIG, soft)):
        alone = simulate(config, plants[:1], seeds=[3], **SHORT)
        assert both["depth_rms_mm"][i] == pytest.approx(alone["depth_rms_mm"][0], rel=1e-9)
    assert both["depth_rms_mm"][0] != pytest.approx(both["depth_rms_mm"][1], rel=1e-3)


@pytest.mark.parametrize("positions", [False, True], ids=["behind a delay", "with a DVL"])
def test_a_batch_agrees_with_the_full_loop(positions):
    """Mean over four vehicles, 15 s each: depth RMS within 25 %, the rest within 15 and 20 %.

    The seas and the vehicles are the same, sensor noise and tether are other draws; the DVL does not drift.
    """
    link = LinkDelay() if positions else LinkDelay(up_s=0.04, down_s=0.04)
    drawn = (lambda base, seed: positioned(ensemble(base, seed))) if positions else ensemble
    scenarios = [
        changed(four(seed, drawn)[0 if positions else 2], duration_s=SETTLE_S + 15.0) for seed in range(4)
    ]
    full = [dive(one, CONFIG, BASE, link).figures() for one in scenarios]
    batch = simulate(
        CONFIG,
        [one.plant(BASE, one.seed) for one in scenarios],
        scenarios[0].target,
        scenarios[0].duration_s,
        range(4),
        Links(link.up_s, link.down_s, link.jitter_s),
    )
    tolerances = {"depth_rms_mm": 0.25, "thrust_rms_n": 0.15, "chatter_n": 0.15}
    for key, tolerance in (tolerances | ({"place_rms_mm": 0.2} if positions else {})).items():
        expected = np.mean([figures[key] for figures in full])
        assert batch[key].mean() == pytest.approx(expected, rel=tolerance, abs=0.3), key


def test_motors_that_start_late_are_not_taken_for_old_samples():
    """Samples were dated back by up to 0.1 s for them; places were lost, and the mean tilt was 10.2°."""
    late = [seed for seed in range(7001, 7241) if trials.rough(seed).plant.thrusters.start_s > 0.17]
    plants = [positioned(trials.rough(seed).plant) for seed in late]
    found = simulate(CONFIG, plants, trials.hold, ENDS_S, late, since_s=COUNTS_S)
    assert found["tilt_deg"].mean() < 9.5
    assert found["hidden_s"].max() <= 0.04


def test_a_place_is_held_only_where_it_is_measured():
    adrift = replace(rough(3), current=replace(BASE.current, enabled=True, speed_m_s=0.3))
    there = Setpoint((0.4, -0.3, 2.5, 0.0))
    found = simulate(CONFIG, [adrift, positioned(adrift)], lambda _: there, 20.0, [3, 3], since_s=15.0)
    assert np.isnan(found["place_rms_mm"][0])
    assert found["place_rms_mm"][1] < 40.0


def test_a_vehicle_without_thrust_is_lost_and_says_when():
    sinking = replace(BASE, hull=replace(BASE.hull, net_buoyancy_n=-100.0))
    sinking = replace(sinking, thrusters=replace(sinking.thrusters, gain=(0.0,)))
    found = simulate(CONFIG, [sinking, rough(3)], hold(), 20.0, [1, 3])
    assert 5.0 < found["lost_s"][0] < 20.0
    assert np.isnan(found["lost_s"][1])
    assert found["depth_rms_mm"][1] < 20.0


def test_what_a_batch_cannot_do_it_refuses():
    broken = replace(BASE, faults=(Fault("link_cut"),))
    with pytest.raises(ValueError, match="full loop"):
        simulate(CONFIG, [broken], seeds=[1], **SHORT)
    dry = replace(BASE, thrusters=replace(BASE.thrusters, dry_height_m=0.3))
    acoustic = replace(BASE, sensors=replace(BASE.sensors, usbl=replace(BASE.sensors.usbl, enabled=True)))
    for unlike in (dry, acoustic):
        with pytest.raises(ValueError, match="full loop"):
            simulate(CONFIG, [unlike], seeds=[1], **SHORT)
    for block in ("seabed", "cable", "steel"):
        unknown = replace(BASE, **{block: replace(getattr(BASE, block), enabled=True)})
        with pytest.raises(ValueError, match="full loop"):
            simulate(CONFIG, [unknown], seeds=[1], **SHORT)
    other = replace(CONFIG, vehicle=replace(CONFIG.vehicle, thrust_path="manual_control"))
    with pytest.raises(ValueError, match="rc_override"):
        simulate(other, [BASE], seeds=[1], **SHORT)


def test_a_dead_vertical_motor_is_allocated_around():
    """Without the watch the vehicle stays tilted by 9 to 12 degrees."""
    sound = [rough(seed) for seed in SEEDS[:2]]
    dead = [replace(p, thrusters=replace(p.thrusters, gain=(1.0,) * 5 + (0.0, 1.0, 1.0))) for p in sound]
    found = simulate(CONFIG, dead, hold(), 30.0, SEEDS[:2], since_s=20.0)
    assert (found["tilt_deg"] < 3.0).all()
    assert (found["depth_rms_mm"] < 15.0).all()
