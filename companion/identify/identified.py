"""What `holdfast identify` found: as a vehicle's file, a table, a picture. A process of its own prints it."""

import datetime
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, get_type_hints

import msgspec

from companion.config import Config, VehicleFile, vehicle_of
from companion.control.bounds import clamped
from companion.identify.fit import (
    DELAY,
    LAG,
    LATER,
    LEVER,
    LINEAR,
    MASS,
    QUADRATIC,
    RIGHTING,
    START,
    STEADY,
    Fit,
    Value,
)
from companion.identify.manoeuvre import Manoeuvre
from companion.records import AXES, DOFS, PSI, Z
from companion.telemetry import ranges

TRUSTED = 0.1
"""A mass whose standard deviation is a larger share of it is not taken."""

TRUSTED_RIGHTING, TRUSTED_LEVER_M = 0.3, 0.01
"""The same of a righting moment; and the doubt beyond which a lever is not taken."""

NAMED = (*AXES, "roll", "pitch")
UNITS = (("kg", "N s/m", "N s2/m2"), ("kg m2", "N m s", "N m s2"))


def trusted(fits: Sequence[Fit]) -> list[Fit]:
    """Return the fits that tell the mass of their axis."""
    return [one for one in fits if one.values[MASS].sigma < TRUSTED * one.values[MASS].value]


def vehicle(
    config: Config, found: Mapping[str, Sequence[Fit]], tilts: Sequence[Fit], today: datetime.date
) -> tuple[VehicleFile, list[str], dict[str, str]]:
    """Return the vehicle, what to say on top of its file, and the notes behind its keys.

    `found` are the fits by thruster curve, the better curve first. The file holds those of the T200's curve,
    for it is what the controller inverts; what was not identified stays what `config` says. `tilts` are those
    of roll and pitch.
    """
    fits = trusted(found["t200"])
    table: dict[str, Any] = msgspec.to_builtins(vehicle_of(config))
    notes = {"vehicle.frame": "from the configuration"}
    for key in ("roll_inertia", "pitch_inertia", "lever_m", "max_moment_nm", "max_axis"):
        notes[f"levelling.{key}"] = "not identified"
    measured: dict[tuple[str, str], Value] = {}
    if fits:
        measured["thrusters", "lag_s"] = pooled([one.values[LAG] for one in fits])
        measured["thrusters", "start_s"] = pooled([one.values[START] for one in fits])
    for name in AXES:
        notes[f"{name}.mass"] = "not identified: what the configuration says"
        notes[f"{name}.max_force"] = "from the configuration"
    for one in fits:
        name = AXES[one.dof]
        for key, number in (("mass", MASS), ("linear_damping", LINEAR), ("quadratic_damping", QUADRATIC)):
            measured[name, key] = one.values[number]
    measured |= {("levelling", name): value for name, value in tilted(tilts).items()}
    kinds = get_type_hints(VehicleFile)
    for (name, key), (value, sigma) in measured.items():
        least, most = ranges.bounds(get_type_hints(kinds[name], include_extras=True)[key]) or (value, value)
        table[name][key] = float(f"{clamped(value, least, most):.4g}")
        beyond = "" if least <= value <= most else f"; found {value:.4g}, the range is {least:g} to {most:g}"
        notes[f"{name}.{key}"] = f"sd {sigma:.2g}{beyond}"
    about = [
        f"Identified by `holdfast identify` on {today.isoformat()}. sd: standard deviation.",
        *said(found),
    ]
    about.append("config/vehicles/custom.toml explains every key.")
    return msgspec.convert(table, VehicleFile), about, notes


def tilted(tilts: Sequence[Fit]) -> dict[str, Value]:
    """Return the keys of `[levelling]` that roll and pitch tell."""
    reported = {}
    for one in trusted(tilts):
        name, righting = NAMED[one.dof], one.values[RIGHTING]
        reported[f"{name}_inertia"] = one.values[MASS]
        if righting.sigma < TRUSTED_RIGHTING * righting.value:
            reported[f"{name}_righting_nm"] = righting
    levers = [one.values[LEVER] for one in trusted(tilts) if one.values[LEVER].sigma < TRUSTED_LEVER_M]
    return reported | ({"lever_m": pooled(levers)} if levers else {})


