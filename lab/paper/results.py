"""What the paper's cases come to: medians over the seeds, and what must come out of them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from statistics import median

from lab.paper.simulation import SEEDS, PaperCase, PaperFigures

Results = Mapping[PaperCase, PaperFigures]

LAW = PaperCase()
INTEGRATOR = PaperCase(compensator="integrator")
NETWORK = PaperCase(compensator="network")
LATE = PaperCase(compensator="network", wait_s=2.0)
EXACT = PaperCase(mass_ratio=1.0, damping_ratio=1.0)
"""Beside the table: a model that is right."""

NAMES = {("none", 0.0): "law", ("integrator", 0.0): "integrator", ("network", 0.0): "network"} | {
    ("network", 2.0): "network after 2 s"
}


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
    """Return what must come out: the paper's claims, and the two forms of the law."""

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
    ]
