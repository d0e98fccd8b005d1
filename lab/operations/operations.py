"""`holdfast bench process`, `zenoh`, `fleet`, `soak`, `dashboard`: measurements of processes in real time."""

import argparse
import json
import shlex
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any, ClassVar, NamedTuple

from rich.console import Console, RenderableType

from companion.config import load_config
from holdfast import RefusedError
from lab.demo.crew import ChildError
from lab.operations.bounds import Bound, latency, process, virtual
from lab.operations.dashboard_cost import dashboard_cost
from lab.operations.many_vehicles import measure, table
from lab.operations.soak import soak
from lab.operations.subscribers import ROUNDS, NoReaderError, subscriber_bounds
from lab.options import add_out, add_settings, positive
from lab.study import Row, Study, parser_of, ruled, run
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import load_config as load_plant


class Measurement(NamedTuple):
    """One measurement: what is measured, with how many vehicles."""

    what: str
    vehicles: int = 1


class Operations(Study[Measurement]):
    """Measurements one after the other, in the command's own process: two at once would measure each other.

    A row has each figure by its name; its `trace` are the bounds, for the table and the JSON file.
    """

    unit = "measurements"
    rows_key = "measurements"
    parts: ClassVar[tuple[Measurement, ...]]

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add --out."""
        add_out(parser, "out/bench")

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Raise RefusedError for another machine."""
        if arguments.scheduler is not None:
            raise RefusedError("--scheduler: it measures this machine")
        self.arguments = arguments

    def cases(self) -> Sequence[Measurement]:
        """Return the measurements."""
        return self.parts

    def groups(self, cases: Sequence[Measurement]) -> Sequence[Sequence[Measurement]]:
        """Measure in one group, which is not handed to another process."""
        return [cases]

    def dive(self, cases: Sequence[Measurement]) -> Iterator[Row]:
        """Measure; `error` says why a measurement has no figures."""
        for case in cases:
            try:
                bounds, error = self.measured(case), ""
            except (ChildError, NoReaderError) as raised:
                bounds, error = [], str(raised)
            judged = [asdict(bound) | {"held": bound.held} for bound in bounds]
            yield {"error": error, **{bound.name: bound.value for bound in bounds}, "trace": judged}

    @abstractmethod
    def measured(self, case: Measurement) -> list[Bound]:
        """Measure one case."""

    def tables(self, rows: Sequence[Row]) -> Iterable[RenderableType]:
        """Lay out the figures beside their bounds."""
        shown = ruled("The process", "figure", "measured", "bound", "held")
        for bound in bounds_of(rows):
            limit = "" if bound.limit is None else f"≤ {bound.limit:.3g} {bound.unit}"
            limit = limit if bound.at_least is None else f"≥ {bound.at_least:.3g} {bound.unit}"
            held = "" if not limit else "yes" if bound.held else "NO"
            value = f"{bound.value:{'.3g' if abs(bound.value) < 1000.0 else '.0f'}}"
            shown.add_row(bound.name, f"{value} {bound.unit}", limit, held)
        return [shown, *(f"no figures: {row['error']}" for row in rows if row["error"])]

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a bound was not held, or nothing could be measured."""
        return any(row["error"] for row in rows) or not all(bound.held for bound in bounds_of(rows))

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return every figure with its bound."""
        return {"bounds": [bound for row in rows for bound in row["trace"]]}


def bounds_of(rows: Sequence[Row]) -> list[Bound]:
    """Return the figures of all rows."""
    return [
        Bound(**{key: value for key, value in bound.items() if key != "held"})
        for row in rows
        for bound in row["trace"]
    ]