def said(found: Mapping[str, Sequence[Fit]]) -> Iterator[str]:
    """Say what no key of the vehicle's file holds."""
    better = next(iter(found))
    if better != "t200":
        yield "Its thrusters give about 51.5 N u|u|. The keys take them for T200, as the controller does."
        for one in trusted(found[better]):
            axis, mass = AXES[one.dof], one.values[MASS]
            drag = " + ".join(
                f"({one.values[number].value:.3g} sd {one.values[number].sigma:.2g}){power}"
                for number, power in ((LINEAR, " v"), (QUADRATIC, " v|v|"))
            )
            yield f"  {axis} with that curve: mass {mass.value:.4g} sd {mass.sigma:.2g}, damping {drag}"
    missing = [
        name for dof, name in enumerate(AXES) if dof not in {one.dof for one in trusted(found["t200"])}
    ]
    if missing:
        yield f"Not identified: {', '.join(missing)}; {why_not(missing)}."
    for one in trusted(found[better]):
        delay, later, steady = (one.values[number] for number in (DELAY, LATER, STEADY))
        text = (
            f"{AXES[one.dof]}: delay {1e3 * delay.value:.0f} ms (sd {1e3 * delay.sigma:.1f}) from sending to "
            f"the rate's stamp; the position's is {1e3 * later.value:.0f} ms earlier "
            f"(sd {1e3 * later.sigma:.1f})"
        )
        if one.dof == Z:
            text += f"; net buoyancy {-steady.value:.2f} N (sd {steady.sigma:.2g})"
        yield text


def why_not(missing: Sequence[str]) -> str:
    """Say what the axes that are missing would need."""
    needs = []
    if {"surge", "sway"} & set(missing):
        needs.append("surge and sway need a position and velocity, such as a DVL's")
    if {"heave", "yaw"} & set(missing):
        needs.append("heave and yaw need vehicle.steering_mode = manual and a calm place")
    return "; ".join(needs)


def pooled(values: Sequence[Value]) -> Value:
    """Return the mean of values that should be one, weighted by their certainty."""
    weights = [1.0 / max(one.sigma, 1e-4) ** 2 for one in values]
    mean = sum(weight * one.value for weight, one in zip(weights, values, strict=True)) / sum(weights)
    return Value(mean, math.sqrt(1.0 / sum(weights)))


class Progress:
    """Shows how a manoeuvre goes: a bar where rich is there, a line for each axis where it is not."""

    def __enter__(self) -> Self:
        self._said = ""
        self._bar: Any = None
        try:
            from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar
        except ImportError:
            return self
        self._bar = Bar(TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
        self._task = self._bar.add_task("connecting", total=1.0)
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, manoeuvre: Manoeuvre) -> None:
        """Show a manoeuvre's state."""
        if self._bar is not None:
            self._bar.update(self._task, description=manoeuvre.doing[:100], completed=manoeuvre.share_done)
        elif manoeuvre.doing != self._said:
            self._said = manoeuvre.doing
            sys.stdout.write(f"{manoeuvre.doing}\n")


def show(config: Config, found: Mapping[str, Sequence[Fit]], tilts: Sequence[Fit]) -> None:
    """Print what was found: a table where rich is there, lines where it is not."""
    rows = [*_rows(config, found), *_tilt_rows(config, tilts)]
    try:
        from rich import box
        from rich.console import Console
        from rich.table import Table
    except ImportError:
        for row in rows:
            sys.stdout.write("  ".join(row) + "\n")
    else:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for column in ("axis", "quantity", "found", "sd", "believed before"):
            table.add_column(column, justify="left" if column in ("axis", "quantity") else "right")
        for row in rows:
            table.add_row(*row)
        Console(width=None if sys.stdout.isatty() else 120).print(table)
    for line in said(found):
        sys.stdout.write(f"{line}\n")


