"""The page after the dive: one HTML file with everything in it."""

import base64
import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from html import escape

from lab.report.figures import AXIS_OF, NAMES, DiveFigures, Held
from lab.report.log import Log

STYLE = """
:root { color-scheme: light dark; --faint: #666; --line: #ddd; --mark: #0072B2; --ground: #fff; --text: #111 }
@media (prefers-color-scheme: dark) {
  :root { --faint: #aaa; --line: #444; --mark: #56B4E9; --ground: #161616; --text: #eee }
}
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1100px; margin: 1.5rem auto; padding: 0 1rem;
  background: var(--ground); color: var(--text) }
h1 { font-size: 1.5rem; margin: 0 } h2 { font-size: 1.1rem; margin: 1.8rem 0 .4rem }
p.under { color: var(--faint); margin: .2rem 0 1rem }
img { width: 100%; background: #fff; border-radius: 4px }
img.above { max-width: 640px; display: block }
.wide { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { padding: .25rem .8rem .25rem 0; text-align: right; border-bottom: 1px solid var(--line);
  white-space: nowrap }
th { font-weight: 600; color: var(--faint) }
td.text, th.text { text-align: left; white-space: normal }
ul.advice li { margin: .35rem 0 } ul.advice { border-left: 3px solid var(--mark); padding-left: 1.6rem }
details { margin-top: 1rem } summary { cursor: pointer; color: var(--faint) }
"""


def page(
    log: Log, figures: DiveFigures, advice: Sequence[str], picture: bytes, above: bytes | None = None
) -> str:
    """Return the page; `picture` is a PNG, and so is `above`, the map, if there is one."""
    began = datetime.fromtimestamp(log.began_ns / 1e9, UTC)
    loop = figures.loop
    about = log.metadata.get("holdfast", {})
    picture64 = base64.b64encode(picture).decode()
    voltage = (
        f", battery down to {figures.voltage_min_v:.1f} V" if math.isfinite(figures.voltage_min_v) else ""
    )
    return f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{escape(log.vehicle)}, {began:%Y-%m-%d %H:%M} UTC</title><style>{STYLE}</style>
<h1>{escape(log.vehicle)}: the dive of {began:%Y-%m-%d %H:%M} UTC</h1>
<p class="under">{_time(log.duration_s)} recorded, engaged {len(figures.phases)} times, down to
{figures.depth_max_m:.1f} m{voltage}. Holdfast {escape(about.get("holdfast", "of unknown version"))},
{escape(about.get("git", "revision unknown")[:18])}.</p>
{_list("note", log.notes)}
<img alt="Depth, heading, errors, thrust, disturbance and loop over time"
 src="data:image/png;base64,{picture64}">
{_above(above)}<h2>What to look at</h2>
{_list("advice", advice or ["No rule found anything that stands out."])}
<h2>How well it was held</h2>
{_held(figures)}
<p class="under">Errors are measured minus desired, now. RMS, p95 and peak while the reference rested, from
3 s after engaging; <i>moving</i> is the RMS while it did not. <i>True</i> is the simulator's, less its mean:
a sensor's zero is no error of the controller.</p>
<h2>What it took</h2>
{_took(figures)}
<p class="under">Delivered thrust, as the thruster curve has it; the mean is that while the
reference rested; chatter is its RMS change a tick.</p>
<h2>States</h2>
{
        _table(
            ("at", "state", "for", "because", "conditions seen"),
            (
                (
                    _time(span.begin_s),
                    span.state,
                    _time(span.end_s - span.begin_s),
                    span.reason,
                    _words(span.conditions),
                )
                for span in log.spans
            ),
            text=(1, 3, 4),
        )
    }
<h2>Events</h2>
{_events(log)}
<h2>Model</h2>
{_models(log, figures)}
<h2>Loop and link</h2>
{
        _table(
            ("", "median", "p99", "worst"),
            (
                (
                    "tick lateness (ms)",
                    f"{loop.lateness_p50_ms:.2f}",
                    f"{loop.lateness_p99_ms:.2f}",
                    f"{loop.lateness_max_ms:.1f}",
                ),
                ("tick compute (µs)", "", f"{loop.compute_p99_us:.0f}", ""),
                ("telemetry delay (ms)", f"{loop.telemetry_delay_ms:.0f}", "", ""),
                ("command delay (ms)", f"{loop.command_delay_ms:.0f}", "", ""),
                ("age of the link while engaged (s)", "", f"{loop.link_age_p99_s:.2f}", ""),
                ("age of depth while engaged (s)", "", f"{loop.depth_age_p99_s:.2f}", ""),
            ),
            text=(0,),
        )
    }
<p class="under">{loop.ticks} ticks in the file, {loop.late_ticks} left out by the loop, {
        loop.ticks_missing
    } lost
on the way to the file, {figures.recorder_dropped} messages dropped by the recorder. The delays were measured
{loop.delay_known:.0%} of the time; a telemetry delay is known up to a constant that TIMESYNC cannot see.</p>
<details><summary>About the recording, and the configuration</summary>
{
        _table(
            ("", "", ""),
            ((table, key, value) for table, rows in log.metadata.items() for key, value in rows.items()),
            text=(0, 1, 2),
        )
    }
