"""`holdfast lab bench prediction`: what the network's prediction of the disturbance is worth.

Each vehicle runs in each sea with d̂ as the observer has it, and as the network predicts it.
"""

import argparse
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import pyplot as plt

from companion.config import AxisSection, load_config
from companion.records import Z
from lab import style
from lab.loop.dive import engaging, recorded
from lab.loop.lockstep import Step
from lab.options import add_bench
from lab.studies.reality import COUNTS_S, ENDS_S, SCENARIOS
from lab.study import Row, Study, by, known

COMPENSATORS = ("observer", "network+observer")
AXES = ("surge", "sway", "heave", "yaw")
FIRST_SEED = 9501
SHOWN_S = (60.0, 75.0)
FIGURES = {"depth_sd_mm": "depth SD, mm", "believed_rms_mm": "place without the DVL's drift, mm"}


class PredictedDive(NamedTuple):
    """One dive."""

    water: str
    compensator: str
    seed: int


class Prediction(Study[PredictedDive]):
    """Every scenario of `bench reality` with and without the prediction."""

    command = "lab bench prediction"
    about = "Compares d̂ as the observer has it with d̂ as the network predicts it. A row is a compensator."

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        add_bench(parser, " ".join(COMPENSATORS), ", ".join(SCENARIOS))
        waters = ["delay-waves", "tank-waves-late", "osl-waves", "osl-place", "rough"]
        parser.set_defaults(seeds=6, rows=[*COMPENSATORS], scenarios=waters)

    def __init__(self, arguments: argparse.Namespace) -> None:
        known(arguments.scenarios, SCENARIOS, "scenario")
        self._cases = [
            PredictedDive(*each)
            for each in product(
                arguments.scenarios, arguments.rows, range(FIRST_SEED, FIRST_SEED + arguments.seeds)
            )
        ]
        self._firmware: Path | None = arguments.firmware
        self._set: Sequence[str] = arguments.set

    def cases(self) -> Sequence[PredictedDive]:
        return self._cases

    def dive(self, cases: Sequence[PredictedDive]) -> Iterator[Row]:
        for case in cases:
            there = SCENARIOS[case.water](case.seed)
            chosen = [f'{axis}.compensator="{case.compensator}"' for axis in AXES]
            config = load_config(overrides=[*chosen, *self._set])
            start = there.target(0.0)
            with engaging(
                config, there.plant, start, case.seed, there.link, self._firmware, surveyed=True
            ) as loop:
                steps = list(loop.run(ENDS_S, there.target))
            figures = recorded(steps).within(COUNTS_S, np.inf).figures()
            row = {key: figures[key] for key in FIGURES}
            if not there.plant.sensors.dvl:
                row["believed_rms_mm"] = np.nan
            yield row | {"trace": _trace(steps, config.heave)}

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        lines = []
        for (water,), some in by(rows, "water").items():
            means = {
                key: [np.mean([row[key] for row in each]) for each in by(some, "compensator").values()]
                for key in FIGURES
            }
            lines.append([water, *(" → ".join(f"{mean:.1f}" for mean in means[key]) for key in FIGURES)])
        return {"columns": [" → ".join(COMPENSATORS), *FIGURES.values()], "rows": lines}

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        with plt.rc_context(style.PRINTED):
            figure, panel = plt.subplots(figsize=(9.0, 3.4))
        last = rows[-1]["compensator"]
        trace = next(row["trace"] for row in rows if row["compensator"] == last)
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
