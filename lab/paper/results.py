"""What the paper's cases come to: medians over the seeds, and what must come out of them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf
from statistics import median

from lab.paper.simulation import COMPENSATORS, DISTURBANCES, SEEDS, Figures, PaperCase

Results = Mapping[PaperCase, Figures]

LAW = PaperCase()
INTEGRATOR = PaperCase(compensator="integrator")
NETWORK = PaperCase(compensator="network")
LATE = PaperCase(compensator="network", wait_s=2.0)
EXACT = PaperCase(mass_ratio=1.0, damping_ratio=1.0)
"""Beside the table: a model that is right."""

NAMES = {("none", 0.0): "law", ("integrator", 0.0): "integrator", ("network", 0.0): "network"} | {
    ("network", 2.0): "network after 2 s"
}

KNOWN_FIGURES = ("rms_mm", "orbit_mm", "peak_rate_mm_s")
KNOWN: dict[tuple[str, tuple[str, float]], tuple[float | None, float | None, float | None]] = {
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
"""KNOWN_FIGURES that an earlier, independent simulation found, by disturbance and (compensator, wait_s)."""


@dataclass(frozen=True, slots=True)
class Check:
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


def middle(results: Results, figure: str, case: PaperCase) -> float:
    """Return the median of a figure over the seeds of a case."""
    return float(median(getattr(results[replace(case, seed=seed)], figure) for seed in SEEDS))


def checks(results: Results) -> list[Check]:
    """Return what must come out: the paper's claims, the two forms of the law, the known table."""

    def ratio(figure: str, case: PaperCase, over: PaperCase = LAW) -> float:
        return middle(results, figure, case) / middle(results, figure, over)

    printed, late_printed = replace(LAW, law="printed"), replace(LATE, law="printed")
    return [
        Check("smaller error: RMS, network / law", ratio("rms_mm", NETWORK), high=0.30),
        Check("smaller orbit: network / law", ratio("orbit_mm", NETWORK), high=0.35),
        Check("larger overshoot: largest −ė, network / law", ratio("peak_rate_mm_s", NETWORK), low=1.1),
        Check("none after a wait of 2 s: the same", ratio("peak_rate_mm_s", LATE), 0.99, 1.01),
        Check("as good: RMS, integrator / network", ratio("rms_mm", INTEGRATOR, NETWORK), 0.85, 1.15),
        Check("no limit cycle: orbit with the right model, mm", results[EXACT].orbit_mm, high=0.03),
        Check("−κε as printed: RMS of the law, mm", middle(results, "rms_mm", printed), 6.68, 6.82),
        Check(
            "−κε: the wait does not help, largest −ė / law",
            ratio("peak_rate_mm_s", late_printed, printed),
            low=1.5,
        ),
        *_compared(results),
    ]


def _compared(results: Results) -> Iterator[Check]:
    """Give the largest deviation from the known figures; but for the tether, whose pull is drawn anew."""
    for water in DISTURBANCES:
        if water != "tether":
            apart = [
                abs(middle(results, name, PaperCase(water, "derived", *kind)) / known - 1.0)
                for kind in COMPENSATORS
                for name, known in zip(KNOWN_FIGURES, KNOWN[(water, kind)], strict=True)
                if known is not None
            ]
            yield Check(f"{water}: deviation from the known figures", max(apart), high=0.02)
