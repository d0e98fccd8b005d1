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
from lab.demo.demo import Story, phase_of
from lab.demo.picture import ROWS, draw
from lab.demo.screen import DemoView, Now
from lab.demo.timeline import DemoDive, DemoRecording, arrange, at_depth, figures, spans, window
from sim_bridge.zenoh_link import TruthSample

VEHICLE = "demo"
ARMED_S, END_S = 2.0, 22.0
STEP_S = 0.02
ERROR_M, WAVE_RADPS = 0.010, 2 * math.pi
LOAD_N = 12.0

Sampler = Callable[..., ControlSample]


def _reference_m(t_s: float) -> float:
    """0.5 m/s down to 5 m, from the arming on."""
    return min(5.0, max(0.0, 0.5 * (t_s - ARMED_S)))


def _loaded(t_s: float) -> bool:
    return 16.0 <= t_s < 18.0


def _truth(t_s: float, reference_m: float | None = None) -> TruthSample:
    """10 mm sine of depth error, 2° of heading error across the wrap, 12 N of load."""
    z_m = (_reference_m(t_s) if reference_m is None else reference_m) + ERROR_M * math.sin(WAVE_RADPS * t_s)
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
    span = window([dive], 5.0)
    assert span == pytest.approx((10.0, 20.0), abs=2 * STEP_S)
    result = figures(dive, span)
    assert result.depth_rms_mm == pytest.approx(1e3 * ERROR_M / math.sqrt(2), rel=0.01)
    assert result.depth_sd_mm == pytest.approx(result.depth_rms_mm, rel=0.01)
    assert result.depth_peak_mm == pytest.approx(1e3 * ERROR_M, rel=0.01)
    assert result.way_down_rms_mm == pytest.approx(1e3 * ERROR_M / math.sqrt(2), rel=0.02)
    assert result.heading_rms_deg == pytest.approx(2.0)
    assert result.thrust_rms_n == pytest.approx(7.0)
    assert result.chatter_n == pytest.approx(6.0)
    assert result.disturbance_rms_n == pytest.approx(LOAD_N * math.sqrt(0.2 * 0.8), rel=0.02)
    assert result.saturated_percent == pytest.approx(5.0, rel=0.03)
    assert result.ticks == pytest.approx(500, abs=2)
    assert result.ticks_lost == 0


def test_the_estimate_is_compared_when_it_acts_and_in_the_same_sign(dive: DemoDive) -> None:
    assert dive.disturbance_n.min() == -LOAD_N  # the load pulls down, d is positive upwards
    result = figures(dive, (10.0, 20.0))
    # One sample in between at each of the two edges; 0.1 s late, it would be ten times as much.
    assert result.d_hat_error_rms_n is not None
    assert result.d_hat_error_rms_n < 0.05 * LOAD_N


def test_a_lost_tick_is_counted_and_makes_no_chatter(recording: DemoRecording) -> None:
    steady = [replace(c, heave_delivered_n=c.boot_s) for c in recording.command]
    recording.command = steady[:700] + steady[710:]
    result = figures(arrange(recording), (10.0, 20.0))
    assert result.ticks_lost == 10
    assert result.chatter_n == pytest.approx(STEP_S)


def test_a_shifted_zero_is_in_the_rms_and_not_about_the_mean(dive: DemoDive) -> None:
    shifted = figures(dataclasses.replace(dive, depth_error_m=dive.depth_error_m + 0.03), (10.0, 20.0))
    assert shifted.depth_rms_mm > 30.0
    assert shifted.depth_sd_mm == pytest.approx(1e3 * ERROR_M / math.sqrt(2), rel=0.01)


def test_stamps_of_another_clock_are_left_out(recording: DemoRecording, make_sample: Sampler) -> None:
    """Before it has heard the vehicle's clock, the controller may stamp its own."""
    clean = figures(arrange(recording), (10.0, 20.0))
    for boot_s in (-1000.0, 1.0, 1000.0):
        stray = replace(_sample(make_sample, 0.0, 0), eta_d=(77.0,) * 4)
        stray = replace(stray, state=replace(stray.state, boot_s=boot_s))
        for key, _, payload in samples.encode(stray, VEHICLE):
            recording.add(key, payload)
    assert figures(arrange(recording), (10.0, 20.0)) == clean


def test_the_window_suits_both_dives(dive: DemoDive) -> None:
    later = dataclasses.replace(dive, depth_desired_m=np.minimum(5.0, 0.4 * dive.t_s), t_s=dive.t_s)
    shorter = dataclasses.replace(dive, t_s=dive.t_s * 0.9)
    assert window([dive, later, shorter], 5.0) == pytest.approx((12.49, 18.0), abs=0.05)
    with pytest.raises(ValueError, match=r"never arrived at 6 m: it ended at 5\.00 m"):
        window([dive], 6.0)


def test_alt_hold_is_measured_where_it_can_be() -> None:
    """At 5 m from boot on: no way down, and nothing of a learner; times count from the arming."""
    ticks = range(round(END_S / STEP_S) + 1)
    truth = [replace(_truth(tick * STEP_S, 5.0), load_on=False) for tick in ticks]
    commands = [3.0 * (-1) ** tick for tick in range(len(truth))]
    result = figures(at_depth(truth, commands, 5.0, math.pi - math.radians(1.0)), (10.0, 20.0))
    assert result.depth_rms_mm == pytest.approx(1e3 * ERROR_M / math.sqrt(2), rel=0.01)
    assert result.heading_rms_deg == pytest.approx(2.0)
    assert result.chatter_n == pytest.approx(6.0)
    assert (result.way_down_rms_mm, result.d_hat_error_rms_n, result.saturated_percent) == (None, None, None)
    assert at_depth(truth, commands, 5.0, 0.0).t_s[-1] == pytest.approx(END_S - ARMED_S)


