"""The demo's figures and picture, from a dive whose answers are known; and a short demo from its command."""

import dataclasses
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

import holdfast
from lab.demo import demo
from lab.demo.dives import NAMES, dive_holdfast, figures, worth
from lab.demo.story import Story
from lab.loop.dive import Dive

ERROR_M, WAVE_RADPS = 0.010, 2 * math.pi
PHASES = {"waves": (10.0, 16.0), "load": (16.0, 18.0)}


@dataclasses.dataclass(frozen=True)
class Short(Story):
    """Ten seconds."""

    depth_m: float = 2.0
    wave_height_m: float = 0.1
    waves_s: float = 3.0
    path_s: float = 4.0
    load_on_s: float = 8.0
    load_off_s: float = 9.0
    end_s: float = 10.0


SHORT = Short()


@pytest.fixture
def dive() -> Dive:
    """10 mm sine of depth error, 2° of heading error across the wrap, a command that alternates by 6 N."""
    t_s = np.arange(0.0, 20.0, 0.02)
    count = len(t_s)
    zero, nothing = np.zeros(count), np.zeros(count, dtype=bool)
    asked_m, heading_rad = np.minimum(5.0, 0.5 * t_s), np.full(count, math.pi - math.radians(1.0))
    depth_m = asked_m + ERROR_M * np.sin(WAVE_RADPS * t_s)
    return Dive(
        t_s=t_s,
        reference=np.column_stack([zero, zero, asked_m, heading_rad]),
        truth=np.column_stack([zero, zero, depth_m, math.radians(2.0) + heading_rad - 2.0 * math.pi]),
        tilt=zero,
        believed=np.zeros((count, 2)),
        force=np.column_stack([zero, zero, np.where(np.arange(count) % 2, -3.0, 3.0)]),
        saturated=nothing,
        active=~nothing,
        load_on=nothing,
    )


def test_figures_are_those_of_the_dive(dive: Dive) -> None:
    result = figures(dive, PHASES)
    rms_mm = 1e3 * ERROR_M / math.sqrt(2)
    assert result.phase_rms_mm == pytest.approx({"waves": rms_mm, "load": rms_mm}, rel=0.01)
    assert result.depth_rms_mm == pytest.approx(rms_mm, rel=0.01)
    assert result.depth_peak_mm == pytest.approx(1e3 * ERROR_M, rel=0.01)
    assert result.heading_rms_deg == pytest.approx(2.0)
    assert result.thrust_rms_n == pytest.approx(3.0)
    assert result.chatter_n == pytest.approx(6.0)


def test_what_a_part_is_worth_comes_from_the_figures(dive: Dive) -> None:
    without = replace(figures(dive, PHASES), phase_rms_mm={"a": 10.0, "b": 10.0, "c": 10.0, "d": 10.0})
    with_it = replace(without, phase_rms_mm={"a": 8.0, "b": 9.6, "c": 10.4, "d": 12.0})
    assert worth("The network", without, with_it) == (
        "The network lowers the error: a -20 %; it raises it: d +20 %; it brings nothing (within 5 %): b, c."
    )
    assert worth("It", with_it, with_it) == "It brings nothing (within 5 %): a, b, c, d."


def test_a_vehicle_that_is_let_go_ends_the_demo_with_the_reason() -> None:
    storm = dataclasses.replace(SHORT, current_m_s=3.0, wave_height_m=4.0)
    with pytest.raises(ValueError, match="the controller let go of the vehicle: "):
        dive_holdfast(storm, "", None, lambda _: None)


def test_a_short_demo_leaves_table_picture_and_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "Story", Short)
    json = tmp_path / "figures" / "demo.json"
    assert holdfast.main(["demo", "--out", str(tmp_path), "--json", str(json)]) == 0
    content = msgspec.json.decode(json.read_bytes())
    for name in NAMES:
        result = content[name]
        assert 0.0 < result["depth_rms_mm"] < result["depth_peak_mm"] < 500.0
        assert list(result["phase_rms_mm"]) == ["waves", "path", "load hung on", "load dropped"]
    assert content["holdfast"]["depth_rms_mm"] < content["alt_hold"]["depth_rms_mm"]
    assert (tmp_path / "demo.png").read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out
    assert "depth, load hung on" in said
    assert all(sentence in " ".join(said.split()) for sentence in content["worth"])
