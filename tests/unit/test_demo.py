"""The demo's figures and pictures, from a dive whose answers are known."""

import dataclasses
import io
import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from rich.console import Console

from companion.records import AxisCommand, ControlSample, Wrench
from companion.telemetry import samples
from lab.demo import screen as demo_screen
from lab.demo.demo import phase_of
from lab.demo.picture import COLOURS, draw
from lab.demo.screen import DemoView, Now
from lab.demo.story import Story
from lab.demo.timeline import DemoDive, DemoRecording, arrange, figures, worth
from lab.demo.virtual import dive_alt_hold, dive_holdfast
from sim_bridge.zenoh_link import TruthSample

VEHICLE = "demo"
ARMED_S, END_S = 2.0, 22.0
STEP_S = 0.02
ERROR_M, WAVE_RADPS = 0.010, 2 * math.pi
LOAD_N = 12.0
PHASES = {"waves": (10.0, 16.0), "load": (16.0, 18.0)}
SHORT = Story(
    depth_m=2.0, wave_height_m=0.1, waves_s=3.0, path_s=4.0, load_on_s=8.0, load_off_s=9.0, end_s=10.0
)

Sampler = Callable[..., ControlSample]


def _reference_m(t_s: float) -> float:
    """0.5 m/s down to 5 m, from the arming on."""
    return min(5.0, max(0.0, 0.5 * (t_s - ARMED_S)))


def _loaded(t_s: float) -> bool:
    return 16.0 <= t_s < 18.0


def _truth(t_s: float) -> TruthSample:
    """10 mm sine of depth error, 2° of heading error across the wrap, 12 N of load."""
    z_m = _reference_m(t_s) + ERROR_M * math.sin(WAVE_RADPS * t_s)
    return TruthSample(
        t_s=t_s,
        eta=(0.0, 0.0, z_m, 0.0, 0.0, -math.pi + math.radians(1.0)),
        nu=(0.0,) * 6,
        nu_dot=(0.0,) * 6,
        thrust_n=(0.0,) * 8,
        tau=(0.0, 0.0, -7.0, 0.0, 0.0, 0.0),
        disturbance=(0.0, 0.0, LOAD_N if _loaded(t_s) else 0.0, 0.0, 0.0, 0.0),
        motor_pwm=(1500,) * 8,
        armed=t_s >= ARMED_S,
        mode=19,
        load_on=_loaded(t_s),
        voltage_v=16.0,
    )


def _sample(make_sample: Sampler, t_s: float, tick: int, **state: Any) -> ControlSample:
    """The controller's word at the vehicle's time `t_s`; its own clock is another."""
    sample = make_sample(t_s=1000.0 + t_s, boot_s=t_s, ahead_s=0.1, **state)
    eta_d = (0.0, 0.0, _reference_m(t_s), math.pi - math.radians(1.0))
    d_hat = (0.0, 0.0, -LOAD_N if _loaded(t_s + 0.1) else 0.0, 0.0)
    saturated = (False, False, 10.0 <= t_s < 11.0, False)
    delivered = (0.0, 0.0, 3.0 * (-1) ** tick, 0.0)
    return replace(
        sample,
        eta_d=eta_d,
        dofs=replace(sample.dofs, d_hat=d_hat, saturated=saturated),
        command=AxisCommand(),
        delivered=Wrench(delivered),
    )


@pytest.fixture
def recording(make_sample: Sampler) -> DemoRecording:
    """A dive as it comes over Zenoh, the controller's samples half-way between the simulator's."""
    heard = DemoRecording()
    for tick in range(round(END_S / STEP_S) + 1):
        t_s = tick * STEP_S
        heard.add("sim/demo/truth", msgspec.json.encode(_truth(t_s)))
        for key, _, payload in samples.encode(_sample(make_sample, t_s + 0.5 * STEP_S, tick), VEHICLE):
            heard.add(key, payload)
    return heard


@pytest.fixture
def dive(recording: DemoRecording) -> DemoDive:
    return arrange(recording)


def test_figures_are_those_of_the_dive(dive: DemoDive) -> None:
    result = figures(dive, PHASES)
    rms_mm = 1e3 * ERROR_M / math.sqrt(2)
    assert result.phase_rms_mm == pytest.approx({"waves": rms_mm, "load": rms_mm}, rel=0.01)
    assert result.depth_rms_mm == pytest.approx(rms_mm, rel=0.01)
    assert result.depth_sd_mm == pytest.approx(result.depth_rms_mm, rel=0.01)
    assert result.depth_peak_mm == pytest.approx(1e3 * ERROR_M, rel=0.01)
    assert result.heading_rms_deg == pytest.approx(2.0)
    assert result.thrust_rms_n == pytest.approx(7.0)
    assert result.chatter_n == pytest.approx(6.0)


def test_a_phase_counts_alone(dive: DemoDive) -> None:
    worse_m = np.where((dive.t_s >= 16.0) & (dive.t_s < 18.0), 0.1, 0.0)
    result = figures(dataclasses.replace(dive, depth_m=dive.depth_desired_m + worse_m), PHASES)
    assert result.phase_rms_mm == pytest.approx({"waves": 0.0, "load": 100.0})
    assert result.depth_rms_mm == pytest.approx(100.0 * math.sqrt(0.25), rel=0.01)