</details></html>
"""


def lines(figures: DiveFigures, advice: Sequence[str]) -> list[str]:
    """Return the same in a few lines for the terminal."""
    said = []
    for phase in figures.phases:
        said.append(
            f"phase {phase.number}, {_time(phase.begin_s)} to {_time(phase.end_s)}, ended: {phase.ended}"
        )
        said += [
            f"  {NAMES[hold.dof]:8} RMS {_number(hold.rms)} {hold.unit}, p95 {_number(hold.p95)}, "
            f"peak {_number(hold.peak)}; moving {_number(hold.moving_rms)}; chatter {hold.chatter:.2f} "
            f"{hold.thrust_unit}; saturated {hold.saturated:.1%}"
            for hold in phase.held
        ]
    said += [f"* {line}" for line in advice] or ["no rule found anything that stands out"]
    return said


def _held(figures: DiveFigures) -> str:
    rows: list[Sequence[str]] = []
    for phase in figures.phases:
        for i, hold in enumerate(phase.held):
            first = (str(phase.number), _time(phase.begin_s), _time(phase.end_s - phase.begin_s))
            errors = (_with(value, hold.unit) for value in _errors(hold))
            rows.append(
                (
                    *(first if i == 0 else ("", "", "")),
                    *(NAMES[hold.dof], _time(hold.hold_s), *errors, phase.ended if i == 0 else ""),
                )
            )
    head = ("phase", "from", "for", "", "held", "RMS", "p95", "peak", "bias", "moving", "true", "ended")
    return _table(head, rows, text=(3, 11)) if rows else "<p>It never engaged.</p>"


def _took(figures: DiveFigures) -> str:
    rows = (
        (
            str(phase.number),
            AXIS_OF[hold.dof],
            *(_with(value, hold.thrust_unit) for value in (hold.thrust_rms, hold.thrust_mean, hold.chatter)),
            f"{hold.saturated:.1%}",
        )
        for phase in figures.phases
        for hold in phase.held
    )
    return _table(("phase", "", "thrust, RMS", "mean", "chatter", "saturated"), rows, text=(1,))


def _errors(hold: Held) -> tuple[float, ...]:
    return (hold.rms, hold.p95, hold.peak, hold.bias, hold.moving_rms, hold.true_rms)


def _events(log: Log) -> str:
    if not log.events:
        return "<p class='under'>None were recorded.</p>"
    rows = ((_time(at_s), event.severity, event.kind, event.text) for at_s, event in log.events)
    return _table(("at", "severity", "kind", "what"), rows, text=(1, 2, 3))


def _models(log: Log, figures: DiveFigures) -> str:
    rows = []
    for dof, model in figures.models.items():
        if model is None:
            continue
        axis = {"z": "heave", "psi": "yaw"}[dof]
        mass_unit, force_unit = ("kg m²", "N·m") if dof == "psi" else ("kg", "N")
        rows.append(
            (
                f"{axis} mass with added mass",
                f"{model.mass.value:.3g} ± {model.mass.sigma:.2g} {mass_unit}",
                _with(log.config(f"{axis}.mass", math.nan), mass_unit),
                "" if model.mass.identified else "too little motion to tell",
            )
        )
        believed = log.config(f"{axis}.linear_damping", math.nan) * model.speed
        believed += log.config(f"{axis}.quadratic_damping", math.nan) * model.speed**2
        rows.append(
            (
                f"{axis} damping at {model.speed:.2g} {'rad/s' if dof == 'psi' else 'm/s'}",
                f"{model.damping_at.value:.2g} ± {model.damping_at.sigma:.2g} {force_unit}",
                _with(believed, force_unit),
                "" if model.damping_at.identified else "too little motion to tell",
            )
        )
    if not rows:
        return "<p class='under'>No phase was long enough (12 s) to tell mass and damping.</p>"
    note = (
        "<p class='under'>Two-stage least squares over the longest phase, from recorded thrust and rate, "
        "with the desired motion as instrument; ± is one standard deviation by block bootstrap. The thrust "
        "is what the curve says, not measured: an error of curve or lag shows as one of mass, and ± knows "
        "nothing of it (in the simulator 10 %).</p>"
    )
    return _table(("", "this dive", "configured", ""), rows, text=(0, 3)) + note


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], text: Sequence[int] = ()) -> str:
    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{' class=text' if i in text else ''}>{escape(cell)}</{tag}>" for i, cell in enumerate(row)
        )

    body = "\n".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<div class=wide><table><tr>{cells('th', head)}</tr>\n{body}\n</table></div>"


def _list(kind: str, items: Iterable[str]) -> str:
    inside = "\n".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul class={kind}>{inside}</ul>" if inside else ""


def _words(conditions: Sequence[str]) -> str:
    return ", ".join(conditions).lower().replace("_", " ")


def _time(seconds: float) -> str:
    minutes, rest = divmod(seconds, 60.0)
    return f"{seconds:.1f} s" if seconds < 60.0 else f"{minutes:.0f} min {rest:02.0f} s"


def _number(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}" if abs(value) < 10.0 else f"{value:.1f}"


def _with(value: float, unit: str) -> str:
    return "–" if math.isnan(value) else f"{_number(value)} {unit}"


def _above(picture: bytes | None) -> str:
    if picture is None:
        return ""
    encoded = base64.b64encode(picture).decode()
    return (
        '<h2>From above</h2>\n<img class="above" alt="Map: estimate, reference, path and fence, north up"\n'
        f' src="data:image/png;base64,{encoded}">\n'
    )
