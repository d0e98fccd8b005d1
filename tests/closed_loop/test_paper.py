"""`holdfast paper`: the whole command once, against figures that another simulation found before it."""

import json
import math
from itertools import product
from statistics import median
from typing import Any

import numpy as np
import pytest

from lab.commands import paper
from lab.paper import third_order
from lab.paper.delay_margin import linear_ms
from lab.paper.rows import STUDY
from lab.paper.simulation import PaperCase, dive

FIELDS: dict[str, set[Any]] = {
    "disturbance": {"none", "constant", "sine", "tether", "current"},
    "law": {"derived", "printed"},
    "compensator": {"none", "integrator", "network"},
    "mass_ratio": {0.9, 1.1},
    "damping_ratio": {0.9, 1.1},
    "seed": set(range(10)),
    "wait_s": {0.0, 2.0},
}
FIGURES = ("rms_mm", "peak_mm", "orbit_mm", "peak_rate_mm_s", "thrust_rms_n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    assert paper(["--out", str(folder / "out"), "--json", str(folder / "same.json")]) == 0
    return folder


@pytest.fixture(scope="module")
def records(folder):
    return json.loads((folder / "out" / "paper.json").read_text())


def middle(records, figure, **where):
    usual = {"disturbance": "none", "law": "derived", "mass_ratio": 1.1, "damping_ratio": 0.9, "wait_s": 0.0}
    wanted = (usual | where).items()
    found = [row[figure] for row in records if all(row[key] == value for key, value in wanted)]
    assert len(found) == 10
    return median(found)


def test_every_combination_is_there_once(records):
    keys = [tuple(row[name] for name in FIELDS) for row in records]
    assert len(keys) == len(set(keys)) == 5 * 2 * 4 * 4 * 10
    for place, allowed in enumerate(FIELDS.values()):
        assert {key[place] for key in keys} == allowed
    assert all(set(row) == {*FIELDS, *FIGURES} for row in records)
    assert all(math.isfinite(row[name]) for row in records for name in FIGURES)


def test_what_the_paper_says_comes_out(records):
    law = {"compensator": "none"}
    network = {"compensator": "network"}
    late = network | {"wait_s": 2.0}

    def ratio(figure, one, other):
        return middle(records, figure, **one) / middle(records, figure, **other)

    assert middle(records, "rms_mm", **law) == pytest.approx(0.602, abs=0.01)
    assert ratio("rms_mm", network, law) <= 0.30
    assert ratio("orbit_mm", network, law) <= 0.35
    assert ratio("peak_rate_mm_s", network, law) >= 1.1
    assert ratio("peak_rate_mm_s", late, law) == pytest.approx(1.0, abs=0.01)
    assert ratio("rms_mm", {"compensator": "integrator"}, network) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(("disturbance", "kind"), [key for key in STUDY if key[0] != "tether"])
def test_the_figures_are_those_of_an_independent_simulation(records, disturbance, kind):
    """But for the tether, whose pull is drawn anew: there only the order of things is the same."""
    for figure, known in zip(
        ("rms_mm", "orbit_mm", "peak_rate_mm_s"), STUDY[(disturbance, kind)], strict=True
    ):
        if known is not None:
            found = middle(records, figure, disturbance=disturbance, compensator=kind[0], wait_s=kind[1])
            assert found == pytest.approx(known, rel=0.02)


def test_the_printed_form_is_worse_and_its_overshoot_outlasts_the_wait(records):
    printed = {"law": "printed"}
    assert middle(records, "rms_mm", compensator="none", **printed) == pytest.approx(6.75, rel=0.01)
    plain = middle(records, "peak_rate_mm_s", compensator="none", **printed)
    assert middle(records, "peak_rate_mm_s", compensator="network", wait_s=2.0, **printed) > 1.5 * plain
    for disturbance, compensator in product(FIELDS["disturbance"], ("none", "integrator", "network")):
        case = {"disturbance": disturbance, "compensator": compensator}
        assert middle(records, "rms_mm", **case, **printed) > middle(records, "rms_mm", **case)


def test_the_folder_reads_as_a_report(folder):
    page = (folder / "out" / "paper.md").read_text()
    pictures = sorted(path.name for path in (folder / "out").glob("*.png"))
    assert pictures == [f"figure{number}.png" for number in range(1, 8)]
    assert all(f"({picture})" in page for picture in pictures)
    assert "worth a nonlinear integrator" in page
    assert "Not held" not in page
    assert (folder / "same.json").read_text() == (folder / "out" / "paper.json").read_text()


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
def test_written_out_in_plain_python_it_is_the_same(records, compensator, k):
    assert middle(records, "rms_mm", compensator=compensator) == pytest.approx(plain_python(k), rel=1e-9)


def test_a_dive_alone_is_what_it_is_among_others_and_delay_undoes_it(records):
    alone = PaperCase("current", "derived", "network", 0.9, 1.1, 3, 2.0)
    soon, late = (PaperCase("none", "derived", "none", 1.1, 0.9, 0, 0.0, delay_ms) for delay_ms in (150, 230))
    figures = dive([alone, soon, late]).figures
    row = next(row for row in records if all(row[name] == getattr(alone, name) for name in FIELDS))
    for name in FIGURES:
        assert getattr(figures[0], name) == pytest.approx(row[name], rel=1e-9)
    assert figures[1].orbit_mm < 1.0
    assert figures[2].orbit_mm > 20.0


def test_the_linear_margin_is_the_one_written_in_the_theory():
    assert linear_ms(1.1, 0.0) == pytest.approx(166.5, abs=0.1)
    assert linear_ms(1.1, 250.0) == pytest.approx(157.0, abs=0.1)


def test_the_third_order_law_converges_as_the_theorem_says():
    run = third_order.converge(starts=6, seed=1)
    expected = run.eps[0] * np.exp(-third_order.KAPPA * run.t_s[:, None])
    np.testing.assert_allclose(run.eps, expected, atol=1e-9 * np.abs(run.eps[0]).max())
    assert np.abs(run.x_tilde[-1] / np.abs(run.x_tilde[0]).max(axis=0)).max() < 1e-3
    assert run.b.max() < 0.0
    assert run.b.min() < 1.5 * run.b.max()  # both negative


def test_f_and_b_are_those_of_ball_magnet_and_coil():
    """Differentiate m x'' = m g - C i²/x² in time along L i' = u - R i, numerically."""
    gap, gap_dot, current, voltage = 0.011, 0.03, 0.8, 4.0

    def acceleration(x, i):
        return third_order.GRAVITY - third_order.PULL * i**2 / (third_order.BALL_KG * x**2)

    i_dot = (voltage - third_order.COIL_OHM * current) / third_order.COIL_H
    dt = 1e-6
    after = acceleration(gap + dt * gap_dot, current + dt * i_dot)
    before = acceleration(gap - dt * gap_dot, current - dt * i_dot)
    f, b = third_order.system(np.array([gap, gap_dot, acceleration(gap, current)]))
    assert f + b * voltage == pytest.approx((after - before) / (2.0 * dt), rel=1e-6)