def _rows(config: Config, found: Mapping[str, Sequence[Fit]]) -> Iterator[tuple[str, str, str, str, str]]:
    for one in found["t200"]:
        axis, units = config.axes[one.dof], UNITS[one.dof == PSI]
        for key, number, unit in zip(
            ("mass", "linear_damping", "quadratic_damping"), (MASS, LINEAR, QUADRATIC), units, strict=True
        ):
            value = one.values[number]
            believed = f"{getattr(axis, key):.3g}"
            yield AXES[one.dof], f"{key}, {unit}", f"{value.value:.3g}", f"{value.sigma:.2g}", believed
        for speed, force in one.damping_at:
            believed = f"{axis.linear_damping * speed + axis.quadratic_damping * speed**2:.3g}"
            what = f"damping at {speed:.2f} {'rad/s' if one.dof == PSI else 'm/s'}"
            yield AXES[one.dof], what, f"{force.value:.3g}", f"{force.sigma:.2g}", believed
        gain, sigma = axis.mass / one.values[MASS].value, one.values[MASS].sigma / one.values[MASS].value
        yield AXES[one.dof], "acceleration per command", f"{gain:.2f}", f"{gain * sigma:.2g}", "1"
        lag = one.values[LAG]
        yield (
            AXES[one.dof],
            "thruster lag, s",
            f"{lag.value:.3f}",
            f"{lag.sigma:.2g}",
            f"{config.thrusters.lag_s:g}",
        )
        start, believed_s = one.values[START], config.thrusters.start_s
        yield AXES[one.dof], "motor start, s", f"{start.value:.3f}", f"{start.sigma:.2g}", f"{believed_s:g}"


def _tilt_rows(config: Config, tilts: Sequence[Fit]) -> Iterator[tuple[str, str, str, str, str]]:
    for one in tilts:
        name, believed = NAMED[one.dof], config.levelling
        for number, key, unit in (
            (MASS, f"{name}_inertia", "kg m2"),
            (RIGHTING, f"{name}_righting_nm", "N m"),
            (LEVER, "lever_m", "m"),
        ):
            value = one.values[number]
            what = f"{key.removeprefix(name + '_')}, {unit}"
            yield name, what, f"{value.value:.3g}", f"{value.sigma:.2g}", f"{getattr(believed, key):.3g}"


def draw(found: Mapping[str, Sequence[Fit]], tilts: Sequence[Fit], path: Path) -> None:
    """Draw rates as measured and as the model alone gives them, an axis a row.

    Raises ImportError without matplotlib.
    """
    from matplotlib.figure import Figure

    fits = [*next(iter(found.values())), *tilts]
    figure = Figure(figsize=(10.0, 2.4 * max(1, len(fits))), layout="constrained")
    rows = figure.subplots(max(1, len(fits)), 1, squeeze=False)[:, 0]
    for axes, one in zip(rows, fits, strict=False):
        t_s = one.t_s - one.t_s[0]
        unit = "rad/s" if one.dof >= PSI else "m/s"
        axes.plot(t_s, one.measured[:, 1], label="measured", linewidth=1.6, color="#7a8794")
        axes.plot(t_s, one.predicted[:, 1], label="the model alone", linewidth=1.0, color="#c2410c")
        mass = one.values[MASS]
        axes.set_title(
            f"{NAMED[one.dof]}: mass {mass.value:.3g} (sd {mass.sigma:.2g}), {one.curve}",
            loc="left",
            fontsize=9,
        )
        axes.set_ylabel(f"rate of {(*DOFS, 'roll', 'pitch')[one.dof]}, {unit}")
        axes.grid(alpha=0.3)
    rows[0].legend(loc="upper right", fontsize=8)
    rows[-1].set_xlabel("s")
    figure.savefig(path, dpi=110)
