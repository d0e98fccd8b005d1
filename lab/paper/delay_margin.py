"""How late a command may come before the paper's loop loses its proof: the delay margin, measured.

`python -m lab.paper.delay_margin` prints the table of docs/theory.md, in ten seconds. Each dive is that of
`lab.paper.simulation`, from e(0) = 0.1 m without disturbance, but every command acts `delay_ms` late.
Beside it, for a vehicle at rest, what the linear loop says: phase margin over crossover, less half a tick
for the hold.

    L(s) = (m̂ ((λ + κ) s + λκ) + k (s + λ)/s) / (m s²)
"""

import sys
from math import pi

import numpy as np

from lab.paper.simulation import INTEGRAL_GAIN, KAPPA, LAM, MASS_KG, TICK_MS, PaperCase, dive

DELAYS_MS = range(100, 261, 5)
SEEDS = range(5)
MASS_RATIOS = (0.9, 1.0, 1.1)
GROWN = 2.0  # an orbit this many times that of 0 ms is no longer the reference's


def linear_ms(mass_ratio: float, k: float) -> float:
    """Return the delay (ms) that a vehicle at rest tolerates by its phase margin; `k`: the integral gain."""
    omega = np.logspace(-1.0, 2.0, 100_001)
    s = 1j * omega
    m_hat = mass_ratio * MASS_KG
    loop = (m_hat * ((LAM + KAPPA) * s + LAM * KAPPA) + k * (s + LAM) / s) / (MASS_KG * s**2)
    crossover = int(np.flatnonzero(np.abs(loop) > 1.0)[-1])
    margin = (np.angle(loop[crossover]) + pi) % (2.0 * pi)
    return float(1000.0 * margin / omega[crossover] - TICK_MS / 2.0)


def measure() -> dict[tuple[str, float], int]:
    """Return the largest delay (ms) with which the orbit stays, for each compensator and m̂/m.

    A network's is that of the worst of five draws of first weights.
    """
    kinds = [("none", 0), ("integrator", 0), *(("network", seed) for seed in SEEDS)]
    cases = [
        PaperCase("none", "derived", compensator, mass_ratio, 0.9, seed, 0.0, delay_ms)
        for compensator, seed in kinds
        for mass_ratio in MASS_RATIOS
        for delay_ms in (0, *DELAYS_MS)
    ]
    with np.errstate(over="ignore", invalid="ignore"):  # what diverges may
        figures = dive(cases).figures
    orbit = {
        (case.compensator, case.seed, case.mass_ratio, case.delay_ms): found.orbit_mm
        for case, found in zip(cases, figures, strict=True)
    }
    margins: dict[tuple[str, float], int] = {}
    for compensator, seed in kinds:
        for mass_ratio in MASS_RATIOS:
            start = orbit[(compensator, seed, mass_ratio, 0)]
            borne = 0
            for delay_ms in DELAYS_MS:
                if not orbit[(compensator, seed, mass_ratio, delay_ms)] <= GROWN * start:
                    break
                borne = delay_ms
            key = (compensator, mass_ratio)
            margins[key] = min(borne, margins.get(key, borne))
    return margins


def main() -> None:
    """Print the table."""
    margins = measure()
    lines = [f"delay margin, ms: measured to {DELAYS_MS.step} ms (a vehicle at rest, linear)"]
    lines.append("              " + "".join(f"m̂/m {ratio:<11}" for ratio in MASS_RATIOS))
    for compensator, k in (("none", 0.0), ("integrator", INTEGRAL_GAIN), ("network", INTEGRAL_GAIN)):
        cells = (f"{margins[(compensator, ratio)]} ({linear_ms(ratio, k):.0f})" for ratio in MASS_RATIOS)
        lines.append(f"{compensator:<14}" + "".join(f"{cell:<15}" for cell in cells))
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
