"""`holdfast lab bench position`: what is counted, who dives, and what is refused."""

import math

import numpy as np
import pytest

from holdfast import RefusedError
from lab.loop.dive import Dive
from lab.studies.places import Courses
from lab.study import parser_of


def track(north_m, heading_rad=0.0):
    still = np.zeros((100, 4))
    truth = np.tile([north_m, 0.0, 0.0, heading_rad], (100, 1))
    force = np.tile([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0]], (50, 1))
    always = np.full(100, True)
    t_s = np.linspace(0.02, 2.0, 100)
    believed, saturated = truth[:, :2] * 0.5, np.arange(100) < 25
    return Dive(t_s, still, truth, np.full(100, 0.1), believed, force, saturated, always, ~always)


def study(*options):
    return Courses(parser_of(Courses).parse_args(options))


def test_errors_count_from_the_reference_in_the_units_they_are_named_by():
    dived = track(0.02, 2.0 * math.pi - math.radians(1.0))
    figures = dived.figures(0.0)
    assert figures["place_rms_mm"] == figures["place_peak_mm"] == pytest.approx(20.0)
    assert figures["believed_rms_mm"] == pytest.approx(10.0)
    assert figures["heading_rms_deg"] == pytest.approx(1.0)
    assert figures["tilt_deg"] == pytest.approx(math.degrees(0.1))
    assert figures["saturated_percent"] == 25.0
    assert figures["place_chatter_n"] == pytest.approx(5.0)
    assert figures["chatter_n"] == pytest.approx(1.0)
    assert dived.part(slice(25, None)).figures(0.0)["saturated_percent"] == 0.0
    assert dived.within(1.0, 9.0).t_s.min() >= 1.0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--rows", "lqg"], "no such row: lqg; there are default, ppi"),
        (["--scenarios", "calm"], "no such scenario: calm"),
        (["--rows", "ppi", "poshold"], "row poshold: our simulator has no POSHOLD and GUIDED; use the real"),
    ],
)
def test_what_cannot_dive_is_refused(options, says):
    with pytest.raises(RefusedError, match=says):
        study(*options)
    assert {case.row for case in study().cases()} == {"default", "ppi"}
