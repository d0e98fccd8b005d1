"""`holdfast campaign`: thousands of dives, each with a vehicle, a link and a sea drawn from its number.

A dive's number is its seed: number 4711 is the same dive on any machine and in any batch.
Published sets of the vehicle are varied beyond what was measured; `ENVELOPE` says where every dive must hold.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from msgspec.structs import replace
from rich.console import RenderableType

from companion.config import Config
from companion.config import load_config as load_companion
from companion.records import Array
from lab.batch.stand_in import ENGAGED_S, Links, Rows
from lab.loop import dive as full_loop
from lab.loop.lockstep import LinkDelay
from lab.loop.scenarios import SETTLE_S, Scenario, ensemble, hold
from lab.options import add_out, add_settings, not_negative, positive
from lab.study import Row, Study, by, ruled
from lab.style import BLACK, BLUE, ORANGE, PRINTED, SKY, VERMILLION, save
from sim_bridge.commands import DEFAULT_CONFIG
from sim_bridge.config import SimConfig, load_config

HEAVY, BLUEROV2, ENSEMBLE = "heavy", "bluerov2", "ensemble"
VEHICLES = (HEAVY, BLUEROV2, ENSEMBLE)
DISTURBANCES = ("calm", "waves", "tether", "load", "current", "all")
SINCE_S, DURATION_S = SETTLE_S, SETTLE_S + 40.0
"""Since boot: from when on figures count, and when a dive ends."""

BATCH = 1000
"""Dives at once at most: fewer cost more of the interpreter's time, more leave workers idle at the end."""

WORST = 3
"""Dives that are named and drawn, inside the envelope and outside."""

OF = ("depth_rms_mm", "place_rms_mm")
RANK = {"lost": 2, "strays": 1, "held": 0}
LOOKS = {"held": (SKY, "."), "strays": (ORANGE, "^"), "lost": (VERMILLION, "x")}

HELD_TAIL_MM, HELD_PEAK_MM, HELD_TILT_DEG = 100.0, 500.0, 60.0
"""A dive held if its depth RMS of the last ten seconds, its depth's peak and its tilt stayed below these. Its
place is told, not judged: with a dead thruster a current may be stronger than those that are left."""

ENVELOPE = (
    "every published set of the vehicle; damping 0.5 to 1.5 and mass 1 to 1.3 times the set's",
    "thrust 0.7 to 1.1 times the measured curve; a link of 20 to 150 ms, which the companion measures",
    "waves Hs 0.2 to 0.4 m, a tether of σ 1 to 4 N, a load of 5 to 20 N, a current of 0.1 to 0.5 m/s, or all",
    "any one horizontal thruster dead; a vertical one only in calm water or a current, or of eight at a "
    "tether: a load or waves may turn the vehicle over before the dead one is found",
    "on the six-thruster BlueROV2 one disturbance at a time: all at once, one dive in fifty or so turned it "
    "over, for it has only 2 N·m to right it",
)
"""Where every dive must hold; `CampaignCase.inside` says the same."""


class CampaignCase(NamedTuple):
    """One dive. Factors multiply what the set says; `delay_ms` is the link's, both ways together, each half.

    `dead` is the number of a thruster that does not push, or 0. Disturbances are zero where there is none:
    significant height (m) and peak period (s) of the waves, σ (N) of the tether, weight (N) of the load,
    speed (m/s) and direction (°) of the current.
    """

    number: int
    vehicle: str
    disturbance: str
    damping: float
    mass: float
    thrust: float
    delay_ms: float
    dead: int
    wave_height_m: float
    wave_period_s: float
    tether_n: float
    load_n: float
    current_m_s: float
    current_deg: float

    @property
    def dead_vertical(self) -> bool:
        """Whether it is a vertical thruster that is dead."""
        return self.dead > 4

    @property
    def inside(self) -> bool:
        """Whether the dive lies within ENVELOPE."""
        weak = ("calm", "current") if self.vehicle == BLUEROV2 else ("calm", "current", "tether")
        if self.dead_vertical and self.disturbance not in weak:
            return False
        return not (self.vehicle == BLUEROV2 and self.disturbance == "all")

    def __str__(self) -> str:
        """Say it in a line."""
        dead = f", thruster {self.dead} dead" if self.dead else ""
        return (
            f"{self.number}: {self.vehicle}, {self.disturbance}, damping ×{self.damping:.2f}, mass "
            f"×{self.mass:.2f}, thrust ×{self.thrust:.2f}, {self.delay_ms:.0f} ms{dead}"
        )


