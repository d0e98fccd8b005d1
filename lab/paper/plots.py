"""The paper's four figures. Okabe-Ito colours, one line style each."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from lab.paper.results import LATE, LAW, NETWORK, Results, middle
from lab.paper.simulation import PERIOD_S, SEEDS, TICK_MS, Trace, dive
from lab.style import BLACK, BLUE, GREEN, PRINTED, SKY, VERMILLION

LOOKS: dict[str, dict[str, Any]] = {
    "law": {"color": BLACK, "linestyle": "-"},
    "network": {"color": BLUE, "linestyle": "-"},
    "network after 2 s": {"color": VERMILLION, "linestyle": "-"},
    "desired": {"color": GREEN, "linestyle": "--"},
}
WIDE = (8.6, 3.3)


def draw(folder: Path, results: Results) -> None:
    """Write figure1.png … figure4.png into `folder`; the network drawn is the one nearest to the medians."""
    folder.mkdir(parents=True, exist_ok=True)
    seed = _typical_seed(results)
    network, late = (dive(replace(case, seed=seed)) for case in (NETWORK, LATE))
    law, others = dive(LAW), [dive(replace(NETWORK, seed=other))[0] for other in SEEDS]
    with plt.rc_context(PRINTED):
        figures = (
            _tracking(law[0], network[0], others),
            _portrait(network[1], "network"),
            _portrait(law[1], "law"),
            _portrait(late[1], "network after 2 s"),
        )
        for number, figure in enumerate(figures, start=1):
            figure.savefig(folder / f"figure{number}.png")
            plt.close(figure)


def _typical_seed(results: Results) -> int:
    medians = {name: middle(results, name, NETWORK) for name in ("rms_mm", "orbit_mm", "peak_rate_mm_s")}

    def distance(seed: int) -> float:
        found = results[replace(NETWORK, seed=seed)]
        return float(sum(abs(getattr(found, name) / value - 1.0) for name, value in medians.items()))

    return min(SEEDS, key=distance)


def _tracking(law: Trace, network: Trace, others: Sequence[Trace]) -> Figure:
    figure, (error, thrust) = plt.subplots(1, 2, figsize=WIDE)
    error.plot(law.t_s, 1000.0 * law.e, **LOOKS["law"], label="without network")
    for trace in others:
        error.plot(trace.t_s, 1000.0 * trace.e, color=SKY, linewidth=0.5, alpha=0.7)
    error.plot(network.t_s, 1000.0 * network.e, **LOOKS["network"], label="with network")
    error.plot([], [], color=SKY, linewidth=0.8, label="other first weights")
    error.set(xlabel="time (s)", ylabel="tracking error e (mm)", title="(a) Tracking error", ylim=(-1.1, 1.9))
    error.legend(loc="upper right", ncols=2, fontsize=8)
    thrust.plot(law.t_s, law.tau, **LOOKS["law"], label="without network")
    thrust.plot(network.t_s, network.tau, **(LOOKS["network"] | {"linestyle": "--"}), label="with network")
    thrust.set(xlabel="time (s)", ylabel="thrust u (N)", title="(b) Thrust", ylim=(-8.0, 10.0))
    thrust.legend(loc="upper center", ncols=2, fontsize=8)
    return figure


def _portrait(trace: Trace, look: str) -> Figure:
    figure, (path, phase) = plt.subplots(1, 2, figsize=WIDE)
    first = slice(PERIOD_S * 1000 // TICK_MS)
    path.plot(trace.t_s[first], (trace.z_d + trace.e)[first], **LOOKS[look], label=f"depth z, {look}")
    path.plot(trace.t_s[first], trace.z_d[first], **LOOKS["desired"], label="desired z_d")
    path.set(xlabel="time (s)", ylabel="depth (m)", title="(a) Trajectory, the first 20 s", ylim=(1.05, -0.2))
    path.set_xticks(range(0, PERIOD_S + 1, 5))
    path.legend(loc="upper center", ncols=2, fontsize=8)
    phase.plot(1000.0 * trace.e, 1000.0 * trace.e_dot, **LOOKS[look])
    phase.plot(1000.0 * trace.e[0], 1000.0 * trace.e_dot[0], "o", color=LOOKS[look]["color"], markersize=4)
    lowest = int(np.argmin(trace.e_dot))
    phase.annotate(
        f"largest −ė: {-1000.0 * trace.e_dot[lowest]:.1f} mm/s",
        (1000.0 * trace.e[lowest], 1000.0 * trace.e_dot[lowest]),
        xytext=(-12.0, -172.0),
        arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6},
        fontsize=8,
    )
    phase.set(
        xlabel="error e (mm)",
        ylabel="error's rate ė (mm/s)",
        title="(b) Phase portrait of the error",
        xlim=(-15, 110),
        ylim=(-185, 150),
    )
    orbit = phase.inset_axes((0.5, 0.62, 0.34, 0.3))
    last = slice(-PERIOD_S * 1000 // TICK_MS, None)
    orbit.plot(1000.0 * trace.e[last], 1000.0 * trace.e_dot[last], **LOOKS[look])
    orbit.set(xlim=(-1.1, 1.1), ylim=(-0.8, 0.8))
    orbit.set_title("the last 20 s: the orbit", fontsize=7)
    orbit.tick_params(labelsize=6)
    return figure