class Process(Operations):
    """Memory, tick, lateness, start, and the way through the process."""

    command = "bench process"
    about = "Measures the process against its limits: memory, computing time of a tick, lateness, start-up."
    parts = (Measurement("virtual time"), Measurement("process"), Measurement("latency"))

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add --set, which concerns the dive in virtual time."""
        super().options(parser)
        add_settings(parser)

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Read the configuration of the dive in virtual time."""
        super().__init__(arguments)
        self.config = load_config(overrides=arguments.set)

    def measured(self, case: Measurement) -> list[Bound]:
        """Measure one of the parts."""
        if case.what == "virtual time":
            bounds = virtual(self.config, load_plant(DEFAULT_CONFIG))
        else:
            bounds = process() if case.what == "process" else latency()
        self.advance(1)
        return bounds


class AfterDives(Process):
    """The same after `holdfast bench`'s dives, whose JSON file it completes."""

    command = "bench"

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Measure here, whatever machines dived."""
        arguments.scheduler = arguments.table = None
        super().__init__(arguments)

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return the figures beside what the dives left."""
        path = self.arguments.json
        return (json.loads(path.read_text(encoding="utf-8")) if path else {}) | super().summary(rows)


class Subscribers(Operations):
    """Slow, stopped and killed subscribers."""

    command = "bench zenoh"
    about = "Measures what slow, stopped and killed subscribers cost the tick; six minutes."
    parts = (Measurement("subscribers"),)
    steps = ROUNDS

    def measured(self, case: Measurement) -> list[Bound]:
        """Measure all rounds."""
        return subscriber_bounds(lambda: self.advance(1))


class Fleet(Operations):
    """One vehicle at a router with TLS, then many."""

    command = "bench fleet"
    about = "Measures many vehicles at one router with TLS beside a single one; two minutes."

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add --vehicles."""
        super().options(parser)
        parser.add_argument(
            "--vehicles", type=positive, default=20, metavar="N", help="of the fleet; default %(default)s"
        )

    def cases(self) -> Sequence[Measurement]:
        """Return one vehicle and all."""
        return [Measurement("fleet", count) for count in dict.fromkeys((1, self.arguments.vehicles))]

    def measured(self, case: Measurement) -> list[Bound]:
        """Measure so many."""
        bounds = measure(case.vehicles)
        self.advance(1)
        return bounds

    def tables(self, rows: Sequence[Row]) -> Iterable[RenderableType]:
        """Lay out a column for each number of vehicles."""
        if any(row["error"] for row in rows):
            return [f"no figures: {row['error']}" for row in rows if row["error"]]
        return [table([(row["vehicles"], bounds_of([row])) for row in rows])]


class Soak(Operations):
    """Everything live for hours."""

    command = "bench soak"
    about = "Runs everything live for hours, and measures memory, lateness and lost records."
    parts = (Measurement("soak"),)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add --minutes."""
        super().options(parser)
        parser.add_argument(
            "--minutes", type=positive, default=120, metavar="MIN", help="of the soak; default %(default)s"
        )

    def __init__(self, arguments: argparse.Namespace) -> None:
        """Take a step of progress a minute."""
        super().__init__(arguments)
        self.steps = arguments.minutes

    def measured(self, case: Measurement) -> list[Bound]:
        """Measure for so long; the figures until then are printed each minute."""
        return soak(self.arguments.minutes, lambda: self.advance(1))


class Dashboard(Operations):
    """The dashboard's server, and its page in Chromium."""

    command = "bench dashboard"
    about = "Measures what the dashboard's server takes for each browser, and its page in Chromium."
    parts = (Measurement("dashboard"),)

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        """Add --seconds."""
        super().options(parser)
        parser.add_argument(
            "--seconds", type=positive, default=10, metavar="S", help="of each turn; default %(default)s"
        )

    def measured(self, case: Measurement) -> list[Bound]:
        """Measure all turns."""
        return dashboard_cost(self.arguments.seconds)


def after_dives(argv: Sequence[str]) -> int:
    """Measure the process after `holdfast bench` dived with these options; return the exit status."""
    arguments, _ = parser_of(AfterDives).parse_known_args(argv)
    arguments.command = shlex.join(("holdfast", "bench", *argv))
    return run(AfterDives(arguments), arguments, Console())