def case(number: int) -> CampaignCase:
    """Draw the dive of this number: vehicles and disturbances in turn, the rest uniform."""
    draw = np.random.default_rng((number, 4)).uniform
    vehicle = VEHICLES[number % 3]
    disturbance = DISTURBANCES[number // 3 % 6]
    motors = 6 if vehicle == BLUEROV2 else 8
    damping, mass, thrust, delay_ms = draw(0.5, 1.5), draw(1.0, 1.3), draw(0.7, 1.1), draw(20.0, 150.0)
    dead = int(draw(1.0, motors + 1.0)) if draw(0.0, 1.0) < 0.5 else 0
    height_m, period_s, tether_n = draw(0.2, 0.4), draw(3.5, 5.0), draw(1.0, 4.0)
    load_n, current_m_s, current_deg = draw(5.0, 20.0), draw(0.1, 0.5), draw(0.0, 360.0)

    def there(name: str) -> bool:
        return disturbance in (name, "all")

    return CampaignCase(
        number=number,
        vehicle=vehicle,
        disturbance=disturbance,
        damping=round(damping, 4),
        mass=round(mass, 4),
        thrust=round(thrust, 4),
        delay_ms=round(delay_ms, 1),
        dead=dead,
        wave_height_m=round(height_m, 3) * there("waves"),
        wave_period_s=round(period_s, 3) * there("waves"),
        tether_n=round(tether_n, 2) * there("tether"),
        load_n=round(load_n, 2) * there("load"),
        current_m_s=round(current_m_s, 3) * there("current"),
        current_deg=round(current_deg, 1) * there("current"),
    )


def plant(case: CampaignCase) -> SimConfig:
    """Build the dive's vehicle and water."""
    base = _base(case.vehicle)
    if case.vehicle == ENSEMBLE:
        base = ensemble(base, case.number)
    hull, thrusters = base.hull, base.thrusters
    gain = [case.thrust] * (6 if thrusters.frame == "vectored" else 8)
    if case.dead:
        gain[case.dead - 1] = 0.0
    return replace(
        base,
        hull=replace(
            hull,
            mass_kg=hull.mass_kg * case.mass,
            inertia_kg_m2=tuple(inertia * case.mass for inertia in hull.inertia_kg_m2),
            linear_damping=tuple(damping * case.damping for damping in hull.linear_damping),
            quadratic_damping=tuple(damping * case.damping for damping in hull.quadratic_damping),
        ),
        thrusters=replace(thrusters, gain=tuple(gain)),
        battery=replace(base.battery, resistance_ohm=0.0),
        initial=replace(base.initial, eta=(0.0, 0.0, 2.5, 0.0, 0.0, 0.0)),
        sensors=replace(base.sensors, dvl=True),
        waves=replace(
            base.waves,
            enabled=case.wave_height_m > 0.0,
            height_m=case.wave_height_m,
            period_s=case.wave_period_s or base.waves.period_s,
        ),
        tether=replace(
            base.tether,
            enabled=case.tether_n > 0.0,
            sigma_n=(0.5 * case.tether_n, 0.5 * case.tether_n, case.tether_n),
        ),
        load=replace(base.load, enabled=case.load_n > 0.0, weight_n=case.load_n, on_s=20.0, off_s=1e4),
        current=replace(
            base.current,
            enabled=case.current_m_s > 0.0,
            speed_m_s=case.current_m_s,
            direction_deg=case.current_deg,
        ),
    )


def scenario(case: CampaignCase) -> Scenario:
    """Return the same dive for the full loop, `lab.dive`."""
    return Scenario(f"campaign {case.number}", lambda _, __: plant(case), hold(), DURATION_S, case.number)


def link(case: CampaignCase) -> LinkDelay:
    """Return the dive's link for the full loop."""
    return LinkDelay(up_s=0.5e-3 * case.delay_ms, down_s=0.5e-3 * case.delay_ms, jitter_s=0.004)


def configured(config: Config, vehicle: str) -> Config:
    """Return the companion's configuration for a vehicle: its frame and nothing else is made to fit."""
    frame = _base(vehicle).thrusters.frame
    return replace(config, vehicle=replace(config.vehicle, frame=frame))


@cache
def _base(vehicle: str) -> SimConfig:
    name = "sim-bluerov2.toml" if vehicle == BLUEROV2 else "sim.toml"
    return load_config(Path(DEFAULT_CONFIG).with_name(name))


def _outcome(figures: Row) -> str:
    if not np.isnan(figures["lost_s"]):
        return "lost"
    near = figures["tail_rms_mm"] <= HELD_TAIL_MM and figures["depth_peak_mm"] <= HELD_PEAK_MM
    return "held" if near and figures["tilt_deg"] <= HELD_TILT_DEG else "strays"


def case_of(row: Row) -> CampaignCase:
    """Return the case of a row."""
    return CampaignCase(*(row[field] for field in CampaignCase._fields))


def batches(cases: Iterable[CampaignCase]) -> list[list[CampaignCase]]:
    """Sort cases into batches of one frame each, the longest first."""
    groups: dict[bool, list[CampaignCase]] = {}
    for chosen in cases:
        groups.setdefault(chosen.vehicle == BLUEROV2, []).append(chosen)
    parts = []
    for group in groups.values():
        count = -(-len(group) // BATCH)
        parts += [group[i::count] for i in range(count)]
    return sorted(parts, key=len, reverse=True)


class Campaign(Study[CampaignCase]):
    """The dives of a range of numbers, in batches."""

    command = "campaign"
    about = (
        "Simulates every published vehicle with a DVL, varied damping, mass and thrust, with delays, dead "
        "thrusters and disturbances. The number of a dive is its seed. Each dive appends a row to "
        "DIR/dives.jsonl; if a run was interrupted, the same command continues it. At the end DIR/dives.csv "
        "has the rows. "
        "Exit status 1 if Holdfast lost a vehicle inside the declared envelope."
    )
    variants = {"replay": "lab.studies.campaign:Replay"}  # noqa: RUF012
    recipe = ("set",)
    keeps_rows = True
    rows_key = "each"
    dive_min = (DURATION_S - ENGAGED_S) / 60.0

    @classmethod
    def options(cls, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--dives", type=positive, default=6000, metavar="N", help="default %(default)s")
        parser.add_argument(
            "--first", type=not_negative, default=0, metavar="ID", help="number of the first dive; default 0"
        )
        parser.add_argument(
            "--replay",
            type=not_negative,
            metavar="ID",
            help="repeat only this dive, in the batch and in the full loop",
        )
        add_settings(parser)
        add_out(parser, "out/campaign")

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._numbers = range(arguments.first, arguments.first + arguments.dives)
        self._config = load_companion(overrides=arguments.set)

    def journal(self, out: Path) -> Path:
        return out / "dives.jsonl"

    def cases(self) -> Sequence[CampaignCase]:
        return [case(number) for number in self._numbers]

    def groups(self, cases: Sequence[CampaignCase]) -> Sequence[Sequence[CampaignCase]]:
        return batches(cases)

    def dive(self, cases: Sequence[CampaignCase], traces: list[Rows] | None = None) -> Iterator[Row]:
        """Dive a batch; `traces` takes one of each dive (`simulate`)."""
        from lab.batch.simulate import simulate  # needs numba, which the command's help does not

        delay_s = 1e-3 * np.array([chosen.delay_ms for chosen in cases])
        found = simulate(
            configured(self._config, cases[0].vehicle),
            [plant(chosen) for chosen in cases],
            hold(),
            DURATION_S,
            [chosen.number for chosen in cases],
            Links(up_s=0.5 * delay_s, down_s=0.5 * delay_s, jitter_s=0.004),
            since_s=SINCE_S,
            traces=traces,
        )
        for i in range(len(cases)):
            figures = {key: round(float(values[i]), 4) for key, values in found.items()}
            yield {"outcome": _outcome(figures)} | figures

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        """Return the outcomes by vehicle and dead thruster, the envelope, and the worst dives."""
        table = ruled(
            f"{len(rows)} dives of {60.0 * self.dive_min:.0f} s, from engaging on",
            "vehicle", "dead thruster", "dives", "held", "strays", "lost", "depth RMS mm", "99 % mm",
            "place RMS mm", "99 % mm", left=2,
        )  # fmt: skip
        inside, outside = _split(rows)
        for name, dead, some in [*_groups(rows), ("inside", "", inside), ("outside", "", outside)]:
            counts = _counts(some)
            numbers = (str(counts[key]) for key in ("dives", "held", "strays", "lost"))
            rms = (counts[f"held_{of}_{which}"] for of in OF for which in ("median", "p99"))
            table.add_row(name, dead, *numbers, *("" if x is None else f"{x:.1f}" for x in rms))
        yield table
        yield "[bold]The envelope[/bold], inside which every dive must hold:"
        yield from (f"  · {line}" for line in ENVELOPE)
        count = _counts(inside)["not_held"]
        yield f"[red]{count} dives inside it did not hold[/red]" if count else "All dives inside it held."
        yield "No supervisor dives along in a batch: what it does with a lost vehicle, --replay shows."
        for where, some in (("inside", inside), ("outside", outside)):
            if some:
                yield f"Worst {where}:"
            for row in _worst(some):
                rms_mm, tilt_deg, number = row["depth_rms_mm"], row["tilt_deg"], row["number"]
                yield (
                    f"  {case_of(row)}: {row['outcome']}, depth RMS {rms_mm:.1f} mm, tilt {tilt_deg:.0f}°  "
                    f"·  {_replay_command(number)}"
                )

    def failed(self, rows: Sequence[Row]) -> bool:
        """Return whether a dive inside the envelope did not hold."""
        return bool(_counts(_split(rows)[0])["not_held"])

    def summary(self, rows: Sequence[Row]) -> dict[str, Any]:
        """Return outcomes inside and outside the envelope, and by vehicle and dead thruster."""
        inside, outside = map(_counts, _split(rows))
        return {
            "dives": len(rows),
            "envelope": ENVELOPE,
            "inside": inside,
            "outside": outside,
            "by": [{"vehicle": name, "dead": dead, **_counts(some)} for name, dead, some in _groups(rows)],
        }

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw depth RMS over delay for all dives; dive the worst again and draw them, too."""
        with plt.rc_context(PRINTED):
            figure = plt.figure(figsize=(10.5, 9.0))
            grid = figure.add_gridspec(4, 2, height_ratios=(1.25, 1, 1, 1))
            for column, some in enumerate(_split(rows)):
                axes = figure.add_subplot(grid[0, column])
                _scatter(axes, some)
                axes.set_title("outside the envelope" if column else "inside the envelope", fontweight="bold")
                for line, row in enumerate(_worst(some), 1):
                    chosen, traces = case_of(row), list[Rows]()
                    list(self.dive([chosen], traces))
                    _error(figure.add_subplot(grid[line, column]), chosen, traces[0])
            return [save(figure, folder / "worst.png")]


class Replay(Campaign):
    """One dive of a campaign, as the batch and as the full loop have it."""

    command = "campaign replay"
    keeps_rows = False
    dive_min = 0.0

    def __init__(self, arguments: argparse.Namespace) -> None:
        super().__init__(arguments)
        self._numbers = range(arguments.replay, arguments.replay + 1)

    def journal(self, out: Path) -> Path:
        return out / "replay.jsonl"

    def dive(self, cases: Sequence[CampaignCase], traces: list[Rows] | None = None) -> Iterator[Row]:
        traces, chosen = [], cases[0]
        (row,) = super().dive(cases, traces)
        full = full_loop.dive(
            scenario(chosen), configured(self._config, chosen.vehicle), plant(chosen), link(chosen)
        )
        lines = [full.t_s, full.depth_error_m, full.thrust_n, full.active]
        trace = {"batch": traces[0].T.tolist(), "full": [line.tolist() for line in lines]}
        yield row | {"full": full.figures(), "held": bool(full.active[-1]), "trace": trace}

    def tables(self, rows: Sequence[Row]) -> Iterator[RenderableType]:
        (row,) = rows
        chosen = case_of(row)
        table = ruled(str(chosen), "figure", "batch", "full loop")
        for key in [*row][[*row].index("outcome") + 1 : [*row].index("full")]:
            table.add_row(key, f"{row[key]:.3f}", f"{row['full'][key]:.3f}" if key in row["full"] else "")
        table.add_row("outcome", row["outcome"], "steered to the end" if row["held"] else "gave up")
        yield table
        yield f"{'inside' if chosen.inside else 'outside'} the envelope"

    def failed(self, rows: Sequence[Row]) -> bool:
        return False

    def draw(self, rows: Sequence[Row], folder: Path) -> Sequence[Path]:
        """Draw depth error and thrust of both."""
        chosen, trace = case_of(rows[0]), rows[0]["trace"]
        t_s, error_m, thrust_n = map(np.array, trace["batch"])
        full_s, full_m, full_n, active = map(np.array, trace["full"])
        with plt.rc_context(PRINTED):
            figure, (upper, lower) = plt.subplots(2, 1, figsize=(8.6, 5.4), sharex=True)
            held = np.where(active, 1.0, np.nan)
            upper.plot(full_s, 1e3 * full_m * held, color=BLACK, label="full loop, active")
            upper.plot(full_s, 1e3 * full_m, color=BLACK, alpha=0.3, label="full loop, not steering")
            upper.plot(t_s, 1e3 * error_m, color=VERMILLION, linestyle="--", label="batch")
            lower.plot(full_s, full_n, color=BLACK)
            lower.plot(t_s, thrust_n, color=VERMILLION, linestyle="--")
            upper.set_title(str(chosen), fontsize=9)
            upper.set_ylabel("depth error (mm)")
            lower.set_ylabel("heave thrust asked for (N)")
            lower.set_xlabel("time since boot (s)")
            upper.legend(loc="upper left")
            _limit(upper, np.concatenate([error_m, full_m]))
            return [save(figure, folder / f"replay-{chosen.number}.png")]


def _replay_command(number: int) -> str:
    return f"holdfast campaign --replay {number}"


def _split(rows: Iterable[Row]) -> tuple[list[Row], list[Row]]:
    """Return the rows inside the envelope, and the others."""
    inside: tuple[list[Row], list[Row]] = [], []
    for row in rows:
        inside[not case_of(row).inside].append(row)
    return inside


def _worst(rows: Sequence[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: (RANK[row["outcome"]], row["depth_rms_mm"]), reverse=True)[:WORST]


def _counts(rows: Sequence[Row]) -> dict[str, Any]:
    outcomes = Counter(row["outcome"] for row in rows)
    held = [row for row in rows if row["outcome"] == "held"]
    counts: dict[str, Any] = {
        "dives": len(rows),
        **{outcome: outcomes[outcome] for outcome in RANK},
        "not_held": len(rows) - outcomes["held"],
    }
    for of in OF:
        rms = [row[of] for row in held]
        counts[f"held_{of}_median"] = round(float(np.median(rms)), 2) if held else None
        counts[f"held_{of}_p99"] = round(float(np.quantile(rms, 0.99)), 2) if held else None
    return counts


def _groups(rows: Sequence[Row]) -> Iterator[tuple[str, str, list[Row]]]:
    """Give the rows of each vehicle with no, a horizontal and a vertical thruster dead."""
    for (name,), some in sorted(by(rows, "vehicle").items(), key=lambda item: VEHICLES.index(item[0][0])):
        for dead in ("none", "horizontal", "vertical"):
            if of_it := [row for row in some if _dead(row) == dead]:
                yield name, dead, of_it


def _dead(row: Row) -> str:
    return "vertical" if case_of(row).dead_vertical else "horizontal" if row["dead"] else "none"


def _scatter(axes: Axes, rows: Sequence[Row]) -> None:
    for outcome, (colour, mark) in LOOKS.items():
        of_it = [row for row in rows if row["outcome"] == outcome]
        delays, rms = [row["delay_ms"] for row in of_it], [row["depth_rms_mm"] for row in of_it]
        size = 3 if outcome == "held" else 4
        axes.plot(delays, rms, mark, color=colour, markersize=size, label=f"{outcome}: {len(of_it)}")
    if rows:
        axes.set_yscale("log")
    axes.set_ylim(1.0, 5e4)
    axes.set_xlabel("delay of the link, both ways (ms)")
    axes.set_ylabel("depth error RMS (mm)")
    axes.legend(loc="upper left", ncols=3)


def _error(axes: Axes, chosen: CampaignCase, trace: Rows) -> None:
    t_s, error_m, _ = trace.T
    axes.plot(t_s, 1e3 * error_m, color=BLUE)
    axes.axvline(SETTLE_S, color=BLACK, linestyle=":", linewidth=0.8)
    axes.set_title(f"{chosen}\n$ {_replay_command(chosen.number)}", fontsize=7, loc="left")
    axes.set_ylabel("depth error (mm)")
    axes.set_xlabel("time since boot (s)")
    _limit(axes, error_m)


def _limit(axes: Axes, error_m: Array) -> None:
    """Keep a lost vehicle from squeezing the rest."""
    from lab.batch.loop import LOST_M

    if not np.nanmax(np.abs(error_m)) < LOST_M:
        axes.set_ylim(-1.1e3 * LOST_M, 1.1e3 * LOST_M)
