"""`holdfast demo --dvl`: its figures from a dive whose answers are known, and a short one for all of it."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from lab.demo import demo
from lab.demo.place import PlaceDive, PlaceFigures, PlaceStory, figures
from lab.demo.place_show import perform

SHORT = PlaceStory(counts_s=5.0, path_s=6.0, end_s=7.0)


def test_figures_are_those_of_the_dive() -> None:
    """30 mm north and 40 mm east off, every other tick not at all; heading across the wrap."""
    reference = np.tile([1.0, -2.0, 3.0, math.pi - 0.01], (100, 1))
    error = np.tile([0.03, 0.04, 0.002, 0.02], (100, 1))
    error[::2, :2] = 0.0
    tilt = np.array([0.1] + 99 * [0.0])
    truth = np.add(reference, error)
    truth[:, 3] -= math.tau
    found = figures(PlaceDive(0.02 * np.ones(100), truth, reference, tilt))
    assert found.place_rms_mm == pytest.approx(50.0 / math.sqrt(2.0))
    assert found.place_peak_mm == pytest.approx(50.0)
    assert found.depth_rms_mm == pytest.approx(2.0)
    assert found.heading_rms_deg == pytest.approx(math.degrees(0.02))
    assert found.tilt_deg == pytest.approx(math.degrees(0.1))


def test_a_short_demo_leaves_table_picture_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    png, json = tmp_path / "demo-dvl.png", tmp_path / "demo-dvl.json"
    assert perform(SHORT, png, json) == 0
    printed = capsys.readouterr().out
    assert "POSHOLD" in printed
    assert "place error, RMS" in printed
    assert png.read_bytes().startswith(b"\x89PNG")
    written = msgspec.json.decode(json.read_bytes())
    for name in ("poshold", "place", "path"):
        assert 0.0 < msgspec.convert(written[name], PlaceFigures).place_rms_mm < 1000.0


def test_the_real_firmware_is_refused_with_a_dvl(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        demo.main(["--dvl", "--firmware"])
    assert ended.value.code == 2
    assert "leave --firmware out" in capsys.readouterr().err
