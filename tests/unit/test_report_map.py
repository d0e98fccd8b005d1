"""The report's map shows what is known of places, and nothing where a recording has a gap."""

import numpy as np
from matplotlib.figure import Figure

from lab.report.figures import Phase
from lab.report.log import Log, StateSpan
from lab.report.plot import draw_map

AT_S = (0.0, 1.0, 2.0, 60.0, 61.0)


def _log() -> Log:
    names = ("at_s", "x_m", "y_m", "x_desired_m", "y_desired_m")
    state = np.array([(t_s, i, i, i, i) for i, t_s in enumerate(AT_S)], [(name, float) for name in names])
    spans = [StateSpan("ACTIVE", 1.0, 61.5, "engaged")]
    return Log("kelp", "", 0, {"state": state}, spans, [], [], [])


def test_a_map_shows_trail_and_reference() -> None:
    panel = Figure().subplots()
    draw_map(panel, _log(), Phase("Holdfast", 0.0, 62.0, {}), "blue")
    estimate, reference = (line.get_ydata() for line in panel.get_lines())
    np.testing.assert_array_equal(estimate, [0.0, 1.0, np.nan, 3.0, 4.0])  # no line through the gap
    np.testing.assert_array_equal(reference, [np.nan, 1.0, np.nan, 3.0, 4.0])
