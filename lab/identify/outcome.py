"""What `holdfast identify` does with a table of samples: fit, judge, say, write the vehicle's file."""

import datetime
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from companion.config import VehicleFile, vehicle_text
from companion.identify import fit
from companion.identify.model import HORIZONS_S, Track, parameters, score
from companion.identify.samples import NoDiveError, Table
from companion.records import AXES
from holdfast import RefusedError, how_to_install


def conclude(
    tables: Sequence[Table],
    base: VehicleFile,
    out: Path,
    excited: Sequence[int] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> int:
    """Fit a vehicle to tables, say what was found, and write it to `out`, with a picture beside.

    `excited` are the axes that a manoeuvre moved, None for logs. Raises RefusedError where nothing moved.
    """
    tracks = [Track(table, base.vehicle.frame) for table in tables]
    try:
        found = fit.fit(tracks, base, progress, excited)
    except NoDiveError as error:
        raise RefusedError(f"{', '.join(table.name for table in tables)}: {error}") from error
    vehicle, notes = fit.vehicle(found, base)
    lines = [line for table in tables for line in held(table)] + [*fit.reported(found, base)]
    if not any(map(found.taken, range(len(AXES)))):
        sys.stdout.write("\n".join([*lines, "no inertia is known well enough: nothing was written"]) + "\n")
        return 1
    theta = parameters(vehicle)
    for horizon_s in HORIZONS_S:
        row = score(tracks, theta, horizon_s)
        quality = ", ".join(f"{axis} {row[axis]:.3f}" for axis in AXES if row[axis] is not None)
        lines.append(f"1 - R² of the change of velocity over {horizon_s:g} s, on these data: {quality}")
    today = datetime.datetime.now(datetime.UTC).date()
    about = [
        f"Identified by `holdfast identify` on {today.isoformat()}. sd: standard deviation.",
        "What was not identified is as it was before. config/vehicles/custom.toml explains every key.",
        *lines,
    ]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(vehicle_text(vehicle, about, notes), encoding="utf-8")
    lines.append(f"written: {out}; use it with holdfast run --vehicle {out}")
    try:
        from lab.identify import picture
    except ImportError:
        lines.append(f"no picture: matplotlib is missing; {how_to_install('lab')}")
    else:
        picture.draw(tracks, theta).savefig(out.with_suffix(".png"))
        lines.append(f"written: {out.with_suffix('.png')}")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def held(table: Table) -> list[str]:
    """Say what a table can tell: how long it is, what was measured, and which axes were moved."""
    length_s = float(table.t_s[-1] - table.t_s[0])
    measured = [
        words
        for words, columns in (("speed over ground", (0, 1)), ("vertical speed", (2,)), ("turn rate", (5,)))
        if np.isfinite(table.velocity[:, columns]).mean() > 0.1
    ]
    steered = [
        f"{axis} {share:.0%}"
        for axis, share in zip(AXES, np.mean(np.abs(table.commands[:, :4]) > 0.08, axis=0), strict=True)
        if share > 0.005
    ]
    name = Path(table.name).name
    return [
        f"{name}: {length_s:.0f} s; measured: {', '.join(measured) or 'attitude alone'}; "
        f"steered: {', '.join(steered) or 'nothing'} of the time",
        *(f"{name}: {note}" for note in table.notes),
    ]
