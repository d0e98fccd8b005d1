"""The paper's four figures and three more, drawn from the dives. Okabe-Ito colours, one line style each."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lab.paper import third_order
from lab.paper.rows import Rows
from lab.paper.simulation import CANONICAL, CORNERS, DISTURBANCES, PERIOD_S, TICK_MS, PaperCase, Trace
from lab.style import BLACK, BLUE, GREEN, ORANGE, PRINTED, SKY, VERMILLION

LOOKS: dict[str, dict[str, Any]] = {
    "law": {"color": BLACK, "linestyle": "-"},
    "integrator": {"color": ORANGE, "linestyle": "--"},
    "network": {"color": BLUE, "linestyle": "-"},
    "network after 2 s": {"color": VERMILLION, "linestyle": "-"},
    "desired": {"color": GREEN, "linestyle": "--"},
}
MARKS = dict(zip(CORNERS, "vs^D", strict=True))
WIDE = (8.6, 3.3)

Traces = dict[PaperCase, tuple[Trace, Trace]]


def canonical(compensator: str, wait_s: float = 0.0, law: str = "derived", seed: int = 0) -> PaperCase:
    """Return a canonical case without disturbance: m̂ = 1.1 m, ĥ = 0.9 h."""
    return PaperCase("none", law, compensator, *CANONICAL, seed, wait_s)


def watched(seeds: Sequence[int]) -> list[PaperCase]:
    """Return the cases that the figures show; of the networks those of all `seeds`."""
    plain = [canonical("none"), canonical("none", law="printed")]
    return [*plain, *(canonical("network", wait_s, seed=seed) for wait_s in (0.0, 2.0) for seed in seeds)]


def draw(folder: Path, traces: Traces, rows: Rows) -> None:
    """Write figure1.png … figure7.png into `folder`."""
    with plt.rc_context(PRINTED):
        seed = rows.typical_seed()
        figures = (
            _tracking(traces, seed),
            _portrait(traces[canonical("network", seed=seed)][1], "network"),
            _portrait(traces[canonical("none")][1], "law"),
            _portrait(traces[canonical("network", 2.0, seed=seed)][1], "network after 2 s"),
            _printed(traces),
            _compared(rows),
            _ball(third_order.converge()),
        )
        for number, figure in enumerate(figures, start=1):
            figure.savefig(folder / f"figure{number}.png")
            plt.close(figure)


def _tracking(traces: Traces, typical: int) -> Figure:
    figure, (error, thrust) = plt.subplots(1, 2, figsize=WIDE)
    law = traces[canonical("none")][0]
    error.plot(law.t_s, 1000.0 * law.e, **LOOKS["law"], label="without network")
    for case, (trace, _) in traces.items():
        if case.compensator != "network" or case.wait_s:
            continue
        error.plot(trace.t_s, 1000.0 * trace.e, color=SKY, linewidth=0.5, alpha=0.7)
    network = traces[canonical("network", seed=typical)][0]
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


def _printed(traces: Traces) -> Figure:
    figure, axes = plt.subplots(1, 2, figsize=WIDE)
    titles = ("(a) From e(0) = 0: the orbit", "(b) From e(0) = 0.1 m: the approach")
    for start, (panel, title) in enumerate(zip(axes, titles, strict=True)):
        for law, color, line, name in (
            ("printed", VERMILLION, "--", "−κε, as printed"),
            ("derived", BLACK, "-", "−m̄κε, as derived"),
        ):
            trace = traces[canonical("none", law=law)][start]
            panel.plot(trace.t_s, 1000.0 * trace.e, color=color, linestyle=line, label=name)
        panel.set(xlabel="time (s)", ylabel="tracking error e (mm)", title=title)
    axes[1].legend(loc="upper right", fontsize=8)
    return figure


def _compared(rows: Rows) -> Figure:
    figure, axes = plt.subplots(figsize=(8.6, 3.6))
    compensators = (("none", "law"), ("integrator", "integrator"), ("network", "network"))
    for place, disturbance in enumerate(DISTURBANCES):
        for shift, (compensator, look) in zip((-0.22, 0.0, 0.22), compensators, strict=True):
            for corner, mark in MARKS.items():
                face = LOOKS[look]["color"] if corner == CANONICAL else "none"
                axes.plot(
                    place + shift + 0.035 * (CORNERS.index(corner) - 1.5),
                    rows.median(
                        "rms_mm",
                        disturbance=disturbance,
                        compensator=compensator,
                        mass_ratio=corner[0],
                        damping_ratio=corner[1],
                    ),
                    mark,
                    color=LOOKS[look]["color"],
                    markerfacecolor=face,
                    markersize=5,
                )
    axes.set_yscale("log")
    ticks = (0.1, 0.2, 0.5, 1, 2, 5, 10)
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks(range(len(DISTURBANCES)), ["mismatch only", *DISTURBANCES[1:]])
    axes.set(ylabel="RMS of e (mm), from e(0) = 0")
    axes.grid(axis="x", visible=False)
    _compared_legends(axes)
    return figure


def _compared_legends(axes: Axes) -> None:
    names = (("law", "law"), ("integrator", "law + integrator"), ("network", "law + network"))
    colors = [axes.plot([], [], "o", color=LOOKS[look]["color"], label=name)[0] for look, name in names]
    corners = [
        axes.plot(
            [],
            [],
            mark,
            color="0.3",
            markerfacecolor="0.3" if corner == CANONICAL else "none",
            label=f"m̂/m {corner[0]}, ĥ/h {corner[1]}",
        )[0]
        for corner, mark in MARKS.items()
    ]
    first = axes.legend(handles=colors, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    axes.add_artist(first)
    axes.legend(handles=corners, loc="lower left", bbox_to_anchor=(1.0, 0.0), fontsize=8)


def _ball(run: third_order.Convergence) -> Figure:
    figure, (path, error) = plt.subplots(1, 2, figsize=WIDE)
    ms = 1000.0 * run.t_s
    path.plot(ms, 1000.0 * (run.x_d[:, None] + run.x_tilde[..., 0]), color=SKY, linewidth=0.8)
    path.plot(ms, 1000.0 * run.x_d, **LOOKS["desired"], label="desired x_d")
    path.plot([], [], color=SKY, label="x, twelve starts")
    path.set(xlabel="time (ms)", ylabel="gap under the magnet (mm)", title="(a) Trajectory", ylim=(6.0, 15.5))
    path.legend(loc="upper right", ncols=2, fontsize=8)
    error.semilogy(ms, np.abs(run.eps / run.eps[0]), color=SKY, linewidth=2.5, alpha=0.8)
    error.semilogy(ms, np.abs(run.x_tilde[..., 0] / run.x_tilde[0, :, 0]), color="0.55", linewidth=0.5)
    error.semilogy(
        ms, np.exp(-third_order.KAPPA * run.t_s), color=BLACK, linestyle="--", label="theorem: exp(−κt)"
    )
    error.plot([], [], color=SKY, linewidth=2.5, label="|ε|/|ε(0)|")
    error.plot([], [], color="0.55", linewidth=0.7, label="|x̃|/|x̃(0)|")
    error.set(xlabel="time (ms)", ylabel="relative to the start", title="(b) Convergence", ylim=(1e-6, 30.0))
    error.legend(loc="lower left", fontsize=8)
    return figure
