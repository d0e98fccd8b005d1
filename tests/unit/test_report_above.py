"""The report's map shows what is known of places, and nothing where a recording has a gap."""

import numpy as np
import pytest

from companion.telemetry.schemas import Plan
from lab.report.above import draw_above
from lab.report.log import Columns, Log

AT_S = np.array([0.0, 1.0, 2.0, 60.0, 61.0])


def _log(north_m: list[float], fence_m: float) -> Log:
    place = np.array(north_m)
    state = dict.fromkeys(("x_m", "y_m", "x_desired_m", "y_desired_m"), place)
    plan = Plan(
        t_s=0.0,
        boot_s=0.0,
        number=1,
        name="line",
        x_m=(0.0, 4.0),
        y_m=(0.0, 4.0),
        depth_m=(1.0, 1.0),
        fenced=True,
        fence_north_m=(-fence_m, fence_m),
        fence_east_m=(-fence_m, fence_m),
        fence_depth_m=(0.0, 9.0),
    )
    keys = {
        "state": Columns(AT_S, state),
        "dof/x": Columns(AT_S, {"engaged": np.array([0.0, 1.0, 1.0, 1.0, 1.0])}),
    }
    return Log("kelp", 0, 61.0, keys, [], [], [], None, {}, plans=[plan])


def test_a_dive_without_positions_has_no_map() -> None:
    assert draw_above(_log([np.nan] * 5, 5.0)) is None


@pytest.mark.parametrize(("fence_m", "fenced"), [(5.0, True), (50.0, False)])
def test_a_map_shows_trail_reference_path_and_a_fence_that_is_near(fence_m: float, fenced: bool) -> None:
    figure = draw_above(_log([0.0, 1.0, 2.0, 3.0, 4.0], fence_m))
    assert figure is not None
    (panel,) = figure.axes
    lines = {line.get_label(): line for line in panel.get_lines()}
    assert set(lines) == {"path", "reference", "estimate", "first", "last"}
    assert len(panel.patches) == fenced
    estimate, reference = lines["estimate"].get_ydata(), lines["reference"].get_ydata()
    np.testing.assert_array_equal(estimate, [0.0, 1.0, np.nan, 3.0, 4.0])  # no line through the gap
    np.testing.assert_array_equal(reference, [np.nan, 1.0, np.nan, 3.0, 4.0])
