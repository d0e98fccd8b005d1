"""Predicted beside recorded velocity, 1 and 2 s ahead."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from companion.arrays import Array
from companion.identify.model import BODY, HORIZONS_S, Track, moved
from companion.records import AXES, PSI, Z
from lab import style

SHOWN_S = 40.0
"""Length of the drawn part of the log, the one in which most moves."""


def draw(tracks: Sequence[Track], thetas: Sequence[Array]) -> Figure:
    """Draw the axes that moved: recorded, and as each moment 1 and 2 s before predicted it."""
    pairs = zip(tracks, thetas, strict=True)
    track, theta = max(pairs, key=lambda one: (int(moved([one[0]])[-1].sum()), one[0].table.t_s.size))
    t_s, axes = track.table.t_s, np.flatnonzero(moved([track])[-1]).tolist() or [Z]
    begin_s, predicted = _liveliest(track, axes), track.predicted(theta)
    figure = Figure(figsize=(12.8, 1.0 + 2.3 * len(axes)), dpi=110, layout="constrained")
    panels = figure.subplots(len(axes), 1, squeeze=False, sharex=True)[:, 0]
    for panel, axis in zip(panels, axes, strict=True):
        recorded = track.table.velocity[:, BODY[axis]]
        shown = (begin_s <= t_s) & (t_s <= begin_s + SHOWN_S)
        panel.plot(t_s[shown], recorded[shown], color=style.BLACK, linewidth=1.8, label="recorded")
        for number, colour in enumerate((style.BLUE, style.VERMILLION)):
            horizon_s, whole = HORIZONS_S[number], np.isfinite(track.changes[:, number]).any(axis=1)
            first = track.first[whole]
            at_s, ahead = t_s[first] + horizon_s, recorded[first] + predicted[whole, number, axis]
            drawn = (begin_s <= at_s) & (at_s <= begin_s + SHOWN_S)
            gaps = np.where(np.diff(at_s[drawn], prepend=at_s[drawn][:1]) > 1.0, np.nan, 1.0)
            label = f"predicted {horizon_s:g} s before"
            panel.plot(at_s[drawn], ahead[drawn] * gaps, color=colour, linewidth=1.0, label=label)
        unit = "rad/s" if axis == PSI else "m/s"
        style.name(panel, f"{AXES[axis].capitalize()}: {Path(track.table.name).name}", unit)
        style.zero(panel)
        style.plain(panel)
    panels[0].legend(frameon=False, fontsize=style.SMALL, loc="upper right", ncols=3)
    panels[-1].set_xlabel("s", fontsize=style.SMALL)
    return figure


def _liveliest(track: Track, axes: Sequence[int]) -> float:
    """Return where to begin: the stretch in which the axes move most, each by its own measure."""
    velocity = np.nan_to_num(track.table.velocity[:, [BODY[axis] for axis in axes]])
    energy = np.cumsum((velocity**2 / np.maximum(velocity.var(axis=0), 1e-9)).sum(axis=1))
    ends = np.searchsorted(track.table.t_s, track.table.t_s + SHOWN_S) - 1
    return float(track.table.t_s[int(np.argmax(energy[ends] - energy))])
