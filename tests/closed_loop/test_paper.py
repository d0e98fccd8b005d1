"""`holdfast lab paper`: the whole command once, and its law against plain Python."""

import json
import math
from dataclasses import asdict, replace
from itertools import product
from types import MappingProxyType

import pytest

from lab.commands import paper
from lab.paper.results import EXACT, LAW, checks, middle
from lab.paper.simulation import (
    COMPENSATORS,
    DISTURBANCES,
    LAWS,
    PaperCase,
    PaperFigures,
    dive,
    figures,
    table,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    assert paper(["--out", str(folder / "out"), "--json", str(folder / "paper.json")]) == 0
    return folder


@pytest.fixture(scope="module")
def results(folder):
    records = json.loads((folder / "paper.json").read_text())
    split = [({name: row.pop(name) for name in asdict(LAW)}, row) for row in records]
    return MappingProxyType({PaperCase(**case): PaperFigures(**found) for case, found in split})


def test_every_combination_is_there_once(results):
    assert list(results) == [*table(), EXACT]
    assert len(results) == 5 * 2 * 4 * 10 + 1
    assert all(math.isfinite(value) for found in results.values() for value in asdict(found).values())


def test_every_check_holds(results):
    assert [check.text for check in checks(results) if not check.held] == []


def test_the_printed_form_is_worse_in_every_water(results):
    assert LAWS == ("derived", "printed")
    for water, kind in product(DISTURBANCES, COMPENSATORS):
        derived = PaperCase(water, "derived", *kind)
        assert middle(results, "rms_mm", replace(derived, law="printed")) > middle(results, "rms_mm", derived)


def test_the_folder_has_the_four_figures(folder):
    sizes = {path.name: path.stat().st_size for path in folder.glob("out/*")}
    assert sizes.keys() == {f"figure{number}.png" for number in range(1, 5)}
    assert min(sizes.values()) > 20_000


def plain_python(k):
    """The canonical case without NumPy and without any of our code: law, or law + integrator of gain k."""
    m, h, lam, kappa = 50.0, 250.0, 3.5, 3.5
    z = w = d_hat = square = 0.0
    for tick in range(6000):
        s = 0.1 * math.pi
        turn = s * tick * 0.01
        e, e_dot = z - 0.5 * (1 - math.cos(turn)), w - 0.5 * s * math.sin(turn)
        eps = e_dot + lam * e
        d_hat -= k * eps * 0.01
        wanted = 0.5 * s * s * math.cos(turn) - lam * e_dot - kappa * eps
        tau = 0.9 * h * w * abs(w) + d_hat + 1.1 * m * wanted
        square += e * e
        for _ in range(10):

            def a(speed, tau=tau):
                return (tau - h * speed * abs(speed)) / m

            dt = 0.001
            a1 = a(w)
            a2 = a(w + dt / 2 * a1)
            a3 = a(w + dt / 2 * a2)
            a4 = a(w + dt * a3)
            z += dt * w + dt * dt / 6 * (a1 + a2 + a3)
            w += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return 1000.0 * math.sqrt(square / 6000)


@pytest.mark.parametrize(("compensator", "k"), [("none", 0.0), ("integrator", 250.0)])
def test_written_out_in_plain_python_it_is_the_same(compensator, k):
    found = figures(dive(PaperCase(compensator=compensator)))
    assert found.rms_mm == pytest.approx(plain_python(k), rel=1e-9)
