"""What the paper's dives come to: medians over seeds, and the claims that must come out of them."""

from dataclasses import asdict, dataclass
from math import inf
from operator import attrgetter
from statistics import median
from typing import Any

from lab.paper.simulation import CANONICAL, Figures, PaperCase

NAMES = {
    ("none", 0.0): "law",
    ("integrator", 0.0): "law + integrator",
    ("network", 0.0): "law + network",
    ("network", 2.0): "law + network after 2 s",
}

# What an earlier, independent simulation of the canonical case found: medians of 10 draws of first weights of
# (rms_mm, orbit_mm, peak_rate_mm_s), by disturbance and (compensator, wait_s).
STUDY: dict[tuple[str, tuple[str, float]], tuple[float | None, float | None, float | None]] = {
    ("none", ("none", 0.0)): (0.602, 0.925, 131.3),
    ("none", ("integrator", 0.0)): (0.161, 0.272, None),
    ("none", ("network", 0.0)): (0.147, 0.249, 160.6),
    ("none", ("network", 2.0)): (None, None, 131.3),
    ("constant", ("none", 0.0)): (7.40, 0.925, 141.0),
    ("constant", ("integrator", 0.0)): (0.547, 0.272, None),
    ("constant", ("network", 0.0)): (0.512, 0.246, 169.0),
    ("constant", ("network", 2.0)): (None, None, 141.0),
    ("sine", ("none", 0.0)): (5.10, 7.63, 132.0),
    ("sine", ("integrator", 0.0)): (2.37, 3.49, None),
    ("sine", ("network", 0.0)): (2.17, 3.17, 162.0),
    ("sine", ("network", 2.0)): (None, None, 132.0),
    ("tether", ("none", 0.0)): (5.15, 8.1, 129.0),
    ("tether", ("integrator", 0.0)): (3.17, 6.0, None),
    ("tether", ("network", 0.0)): (3.04, 5.7, 159.0),
    ("tether", ("network", 2.0)): (None, None, 129.0),
    ("current", ("none", 0.0)): (8.22, 5.7, 124.0),
    ("current", ("integrator", 0.0)): (2.54, 2.8, None),
    ("current", ("network", 0.0)): (2.29, 2.5, 152.0),
    ("current", ("network", 2.0)): (None, None, 124.0),
}


@dataclass(frozen=True, slots=True)
class PaperRow:
    """A case and what came of it."""

    case: PaperCase
    figures: Figures

    def record(self) -> dict[str, Any]:
        """Return the flat record that paper.json holds."""
        record = asdict(self.case) | asdict(self.figures)
        del record["delay_ms"]
        return record


class Rows(list[PaperRow]):
    """All rows, and medians over those that match."""

    def values(self, figure: str, **where: Any) -> list[float]:
        """Return one figure of the rows whose case matches `where`, by seed.

        What `where` leaves open is as in the paper: derived law, mismatch only, no wait, canonical corner.
        """
        corner = {"mass_ratio": CANONICAL[0], "damping_ratio": CANONICAL[1]}
        wanted = {"law": "derived", "disturbance": "none", "wait_s": 0.0} | corner | where
        described, wanted_values = attrgetter(*wanted), tuple(wanted.values())
        return [getattr(row.figures, figure) for row in self if described(row.case) == wanted_values]

    def median(self, figure: str, **where: Any) -> float:
        """Return the median over seeds."""
        return median(self.values(figure, **where))

    def typical_seed(self) -> int:
        """Return the seed whose network comes closest to the medians: the one to draw."""
        network = {"compensator": "network"}
        figures = ("rms_mm", "orbit_mm", "peak_rate_mm_s")

        def distance(seed: int) -> float:
            return sum(
                abs(self.median(figure, **network, seed=seed) / self.median(figure, **network) - 1.0)
                for figure in figures
            )

        return min(sorted({row.case.seed for row in self}), key=distance)


@dataclass(frozen=True, slots=True)
class Claim:
    """Something that must come out: its value lies within low … high."""

    text: str
    value: float
    low: float = 0.0
    high: float = inf

    @property
    def held(self) -> bool:
        """Whether it came out."""
        return self.low <= self.value <= self.high

    @property
    def wanted(self) -> str:
        """The bound in words."""
        if self.low == 0.0:
            return f"≤ {self.high:g}"
        return f"≥ {self.low:g}" if self.high == inf else f"{self.low:g} … {self.high:g}"


def claims(rows: Rows) -> list[Claim]:
    """Return what must come out of the canonical case, mismatch only."""

    def ratio(figure: str, over: str = "none", compensator: str = "network", wait_s: float = 0.0) -> float:
        value = rows.median(figure, compensator=compensator, wait_s=wait_s)
        return value / rows.median(figure, compensator=over)

    return [
        Claim("RMS of e without network (mm)", rows.median("rms_mm", compensator="none"), 0.592, 0.612),
        Claim("smaller error: RMS with / without network", ratio("rms_mm"), high=0.30),
        Claim("smaller orbit: with / without network", ratio("orbit_mm"), high=0.35),
        Claim("larger overshoot: largest −ė with / without", ratio("peak_rate_mm_s"), low=1.1),
        Claim(
            "none after 2 s wait: largest −ė with / without", ratio("peak_rate_mm_s", wait_s=2.0), 0.99, 1.01
        ),
        Claim(
            "nearly an integrator: RMS integrator / network",
            ratio("rms_mm", "network", "integrator"),
            0.85,
            1.15,
        ),
    ]