def test_a_lost_tick_makes_no_chatter(recording: DemoRecording) -> None:
    steady = [replace(c, heave_delivered_n=c.boot_s) for c in recording.command]
    recording.command = steady[:700] + steady[710:]
    assert figures(arrange(recording), PHASES).chatter_n == pytest.approx(STEP_S)


def test_a_shifted_zero_is_in_the_rms_and_not_about_the_mean(dive: DemoDive) -> None:
    shifted = dataclasses.replace(dive, depth_m=dive.depth_m + 0.03)
    assert figures(shifted, PHASES).depth_rms_mm > 30.0
    assert figures(shifted, PHASES).phase_rms_mm["waves"] > 30.0
    about_mean = figures(shifted, PHASES, about_mean=True)
    assert about_mean.depth_sd_mm == pytest.approx(1e3 * ERROR_M / math.sqrt(2), rel=0.01)
    assert about_mean.phase_rms_mm["waves"] == pytest.approx(1e3 * ERROR_M / math.sqrt(2), rel=0.01)


def test_stamps_of_another_clock_are_left_out(recording: DemoRecording, make_sample: Sampler) -> None:
    """Before it has heard the vehicle's clock, the controller may stamp its own."""
    clean = figures(arrange(recording), PHASES)
    for boot_s in (-1000.0, 1.0, 1000.0):
        stray = replace(_sample(make_sample, 0.0, 0), eta_d=(77.0,) * 4)
        stray = replace(stray, state=replace(stray.state, boot_s=boot_s))
        for key, _, payload in samples.encode(stray, VEHICLE):
            recording.add(key, payload)
    assert figures(arrange(recording), PHASES) == clean


def test_a_dive_that_ended_early_is_refused(dive: DemoDive) -> None:
    with pytest.raises(ValueError, match=r"the dive ended 20\.0 s after arming, before 30 s"):
        figures(dive, {"waves": (10.0, 30.0)})


def test_what_is_missing_is_named(recording: DemoRecording) -> None:
    with pytest.raises(ValueError, match="'truth'"):
        arrange(DemoRecording())
    recording.command.clear()
    with pytest.raises(ValueError, match="'command'"):
        arrange(recording)


def test_foreign_messages_are_refused() -> None:
    with pytest.raises(ValueError, match="no key of holdfast"):
        DemoRecording().add("holdfast/demo/nonsense", b"{}")
    with pytest.raises(ValueError, match="Expected"):
        DemoRecording().add("sim/demo/truth", b'{"t_s": "noon"}')


def test_what_a_part_is_worth_comes_from_the_figures(dive: DemoDive) -> None:
    without = replace(figures(dive, PHASES), phase_rms_mm={"a": 10.0, "b": 10.0, "c": 10.0, "d": 10.0})
    with_it = replace(without, phase_rms_mm={"a": 8.0, "b": 9.6, "c": 10.4, "d": 12.0})
    assert worth("The network", without, with_it) == (
        "The network lowers the error: a -20 %; it raises it: d +20 %; it brings nothing (within 5 %): b, c."
    )
    assert worth("It", with_it, with_it) == "It brings nothing (within 5 %): a, b, c, d."


def test_the_path_goes_down_and_up_twice() -> None:
    story = Story()
    t_s = np.arange(0.0, story.end_s, 0.1)
    asked_m = [story.depth_m_at(t) for t in t_s]
    changed = {
        round(float(t), 1): asked
        for t, asked, last in zip(t_s[1:], asked_m[1:], asked_m, strict=False)
        if asked != last
    }
    assert changed == {12.0: 5.5, 16.0: 5.0, 20.0: 5.5, 24.0: 5.0}


def test_all_dives_meet_the_same_water_and_load() -> None:
    ticks: list[float] = []
    law = dive_holdfast(SHORT, "none", None, lambda t_s, _: ticks.append(t_s))
    alt_hold = dive_alt_hold(SHORT, law, None, lambda *_: None)
    for dive in (law, alt_hold):
        result = figures(dive, SHORT.phases)
        assert all(0.0 < rms_mm < 300.0 for rms_mm in result.phase_rms_mm.values())
        assert result.heading_rms_deg < 5.0
    assert len(ticks) == len(law.t_s)
    assert max(law.depth_desired_m) == pytest.approx(SHORT.depth_m + SHORT.step_m, abs=0.25)
    # ALT_HOLD is sent the path that Holdfast made of the steps: the same at the same time since arming.
    asked_m = np.interp(law.t_s, alt_hold.t_s, alt_hold.depth_desired_m)
    assert np.abs(asked_m - law.depth_desired_m).max() < 0.05


