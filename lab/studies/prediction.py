"""`holdfast lab bench prediction`: what the network's prediction of the disturbance is worth.

Each vehicle runs in each sea with d̂ as the observer has it, and as the network predicts it.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from companion.config import AxisSection
from companion.records import Z
from lab import style
from lab.loop.lockstep import Step
from lab.options import add_bench
from lab.studies.reality import SCENARIOS, RealDive, Reality
from lab.study import Row, by

COMPENSATORS = ("observer", "predictor")
SHOWN_S = (60.0, 75.0)
FIGURES = {"depth_sd_mm": "depth SD, mm", "believed_rms_mm": "place without the DVL's drift, mm"}


class Prediction(Reality):
    """Scenarios of `bench reality` with and without the prediction."""

    sets = tuple(f"{axis}.compensator" for axis in ("surge", "sway", "heave"))
    first_seed = 9501
    command = "lab bench prediction"
    about = "Compares d̂ as the observer has it with d̂ as the network predicts it. A row is a compensator."

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, " ".join(COMPENSATORS), ", ".join(SCENARIOS))
        waters = ["delay-waves", "tank-waves-late", "osl-waves", "osl-place", "rough"]
        parser.set_defaults(seeds=6, rows=[*COMPENSATORS], scenarios=waters)

    def judged(self, case: RealDive, steps: Sequence[Step]) -> Row:
        return super().judged(case, steps) | {"trace": _trace(steps, self._configs[case.preset].heave)}

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        lines = []
        for (water,), some in by(rows, "water").items():
            means = {
                key: [np.mean([row[key] for row in each]) for each in by(some, "preset").values()]
                for key in FIGURES
            }
            lines.append([water, *(" → ".join(f"{mean:.1f}" for mean in means[key]) for key in FIGURES)])
        return {"columns": [" → ".join(COMPENSATORS), *FIGURES.values()], "rows": lines}

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        with plt.rc_context(style.PRINTED):
            figure, panel = plt.subplots(figsize=(9.0, 3.4))
        last = rows[-1]["preset"]
        trace = next(row["trace"] for row in rows if row["preset"] == last)
        t_s, true, observed, predicted = trace
        panel.plot(t_s, true, color=style.BLACK, label="true disturbance")
        panel.plot(t_s, observed, color=style.ORANGE, label="the observer's, when the thrust acts")
        panel.plot(t_s, predicted, color=style.BLUE, label="the network's prediction for then")
        style.name(panel, "Heave in waves", "d (N)")
        panel.set_xlabel("time since boot (s)")
        panel.set_xlim(SHOWN_S)
        panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=style.SMALL)
        return [style.save(figure, folder / "prediction.png")]


def _trace(steps: Sequence[Step], heave: AxisSection) -> list[list[float]]:
    """Return time, the true d of heave, and what the observer and the law had of it when thrust acts, (4, n).

    The true one is what the nominal model lacks: d = τ − (c₁ w + c₂ w|w|) − m ẇ.
    """
    shown = [step for step in steps if SHOWN_S[0] - 1.0 <= step.t_s < SHOWN_S[1] + 1.0]
    w = np.array([step.truth.nu[Z] for step in shown])
    force = np.array([step.truth.tau[Z] for step in shown])
    w_dot = np.array([step.truth.nu_dot[Z] for step in shown])
    true = force - (heave.linear_damping + heave.quadratic_damping * np.abs(w)) * w - heave.mass * w_dot
    late_s = [step.sample.state.delays.command_s + step.sample.state.model.lag_s[Z] for step in shown]
    t_s = np.array([step.t_s for step in shown])
    acts_s = t_s + np.mean(late_s)
    found = [(step.sample.dofs.d_observer[Z], step.sample.dofs.d_hat[Z]) for step in shown]
    observed, law = (np.interp(t_s, acts_s, values) for values in np.array(found).T)
    return [values.tolist() for values in (t_s, true, observed, law)]
