"""A dive for other programs: its figures as records, and every number of every tick as columns."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from lab.report.figures import AXIS_OF, DiveFigures, error
from lab.report.log import Columns, Log

SAME_TICK_S = 1e-3
"""Samples of one tick have one time."""

ANGLES = ("heading", "heading_desired", "roll", "pitch")


def as_json(log: Log, figures: DiveFigures, advice: list[str]) -> dict[str, Any]:
    """Return all figures of the dive; NaN where it has none."""
    about = {"vehicle": log.vehicle, "began_utc_ns": log.began_ns, "duration_s": log.duration_s}
    return about | asdict(figures) | {"advice": advice, "notes": log.notes}


def held_records(log: Log, figures: DiveFigures) -> list[dict[str, Any]]:
    """Return a flat record for each engaged interval and degree of freedom that was held in it."""
    return [
        {
            "vehicle": log.vehicle,
            "phase": phase.number,
            "begin_s": phase.begin_s,
            "end_s": phase.end_s,
            "ended": phase.ended,
            "axis": AXIS_OF[held.dof],
            "error_unit": held.unit,
            "thrust_unit": held.thrust_unit,
        }
        | asdict(held)
        for phase in figures.phases
        for held in phase.held
    ]


def ticks(log: Log) -> dict[str, Any]:
    """Return columns with a row for each tick: `at_s` since the recording began, then KEY/FIELD.

    `supervisor/state` is text; the rest are numbers, NaN where a sample is missing or its field was absent.
    Angles are there in degrees too, as degrees/heading and so on.
    """
    state = log.keys["state"]
    at_s = state.at_s
    columns: dict[str, Any] = {"at_s": at_s, "supervisor/state": list(_states(log))}
    for angle in ANGLES:
        columns[f"degrees/{angle}"] = np.degrees(state[f"{angle}_rad"])
    columns["degrees/heading_error"] = error(state, "psi")
    for key, samples in log.keys.items():
        rows, there = _matching(samples, state)
        for name, values in samples.of.items():
            columns[f"{key}/{name}"] = np.where(there, values[rows], np.nan)
    if log.truth is not None:
        for name in log.truth.of:
            columns[f"truth/{name}"] = log.truth.at(name, at_s)
    return columns


def _matching(samples: Columns, state: Columns) -> tuple[Any, Any]:
    """Return the row of `samples` for each row of `state`, and whether it is of the same tick."""
    after = np.clip(np.searchsorted(samples.at_s, state.at_s - SAME_TICK_S), 0, samples.at_s.size - 1)
    return after, np.abs(samples.at_s[after] - state.at_s) < SAME_TICK_S


def _states(log: Log) -> Iterator[str]:
    spans = iter(log.spans)
    span = next(spans)
    for at_s in log.keys["state"].at_s:
        while at_s > span.end_s and (later := next(spans, None)) is not None:
            span = later
        yield span.state if span.begin_s <= at_s <= span.end_s else ""