def test_the_picture_shows_everything_with_units(dive: DemoDive) -> None:
    story = Story(waves_s=2.0, path_s=5.0, load_on_s=12.0, load_off_s=15.0, end_s=18.0)
    result = figures(dive, story.phases)
    results = {name: replace(result, depth_rms_mm=1.23 + i) for i, name in enumerate(COLOURS)}
    results |= {"live": result}
    figure = draw(dict.fromkeys(results, dive), results, story, ["It helps.", "It harms."], "made by hand")
    depth, bars, error = figure.axes
    assert [panel.get_ylabel() for panel in figure.axes] == [
        "depth (m)",
        "RMS (mm), logarithmic",
        "true depth minus reference (mm)",
    ]
    for panel in (depth, error):
        assert [text.get_text() for text in panel.texts] == [*story.phases]
    assert figure.get_suptitle().strip() == (
        "Depth error: ALT_HOLD 1 mm RMS, law 2.2, law + observer 3.2, Holdfast 4.2"
    )
    assert [text.get_text() for text in figure.texts if "It" in text.get_text()] == ["It helps.\nIt harms."]
    assert figure.get_supxlabel() == "made by hand"
    lines = error.get_lines()[:3]
    assert len({line.get_color() for line in lines}) == 3
    assert len(bars.containers) == len(COLOURS)
    image = io.BytesIO()
    figure.savefig(image)
    assert image.getvalue().startswith(b"\x89PNG")


NOW = Now(
    depth_m=4.99,
    depth_desired_m=5.0,
    heading_rad=math.radians(-1.0),
    heading_desired_rad=math.radians(359.5),
    thrust_n=-50.0,
    saturated=True,
    disturbance_n=400.0,
    d_hat_n=-20.0,
)


def _view(now: Now | None) -> DemoView:
    full = [(t, 40.0) for t in np.arange(0.0, 20.0, 0.05)]
    errors = {"alt_hold": full, "law": full, "live": [(0.5, 5.0), (99.0, 1.0)]}
    marks = {"waves": 5.0, "load hung on": 12.0, "off": 19.9}
    return DemoView("live", "waves", 0.5, 20.0, now, errors, marks, "tcp/127.0.0.1:40000")


@pytest.mark.parametrize("width", [80, 100, 140])
@pytest.mark.parametrize("now", [None, NOW])
def test_a_frame_fits_the_terminal(width: int, now: Now | None) -> None:
    console = Console(width=width, file=io.StringIO(), force_terminal=True, color_system=None)
    with console.capture() as capture:
        console.print(demo_screen.render(_view(now), console.width))
    lines = capture.get().splitlines()
    assert len(lines) <= 22  # of the 24 that any terminal has
    assert {len(text.rstrip()) for text in lines} == {min(width, demo_screen.WIDTH)}
    assert "…" not in capture.get()
    assert "dive 1 of 5" in lines[0]
    assert ("SATURATED" in capture.get()) == (now is not None)


def test_a_line_says_the_same() -> None:
    assert demo_screen.line(_view(None)) == "live             0.5 s  waves"
    said = demo_screen.line(_view(NOW))
    assert "error  -10.0 mm, heading error -0.50°, thrust  -50 N, pushed +400 N, learnt  -20 N" in said


def test_the_table_sets_them_side_by_side(dive: DemoDive) -> None:
    story = Story(waves_s=2.0, path_s=5.0, load_on_s=12.0, load_off_s=15.0, end_s=18.0)
    result = figures(dive, story.phases)
    phases = dict.fromkeys(story.phases, 112.34)
    results = {"alt_hold": replace(result, phase_rms_mm=phases, depth_rms_mm=99.9)}
    results |= dict.fromkeys(("law", "observer", "holdfast", "live"), result)
    console = Console(width=80, file=io.StringIO())
    with console.capture() as capture:
        console.print(demo_screen.table(results, story, about_mean=False))
        console.print(demo_screen.table(results, story, about_mean=True))
    lines = capture.get().splitlines()
    rows = [" ".join(text.split()) for text in lines if text.strip()]
    assert rows[:3] == ["Errors, RMS, 2 to 18 s after arming", "law +", "ALT_HOLD law observer Holdfast live"]
    assert "depth, waves mm 112.3 7.1 7.1 7.1 7.1" in rows
    assert "depth, all of these mm 99.9 7.1 7.1 7.1 7.1" in rows
    assert any("of the depth about their mean" in text for text in lines)
    assert all(len(text) <= 80 for text in lines)


def test_the_story_in_words(make_sample: Sampler) -> None:
    story = Story(path_s=12.0, load_on_s=14.0, load_off_s=16.0)
    assert phase_of(DemoRecording(), story) == "starting the controller"
    heard, words = DemoRecording(), list[str]()
    for tick in range(0, round(END_S / STEP_S), 10):
        t_s = tick * STEP_S
        for key, _, payload in samples.encode(_sample(make_sample, t_s, tick), VEHICLE):
            heard.add(key, payload)
        heard.add("sim/demo/truth", msgspec.json.encode(_truth(t_s)))
        phase = phase_of(heard, story)
        if not words or words[-1] != phase:
            words.append(phase)
    assert words == [f"{phase}, in real time" for phase in story.phases]
