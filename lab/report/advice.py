"""What the dive says about the settings: a rule each, with the figure that made it speak. No rule guesses."""

import math
from collections.abc import Iterator

from lab.report.figures import AXIS_OF, NAMES, DiveFigures, Held
from lab.report.log import Log

SATURATED = 0.02
CHATTER_N = 3.5
BIAS_MM, BIAS_DEG = 3.0, 0.5
TRIM = 0.1
MODEL_OFF = 0.2  # what an error of the thruster curve and of the lag may feign
LATE_MS = 5.0
LATE_TICKS = 0.001
SILENT_S = 0.25
CELL_V = 3.5
CELLS = 4
GRAVITY = 9.81


def advice(log: Log, figures: DiveFigures) -> list[str]:
    """Return what to look at, most important first."""
    said = [*_ends(figures), *_data(log, figures), *_loop(log, figures)]
    for dof in NAMES:
        held = [hold for phase in figures.phases for hold in phase.held if hold.dof == dof]
        if held:
            said += _held(log, max(held, key=lambda hold: hold.hold_s), held)
            said += _model(log, figures, dof)
    if figures.voltage_min_v < CELL_V * CELLS:
        said.append(
            f"The battery fell to {figures.voltage_min_v:.1f} V, below {CELL_V} V a cell of a {CELLS}-cell "
            "pack."
        )
    return said


def _ends(figures: DiveFigures) -> Iterator[str]:
    for span in figures.faults:
        yield f"A fault ended control at {span.begin_s:.0f} s: {span.reason}. See the table of states."
    if not figures.phases:
        yield "It never engaged: the table of states says what it was waiting for."


def _data(log: Log, figures: DiveFigures) -> Iterator[str]:
    loop = figures.loop
    if figures.recorder_dropped:
        yield (
            f"The recorder lost {figures.recorder_dropped} messages: its disk was slower than the data. "
            "Figures that need every tick, such as chatter, leave those out."
        )
    if loop.ticks_missing > 0.001 * loop.ticks:
        yield f"{loop.ticks_missing} of {loop.ticks + loop.ticks_missing} ticks are not in the file."
    if loop.depth_age_p99_s > SILENT_S:
        yield (
            f"Depth was up to {loop.depth_age_p99_s:.2f} s old (p99): the vehicle sends too seldom, or the "
            "link loses. Look at the stream rates with `holdfast check`."
        )


def _loop(log: Log, figures: DiveFigures) -> Iterator[str]:
    loop = figures.loop
    if loop.lateness_p99_ms > LATE_MS or loop.late_ticks > LATE_TICKS * loop.ticks:
        yield (
            f"The loop was late: p99 {loop.lateness_p99_ms:.1f} ms, {loop.late_ticks} of {loop.ticks} ticks "
            "left out. Run it as the service, which has real-time priority, or take load off the computer."
        )
    bear_ms = 1e3 * log.config("delays.gains_bear_s", 0.085)
    total_ms = loop.telemetry_delay_ms + loop.command_delay_ms
    if loop.delay_known > 0.5 and total_ms > bear_ms:
        yield (
            f"Both delays together are {total_ms:.0f} ms, and the gains tolerate {bear_ms:.0f}: they were "
            "reduced. Shorten the way to the autopilot before touching the gains."
        )


def _held(log: Log, longest: Held, held: list[Held]) -> Iterator[str]:
    axis, name = AXIS_OF[longest.dof], NAMES[longest.dof]
    saturated = max(hold.saturated for hold in held)
    if saturated > SATURATED:
        mean = abs(longest.thrust_mean) / log.config(f"{axis}.max_force", math.inf)
        why = (
            "the steady force alone takes much of it: trim the vehicle"
            if mean > 0.3
            else f"slow the setpoint ({axis}.max_rate, max_acceleration), or lower {axis}.lambda_per_s"
        )
        yield f"{name.capitalize()} was saturated {saturated:.0%} of the time: {why}."
    if longest.dof != "psi" and longest.chatter > CHATTER_N:
        compensator = _word(log, f"{axis}.compensator")
        first = (
            f"lower {axis}.learning_rate, then {axis}.kappa_per_s"
            if "network" in compensator or "regressor" in compensator
            else f"lower {axis}.kappa_per_s, or raise {axis}.rate_noise"
        )
        yield (
            f"{axis.capitalize()} thrust chatters: {longest.chatter:.1f} N from tick to tick (RMS; above "
            f"{CHATTER_N} wears thrusters): {first}."
        )
    least = BIAS_DEG if longest.dof == "psi" else BIAS_MM
    if abs(longest.bias) > least and abs(longest.bias) > 3.0 * longest.bias_sigma:
        compensator = _word(log, f"{axis}.compensator")
        cure = (
            f"set {axis}.compensator to network or observer"
            if compensator in ("none", "")
            else f"it has a compensator ({compensator}): look at {axis}.max_disturbance and dead_zone"
        )
        yield (
            f"A bias of {longest.bias:+.1f} ± {longest.bias_sigma:.1f} {longest.unit} is left in {name}: "
            f"{cure}."
        )
    full = log.config(f"{axis}.max_force", math.inf)
    if longest.dof == "z" and abs(longest.thrust_mean) > TRIM * full and longest.hold_s > 10.0:
        way, cure = ("down", "add") if longest.thrust_mean > 0 else ("up", "remove")
        yield (
            f"Holding depth took {abs(longest.thrust_mean):.1f} N {way} on average. If that was no load, "
            f"{cure} {abs(longest.thrust_mean) / GRAVITY:.2f} kg of ballast (weight in water)."
        )


def _model(log: Log, figures: DiveFigures, dof: str) -> Iterator[str]:
    model, axis = figures.models.get(dof), AXIS_OF[dof]
    if model is None:
        return
    nominal = log.config(f"{axis}.mass", math.nan)
    unit = "kg m²" if dof == "psi" else "kg"
    found = model.mass
    if found.identified and abs(found.value - nominal) > max(2.0 * found.sigma, MODEL_OFF * nominal):
        yield (
            f"{axis.capitalize()}: this dive shows {found.value:.3g} ± {found.sigma:.2g} {unit} of mass with "
            f"added mass; {axis}.mass is {nominal:g}."
        )
    linear, quadratic = (log.config(f"{axis}.{kind}_damping", math.nan) for kind in ("linear", "quadratic"))
    believed = linear * model.speed + quadratic * model.speed**2
    drag = model.damping_at
    if drag.identified and abs(drag.value - believed) > max(2.0 * drag.sigma, MODEL_OFF * believed):
        yield (
            f"{axis.capitalize()}: at its typical speed damping took {drag.value:.2g} ± {drag.sigma:.2g} "
            f"{'N·m' if dof == 'psi' else 'N'}, and the model says {believed:.2g}: scale "
            f"{axis}.linear_damping and quadratic_damping by {drag.value / believed:.2g}."
        )


def _word(log: Log, key: str) -> str:
    return log.metadata.get("config", {}).get(key, "").strip('"')
