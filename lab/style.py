"""How all figures look: Okabe and Ito's colours, which colour-blind people tell apart, and quiet frames."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

mpl.use("Agg")  # files, no screen

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, VERMILLION = "#F0E442", "#0072B2", "#D55E00"
EVENT, WINDOW, FAINT = "0.55", "0.94", "0.35"
SMALL = 9
PRINTED: dict[Any, Any] = {
    "figure.dpi": 160,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "lines.linewidth": 1.2,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
}
"""Matplotlib's parameters for figures that stand in a document."""


def zero(panel: Axes) -> None:
    """Draw the line where nothing is."""
    panel.axhline(0.0, color=BLACK, linewidth=0.7, zorder=0)


def name(panel: Axes, title: str, unit: str, pad: float | None = None) -> None:
    """Say what a panel shows, `pad` points above it, and in which unit."""
    panel.set_title(title, loc="left", fontweight="bold", fontsize=11, pad=pad)
    panel.set_ylabel(unit, fontsize=SMALL)


def save(figure: Figure, path: Path, **options: Any) -> Path:
    """Write a figure and forget it; return its path."""
    figure.savefig(path, **options)
    plt.close(figure)
    return path


def plain(panel: Axes) -> None:
    """Take away what a panel does not need."""
    panel.grid(color="0.88", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(labelsize=SMALL)
