"""How the house draws: Okabe and Ito's colours, which colour-blind people tell apart, and quiet frames."""

from matplotlib.axes import Axes

ORANGE, BLUE, GREEN, SKY = "#D55E00", "#0072B2", "#009E73", "#56B4E9"
BLACK, YELLOW = "#000000", "#F0E442"
EVENT, WINDOW, FAINT = "0.55", "0.94", "0.35"
SMALL = 9


def zero(panel: Axes) -> None:
    """Draw the line where nothing is."""
    panel.axhline(0.0, color=BLACK, linewidth=0.7, zorder=0)


def name(panel: Axes, title: str, unit: str) -> None:
    """Say what a panel shows, and in which unit."""
    panel.set_title(title, loc="left", fontweight="bold", fontsize=11)
    panel.set_ylabel(unit, fontsize=SMALL)


def plain(panel: Axes) -> None:
    """Take away what a panel does not need."""
    panel.grid(color="0.88", linewidth=0.6)
    panel.spines[["top", "right"]].set_visible(False)
    panel.tick_params(labelsize=SMALL)
