"""`holdfast identify` in virtual time: it finds a drawn vehicle, stays within its bounds and ends neutral."""

import math
from types import SimpleNamespace
from typing import get_type_hints

import numpy as np
import pytest
from identification import Compared, compare, drawn, manoeuvred
from msgspec.structs import replace
from virtual import Dive, hold

from companion.config import PRESETS, VehicleFile, load_config, load_vehicle, vehicle_of
from companion.identify.fit import fit, reported, vehicle
from companion.identify.manoeuvre import EXCITATIONS, SETTLE_S, Manoeuvre
from companion.identify.model import KEYS, LAG, LEAST, MASS, MOST, QUADRATIC, START, Track
from companion.records import PSI, ZERO, Request, State, X, Y, Z
from holdfast import validation
from lab.identify.identify_command import conclude
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.sim_config import load_config as load_plant

SEED = 31
STILL = ("current.enabled=false",)


def fitted(manoeuvre, config):
    """Return the table of a manoeuvre, and what is found in it."""
    frame = config.vehicle.frame
    table = manoeuvre.streams.table("the manoeuvre", frame)
    return table, fit([Track(table, frame)], vehicle_of(config), excited=manoeuvre.moved)


@pytest.fixture(scope="module")
def identified():
    """A drawn vehicle's manoeuvre, its fit, and what is true beside it."""
    plant, config = drawn(load_plant(DEFAULT_CONFIG, STILL), SEED), load_config()
    manoeuvre, log = manoeuvred(plant, config, SEED)
    table, found = fitted(manoeuvre, config)
    compared = list(compare(plant, manoeuvre, found))
    return SimpleNamespace(
        plant=plant, config=config, manoeuvre=manoeuvre, log=log, table=table, found=found, compared=compared
    )


def test_it_takes_a_minute_and_stays_within_its_bounds(identified):
    assert identified.manoeuvre.failure == ""
    assert identified.manoeuvre.moved == [Z, PSI]
    assert identified.log[-1, 0] < 70.0
    away = np.abs(identified.log[:, 1:7] - np.array(identified.plant.initial.eta))
    assert away[:, 2].max() < EXCITATIONS[Z].limit
    assert away[:, 5].max() < EXCITATIONS[PSI].limit
    assert away[:, 3:5].max() < math.radians(15.0)


def within(one: Compared) -> float:
    """Ten percent; of what may be zero a little more than nothing.

    Of heave's damping twenty: the EKF's late barometer turns the phase of depth, which the fit does not know.
    """
    least = {"buoyancy_n": 2.0, "linear damping": 20.0 if one.axis == "heave" else 0.5}
    share = 0.2 if one.axis == "heave" and "damping" in one.quantity else 0.1
    return share * max(abs(one.true), least.get(one.quantity, 0.0))


def test_the_truth_is_found_within_ten_percent(identified):
    assert len(identified.compared) == 10
    wrong = [one for one in identified.compared if not abs(one.found - one.true) <= within(one)]
    assert not wrong


def test_the_doubt_is_honest(identified):
    """Of a dozen errors nearly all are within two standard deviations, and none is far beyond."""
    errors = [abs(one.found - one.true) / max(one.sigma, 1e-3) for one in identified.compared]
    assert max(errors) < 4.0
    assert sum(error > 2.0 for error in errors) <= 3


def test_the_file_is_loaded_as_a_vehicle(identified, tmp_path, capsys):
    path = tmp_path / "vehicle.toml"
    base = vehicle_of(identified.config)
    assert conclude([identified.table], base, path, identified.manoeuvre.moved) == 0
    text = path.read_text(encoding="utf-8")
    config, found = load_config(overrides=[f'vehicle.preset="{path}"']), identified.found
    assert config.heave.mass == pytest.approx(found.theta[MASS + Z], rel=1e-3)
    assert config.yaw.quadratic_damping == pytest.approx(found.theta[QUADRATIC + PSI], rel=1e-3)
    assert config.thrusters.lag_s == pytest.approx(identified.plant.thrusters.lag_s, rel=0.12)
    assert config.thrusters.delay_s == identified.config.thrusters.delay_s
    assert config.surge == identified.config.surge
    assert "surge: not measured, or it did not move" in text
    assert "surge and sway need a speed over ground, such as a DVL's" in text
    assert "net buoyancy" in text
    assert text.count("# sd ") == 8
    assert path.with_suffix(".png").read_bytes()[:4] == b"\x89PNG"
    assert "heave: inertia" in (out := capsys.readouterr().out)
    assert "before 28.5" in out


def test_a_mass_in_doubt_is_taken_only_where_the_base_predicts_worse(identified):
    """And what comes of one fit is written together: never the preset's lag with the fit's inertia."""
    found, base = identified.found, vehicle_of(identified.config)
    sigma = found.sigma.copy()
    sigma[MASS + PSI] = 0.2 * found.theta[MASS + PSI]
    sigma[LAG] = 1.0
    for before, taken in ((1.05 * found.unexplained[PSI], False), (2.0 * found.unexplained[PSI], True)):
        all_before = (*found.unexplained_before[:3], before)
        doubtful = type(found)(**{**vars(found), "sigma": sigma, "unexplained_before": all_before})
        file, notes = vehicle(doubtful, base)
        assert (file.yaw == load_vehicle(PRESETS / "heavy.toml").yaw) is not taken
        assert file.heave != base.heave
        assert file.thrusters.lag_s == pytest.approx(found.theta[LAG], rel=1e-3)
        assert notes["yaw.mass"].startswith("sd " if taken else "not identified; found ")
        line = next(line for line in reported(doubtful, base) if line.startswith("yaw"))
        assert "cannot be told apart well" in line
        assert ("taken all the same" if taken else "the base's numbers stay") in line