def test_what_is_missing_is_named(recording: DemoRecording) -> None:
    with pytest.raises(ValueError, match="'truth'"):
        arrange(DemoRecording())
    recording.heave.clear()
    with pytest.raises(ValueError, match="'dof/z'"):
        arrange(recording)


def test_foreign_messages_are_refused() -> None:
    with pytest.raises(ValueError, match="no key of holdfast"):
        DemoRecording().add("holdfast/demo/nonsense", b"{}")
    with pytest.raises(ValueError, match="Expected"):
        DemoRecording().add("sim/demo/truth", b'{"t_s": "noon"}')


def test_spans() -> None:
    t_s = np.arange(5.0)
    assert spans(t_s, np.array([True, False, True, True, True])) == [(0.0, 1.0), (2.0, 4.0)]
    assert spans(t_s, np.zeros(5, bool)) == []


def test_the_picture_shows_everything_with_units(dive: DemoDive) -> None:
    span = window([dive], 5.0)
    result = figures(dive, span)
    results = {
        "alt_hold": replace(result, depth_rms_mm=49.7, way_down_rms_mm=None),
        "off": result,
        "on": replace(result, depth_rms_mm=1.25),
    }
    figure = draw(dict.fromkeys(results, dive), results, span, "in a pool", "made by hand")
    error, numbers, *others = figure.axes
    assert [panel.get_ylabel() for panel in (error, *others)] == [
        "true depth minus reference (mm)",
        "depth (m)",
        "true minus reference (°)",
        "command (N, + down)",
        "force (N, + up)",
    ]
    assert [text.get_text() for text in error.texts] == ["load on", "load off"]
    assert figure.get_suptitle() == (
        "Holdfast keeps the depth to 1.2 mm RMS, ArduSub's ALT_HOLD to 50 mm\nin a pool"
    )
    assert figure.get_supxlabel() == "made by hand"
    reported = draw(dict.fromkeys(results, dive), results, span, "", "", "depth_sd_mm").get_suptitle()
    assert reported.startswith("Holdfast keeps the depth to 7.1 mm RMS about the mean, ")
    # The dives differ in colour and in dashes; ALT_HOLD is drawn inside the window alone.
    alt_hold, off, on = error.get_lines()[:3]
    assert len({line.get_color() for line in (alt_hold, off, on)}) == 3
    assert [line.is_dashed() for line in (alt_hold, off)] == [True, True]
    assert np.min(alt_hold.get_xdata()) == pytest.approx(span[0])
    assert np.min(on.get_xdata()) < span[0] - 5.0
    assert len(numbers.tables[0].get_celld()) == 4 * len(ROWS) + 3
    assert numbers.tables[0][len(ROWS), 0].get_text().get_text() == "–"
    image = io.BytesIO()
    figure.savefig(image)
    assert image.getvalue().startswith(b"\x89PNG")


def test_saturation_is_shaded_only_where_it_was(dive: DemoDive) -> None:
    span = window([dive], 5.0)
    results = dict.fromkeys(("alt_hold", "off", "on"), figures(dive, span))
    dry = dataclasses.replace(dive, saturated=np.zeros_like(dive.saturated))
    legends = [
        draw({"alt_hold": dry, "off": off, "on": dry}, results, span, "", "").axes[4].get_legend()
        for off in (dive, dry)
    ]
    assert legends[0] is not None
    assert legends[0].get_texts()[0].get_text() == "saturated (off 5.0 %, on 0.0 %)"
    assert legends[1] is None


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
    errors = {"alt_hold": full, "off": full, "on": [(0.5, 5.0), (99.0, 1.0)]}
    marks = {"armed": 0.0, "load on": 12.0, "off": 19.9}
    return DemoView("on", "diving to 5 m", 0.5, 20.0, now, errors, marks, "tcp/127.0.0.1:40000")


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
    assert "dive 3 of 3" in lines[0]
    assert ("SATURATED" in capture.get()) == (now is not None)


def test_a_line_says_the_same() -> None:
    assert demo_screen.line(_view(None)) == "Holdfast    0.5 s  diving to 5 m"
    said = demo_screen.line(_view(NOW))
    assert "error  -10.0 mm, heading error -0.50°, thrust  -50 N, pushed +400 N, learnt  -20 N" in said


def test_the_table_sets_them_side_by_side(dive: DemoDive) -> None:
    off = figures(dive, (10.0, 20.0))
    on = replace(off, depth_rms_mm=0.5 * off.depth_rms_mm)
    alt_hold = replace(off, depth_rms_mm=50.5, way_down_peak_mm=None)
    console = Console(width=80, file=io.StringIO())
    with console.capture() as capture:
        console.print(demo_screen.table({"alt_hold": alt_hold, "off": off, "on": on}, (10.0, 20.0), 5.0))
    rows = [text.split() for text in capture.get().splitlines() if text.strip()]
    assert rows[0] == ["Holding", "5", "m,", "10.0", "to", "20.0", "s", "after", "arming"]
    assert rows[1] == ["ALT_HOLD", "plain", "law", "Holdfast"]
    assert rows[3][-3:] == ["50.5", "7.1", "3.5"]
    assert rows[-2][-3:] == ["–", "10.0", "10.0"]
    assert all(len(text) <= 80 for text in capture.get().splitlines())


def test_the_story_in_words(make_sample: Sampler) -> None:
    story = Story(load_on_s=14.0)
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
    assert words == [
        "diving to 5 m",
        "holding 5 m and 45° in current and waves",
        "a load of 12 N hangs on it",
        "the load is gone",
    ]
