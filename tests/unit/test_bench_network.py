"""The bench of learners on each axis: how a rate is chosen, what the cases change, what is told."""

from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from companion.assembly import refuse_fast_gains
from lab.bench import network
from lab.bench.network import (
    AXES,
    LEARNERS,
    OBSERVER,
    SETTLING_S,
    TRAINED_BY,
    Outcome,
    Variant,
    best,
    cases,
    count,
    path,
    vehicle,
)
from lab.bench.network_report import _judged, _rates, as_records
from lab.loop.scenarios import SETTLE_S
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig
from sim_bridge.config import load_config as load_plant

BASE = load_plant(DEFAULT_CONFIG)


def _outcome(variant: Variant, case: str, rms: float) -> Outcome:
    return Outcome(variant, case, 1, (rms,) * len(AXES), (0.1,) * len(AXES), lost=False)


def _trained(errors: dict[float, tuple[float, float, float]]) -> list[Outcome]:
    """Return dives of the observer, whose error is 10 everywhere, and of the network at each time."""
    alone = [_outcome(Variant(OBSERVER), case, 10.0) for case in TRAINED_BY]
    every = dict.fromkeys(SETTLING_S, (20.0, 20.0, 20.0)) | errors
    return alone + [
        _outcome(Variant("network", (settling_s,) * 4), case, rms)
        for settling_s, row in every.items()
        for case, rms in zip(TRAINED_BY, row, strict=True)
    ]


def test_the_best_rate_is_the_one_that_helps_most_and_costs_little_anywhere() -> None:
    errors = {4.0: (10.1, 9.0, 10.0), 2.0: (10.1, 8.0, 10.0), 1.0: (10.5, 5.0, 10.0)}
    assert best("network", _trained(errors)) == Variant("network", (2.0,) * 4)


def test_where_every_rate_costs_too_much_the_slowest_is_taken() -> None:
    assert best("network", _trained({})) == Variant("network", (max(SETTLING_S),) * 4)


@pytest.mark.parametrize("learner", LEARNERS)
def test_every_rate_of_the_grid_is_one_that_the_companion_takes(learner: str) -> None:
    for settling_s in SETTLING_S:
        refuse_fast_gains(Variant(learner, (settling_s,) * 4).config([]))


def test_learners_of_the_same_time_integrate_alike() -> None:
    """Ten units of ½ at rest: the network's rate is 0.4 of the integrator's."""
    network_config, integrator = (Variant(name, (4.0,) * 4).config([]) for name in ("network", "integrator"))
    for fast, slow in zip(integrator.axes, network_config.axes, strict=True):
        assert fast.learning_rate == pytest.approx(fast.mass * fast.kappa_per_s / 4.0, rel=0.01)
        assert slow.learning_rate == pytest.approx(0.4 * fast.learning_rate, rel=0.01)
    alone = Variant(OBSERVER).config([])
    assert [axis.compensator for axis in alone.axes] == [OBSERVER] * 4


def test_the_path_moves_as_its_derivatives_say() -> None:
    for t_s in (SETTLE_S + 1.0, SETTLE_S + 7.3):
        before, now, after = (path(t_s + dt_s) for dt_s in (-1e-3, 0.0, 1e-3))
        for x, y in (("eta_d", "eta_d_dot"), ("eta_d_dot", "eta_d_ddot")):
            slope = (np.array(getattr(after, x)) - np.array(getattr(before, x))) / 2e-3
            assert slope == pytest.approx(np.array(getattr(now, y)), abs=1e-5)
    assert path(0.0).eta_d == path(SETTLE_S).eta_d == (0.0, 0.0, 2.5, 0.0)


def test_the_cases_change_what_they_say() -> None:
    drawn = vehicle(BASE, 1)
    changed = {name: change(drawn) for name, (change, _) in cases().items()}
    six = list(network.SIX)

    def column(plant: SimConfig, key: str) -> np.ndarray:
        return np.array(getattr(plant.hull, key))[six]

    for name, factor in (("damping × 3, path", 3.0), ("damping / 3, path", 1.0 / 3.0)):
        for key in ("linear_damping", "quadratic_damping"):
            assert column(changed[name], key) == pytest.approx(factor * column(drawn, key))
    body = np.array([drawn.hull.mass_kg] * 3 + [drawn.hull.inertia_kg_m2[2]])
    heavy = body + column(changed["mass × 1.5, path"], "added_mass")
    assert heavy == pytest.approx(1.5 * (body + column(drawn, "added_mass")))
    assert sum(changed["weak thrusters, path"].thrusters.gain) == pytest.approx(7.0 * drawn.thrusters.gain[0])
    assert changed["waves"].waves.enabled
    assert vehicle(BASE, 1) == drawn != vehicle(BASE, 2)


def test_a_dive_measures_every_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(network, "MEASURED_S", 2.0)
    variant = Variant("network", (8.0,) * 4)
    outcome = network._dive(BASE, [], (variant, "path", 1))
    assert not outcome.lost
    assert all(0.0 < rms < 50.0 for rms in outcome.rms)
    assert all(0.0 < chatter < 5.0 for chatter in outcome.chatter)
    assert outcome == network._dive(BASE, [], (variant, "path", 1))


def test_the_tables_tell_each_learner_over_the_observer() -> None:
    found = {learner: Variant(learner, (8.0,) * 4) for learner in LEARNERS}
    outcomes = [_outcome(Variant(OBSERVER), case, 10.0) for case in cases()]
    outcomes += [_outcome(variant, case, 9.0) for variant in found.values() for case in cases()]
    console = Console(width=100, file=StringIO())
    with console.capture() as capture:
        console.print(_rates(found, {name: variant.config([]) for name, variant in found.items()}))
        console.print(_judged("surge", 0, outcomes, found))
    rows = [line.split() for line in capture.get().splitlines() if line.strip()]
    assert ["waves", "10", "-10.0", "%", "-10.0", "%", "-10.0", "%"] in rows
    assert any("(8)" in row for row in rows)
    assert len(as_records(outcomes)) == len(outcomes) * len(AXES)


def test_what_is_counted_is_what_is_dived() -> None:
    rates = 1 + len(LEARNERS) * len(SETTLING_S)
    assert count(2) == rates * len(TRAINED_BY) * network.TRAINING + 2 * len(cases()) * (1 + len(LEARNERS))


def test_the_study_searches_on_some_vehicles_and_judges_on_others(monkeypatch: pytest.MonkeyPatch) -> None:
    waves = {"waves": cases()["waves"]}
    short = {"LEARNERS": ("network",), "SETTLING_S": (2.0,), "TRAINED_BY": ("waves",), "TRAINING": 1}
    for name, value in (short | {"MEASURED_S": 1.0, "cases": lambda: waves}).items():
        monkeypatch.setattr(network, name, value)
    told: list[int] = []
    found, outcomes = network.study(BASE, [], 1, lambda: told.append(1))
    assert len(told) == count(1) == 4
    assert found == {"network": Variant("network", (2.0,) * 4)}
    assert [one.variant.learner for one in outcomes] == [OBSERVER, "network"]
    assert {one.seed for one in outcomes} == {network.FIRST_SEED} != {network.FIRST_TRAINING_SEED}