@pytest.mark.parametrize(("section", "key"), KEYS)
def test_what_no_vehicle_has_is_not_found(section, key):
    """A traceback after the manoeuvre would lose the rest."""
    kind = get_type_hints(get_type_hints(VehicleFile)[section], include_extras=True)[key]
    least, most = validation.bounds(kind) or (math.inf, -math.inf)
    number = KEYS.index((section, key))
    assert MOST[number] <= most
    assert least <= LEAST[number]


class Identifying(Dive):
    """A dive with a manoeuvre."""

    def __init__(self, *plant, **arguments):
        here = hold(math.nan, math.nan)
        super().__init__("initial.eta=[0,0,3,0,0,0]", *plant, setpoint=here, **arguments)
        self.manoeuvre = Manoeuvre()

    def go(self, seconds):
        """Go on; return the step at which the manoeuvre was done, or the last."""
        for step in self.loop.run(seconds):
            self.step = step
            asks = self.manoeuvre.step(self.engine, step.sample)
            self.loop.requests += asks.requests
            self.loop.excitation = asks.excitation
            if self.manoeuvre.done:
                break
        return self


def moving(**arguments):
    """A dive whose heave is being excited."""
    dive = Identifying(**arguments)
    if dive.tap.cockpit:
        dive.cockpit.push()
    dive.go(6.0 + SETTLE_S + 6.0)
    assert dive.manoeuvre.doing == "heave"
    return dive


ENDINGS = {
    "released": lambda dive: dive.ask(Request.STOP),
    "the pilot took an axis": lambda dive: dive.cockpit.push(heave=-1.0),
    "armed": lambda dive: dive.fault("disarm", 0.1),
}


@pytest.mark.parametrize("reason", ENDINGS)
def test_it_ends_with_neutral_and_says_why(reason):
    dive = moving(pilot=reason.startswith("the pilot"))
    assert dive.loop.excitation != ZERO
    ENDINGS[reason](dive)
    dive.go(5.0)
    assert dive.manoeuvre.done
    assert reason in dive.manoeuvre.failure
    assert not dive.manoeuvre.moved
    assert dive.loop.excitation == ZERO
    assert dive.state is not State.ACTIVE


@pytest.mark.parametrize(
    ("plant", "arm", "lasts_s", "why"),
    [
        (("load.enabled=true", "load.weight_n=140", "load.on_s=9", "load.off_s=99"), True, 40.0, ""),
        (("initial.eta=[0,0,0.9,0,0,0]",), True, 20.0, "at least 1.2 m"),
        ((), False, 12.0, "not permitted to engage: "),
    ],
)
def test_it_ends_or_does_not_begin_where_it_may_not(plant, arm, lasts_s, why, monkeypatch):
    monkeypatch.setattr("companion.identify.manoeuvre.WAIT_S", 6.0)
    dive = Identifying(*plant, arm=arm).go(lasts_s)
    assert dive.manoeuvre.done
    assert dive.manoeuvre.failure
    assert why in dive.manoeuvre.failure
    assert not dive.manoeuvre.moved
    dive.run(1.0)
    assert not why or dive.motors_rest()


def test_with_a_position_surge_sway_roll_and_pitch_are_identified_too():
    """The vehicle of the tank, whose motors start late: without their start every axis was wrong."""
    levers = "thrusters.horizontal_m=[0.156,0.111,0.04]"
    base = load_plant(DEFAULT_CONFIG.with_name("sim-tank-heavy.toml"), (*STILL, "sensors.dvl=true", levers))
    plant = replace(base, initial=replace(base.initial, eta=(0.0, 0.0, 3.0, 0.0, 0.0, 0.0)))
    config = load_config()
    manoeuvre, log = manoeuvred(plant, config, SEED)
    assert manoeuvre.moved == [Z, PSI, X, Y]
    assert log[-1, 0] < 130.0
    _, found = fitted(manoeuvre, config)
    for one in compare(plant, manoeuvre, found):
        if one.quantity == "mass" or (one.quantity.startswith("damping") and one.axis == "sway"):
            assert one.error == pytest.approx(0.0, abs=0.1), one
    hull, (gain,) = plant.hull, plant.thrusters.gain
    file, notes = vehicle(found, vehicle_of(config))
    for number, inertia in enumerate((file.levelling.roll_inertia, file.levelling.pitch_inertia)):
        true = (hull.inertia_kg_m2[number] + hull.added_mass[3 + number]) / gain
        assert inertia == pytest.approx(true, rel=0.15)
    assert file.levelling.lever_m == pytest.approx(plant.thrusters.horizontal_m[2], abs=0.003)
    assert notes["levelling.lever_m"].startswith("sd ")
    assert file.thrusters.start_s == pytest.approx(plant.thrusters.start_s, abs=0.01)
    assert found.theta[START] == pytest.approx(plant.thrusters.start_s, abs=0.01)
