"""The page after the dive says what the dive was: checked against dives of which we know."""

import csv
import json
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from matplotlib import pyplot as plt
from mcap.reader import make_reader
from msgspec import structs
from msgspec.structs import replace
from virtual import ROOT, hold

from companion.config import load_config
from companion.engine import Engine
from companion.records import Array, ControlSample, LoopHealth, Request, vector
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from dashboard.foxglove.poses import quaternion
from dashboard.recording.mcap_file import Item, Recording
from dashboard.recording.record import flat
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from lab.report import foxglove
from lab.report.advice import advice
from lab.report.figures import figures
from lab.report.identify import identify
from lab.report.log import Columns, Log, load
from lab.report.numbers import ticks
from lab.report.plot import POINTS, thinned
from lab.report.report import main
from lab.tables import write_table
from sim_bridge.config import load_config as load_plant
from sim_bridge.physics.plant import euler, rotation
from sim_bridge.vehicle import Vehicle
from sim_bridge.zenoh_link import SCHEMA, encode

UTC_NS = 1_795_000_000_000_000_000
Change = Callable[[float, ControlSample], ControlSample]


def steps(sea: str) -> list[Step]:
    """Dive: down to 2 m, at 25 s to 3 m, released at 40 s."""
    plant = load_plant(ROOT / "config" / "sim.toml", [sea])
    engine = Engine(load_config(), hold(2.0), arm=True)
    loop = Lockstep(Vehicle(plant, 5), engine, LinkDelay(), 5)
    loop.requests = [Request.ENGAGE]
    done = []
    for step in loop.run(45.0):
        if step.sample.loop.tick == 25 * 50:
            engine.aim(hold(3.0))
        if step.sample.loop.tick == 40 * 50:
            loop.requests = [Request.STOP]
        done.append(step)
    return done


def written(path: Path, dive: list[Step], change: Change | None = None) -> Path:
    """Record a dive; `change` spoils the samples."""
    recording = Recording(path)
    recording.describe("holdfast", {"holdfast": "0.1.0", "git": "abc<script>", "vehicle": "kelp"})
    recording.describe("config", flat(msgspec.json.encode(load_config())))
    for step in dive:
        sample = step.sample if change is None else change(step.t_s, step.sample)
        stamp = UTC_NS + round(step.t_s * 1e9)
        for key, encoding, payload in samples.encode(sample, "kelp"):
            recording.add(Item(key, encoding, payload, stamp, stamp))
        recording.add(Item("sim/kelp/truth", SCHEMA, encode(step.truth), stamp, stamp))
    event = telemetry.Event(t_s=0.0, boot_s=0.0, severity="warning", kind="autopilot", text="<b>leak</b>")
    key, encoding = telemetry.event_key("kelp")
    recording.add(Item(key, encoding, msgspec.json.encode(event), stamp, stamp))
    recording.close()
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def in_waves() -> list[Step]:
    return steps("waves.enabled=true")


@pytest.fixture(scope="module")
def dive(in_waves: list[Step], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("dive") / "kelp.mcap", in_waves)


@pytest.fixture(scope="module")
def loaded(dive: Path) -> Log:
    return load([dive])


@pytest.fixture
def log(loaded: Log) -> Log:
    return deepcopy(loaded)


def test_the_figures_are_those_of_the_samples(log: Log) -> None:
    found = figures(log)
    (phase,) = found.phases
    assert 1.0 < phase.begin_s < 4.0
    assert phase.end_s == pytest.approx(40.0, abs=0.1)
    assert phase.ended == "RAMP_DOWN: the operator released the vehicle"
    depth, heading = phase.held
    assert (depth.dof, heading.dof) == ("z", "psi")
    assert depth.unit == "mm"

    state = log.keys["state"].between(phase.begin_s + 3.0, phase.end_s)
    apart = 1e3 * (state["depth_m"] - state["depth_desired_m"])
    law = log.keys["dof/z"].between(phase.begin_s + 3.0, phase.end_s)
    resting = apart[np.abs(law["x_d_dot"]) <= 0.005]
    assert depth.rms == pytest.approx(np.sqrt(np.mean(resting**2)))
    assert depth.peak == pytest.approx(np.abs(resting).max())
    assert 1.0 < depth.rms < depth.p95 < depth.peak < 40.0
    assert depth.moving_rms > depth.rms
    assert 0.4 * depth.rms < depth.true_rms < 2.5 * depth.rms
    command = log.keys["command"].between(phase.begin_s, phase.end_s)
    assert depth.chatter == pytest.approx(np.sqrt(np.mean(np.diff(command["heave_delivered_n"]) ** 2)))
    held = log.keys["command"].between(phase.begin_s + 3.0, phase.end_s)
    rest = np.abs(law["x_d_dot"]) <= 0.005
    assert depth.thrust_mean == pytest.approx(held["heave_delivered_n"][rest].mean()), (
        "not that of the way down"
    )
    assert found.loop.ticks == 45 * 50
    assert found.loop.ticks_missing == 0
    assert found.depth_max_m == pytest.approx(3.0, abs=0.1)


def test_a_good_dive_gets_no_advice_about_what_is_well(log: Log) -> None:
    said = " ".join(advice(log, figures(log)))
    for word in ("fault", "late", "chatters", "saturated", "delays", "battery", "lost", "bias"):
        assert word not in said


def test_in_calm_water_the_mass_is_that_of_the_vehicle_and_in_waves_it_says_that_it_cannot_tell(
    log: Log, tmp_path: Path
) -> None:
    """The true one: 13.5 + 18.68 kg. The nominal model has 28.5."""
    calm = load([written(tmp_path / "kelp.mcap", steps("current.enabled=false"))])
    model, drowned = figures(calm).models["z"], figures(log).models["z"]
    assert model is not None
    assert drowned is not None
    assert model.mass.identified
    assert model.mass.value == pytest.approx(32.2, rel=0.15)
    assert model.mass.sigma < 2.0
    assert not drowned.mass.identified


def test_mass_comes_back_from_numbers_that_are_known() -> None:
    rng = np.random.default_rng(1)
    dt_s, mass, linear, quadratic = 0.02, 30.0, 20.0, 110.0
    t_s: Array = np.arange(4000.0) * dt_s
    tau = np.convolve(rng.normal(0.0, 60.0, t_s.size), np.ones(40) / 40, "same")
    acting, rate, v = np.zeros(t_s.size), np.zeros(t_s.size), 0.0
    for i in range(1, t_s.size):
        acting[i] = acting[i - 1] + (tau[i - 1] - acting[i - 1]) * dt_s / 0.15
        v += dt_s * (acting[i] - 5.0 - linear * v - quadratic * abs(v) * v) / mass
        rate[i] = v
    model = identify(t_s, rate + rng.normal(0.0, 0.002, t_s.size), rate, tau, 0.0, 0.15)
    assert model is not None
    for found, true in ((model.mass, mass), (model.bias, 5.0)):
        assert found.value == pytest.approx(true, abs=max(3.0 * found.sigma, 0.04 * true))
    assert model.mass.sigma < 0.05 * mass
    assert model.damping_at.value == pytest.approx(
        linear * model.speed + quadratic * model.speed**2, abs=3.0 * model.damping_at.sigma + 0.2
    )


def test_a_vehicle_that_rests_tells_no_mass() -> None:
    rng = np.random.default_rng(2)
    t_s: Array = np.arange(3000.0) * 0.02
    noise = rng.normal(0.0, 0.002, t_s.size)
    model = identify(t_s, noise, 0.0 * noise, rng.normal(8.0, 0.5, t_s.size), 0.01, 0.15)
    assert model is None or not model.mass.identified
    assert identify(t_s[:100], t_s[:100], t_s[:100], t_s[:100], 0.0, 0.1) is None


def saturated(t_s: float, sample: ControlSample) -> ControlSample:
    on = sample.dofs.engaged if int(t_s * 10) % 5 == 0 else (False,) * 4
    return replace(sample, dofs=replace(sample.dofs, saturated=on))


def chattering(t_s: float, sample: ControlSample) -> ControlSample:
    more = 6.0 if sample.loop.tick % 2 else -6.0
    tau = vector(one + more for one in sample.delivered.tau)
    return replace(sample, delivered=replace(sample.delivered, tau=tau))


def biased(t_s: float, sample: ControlSample) -> ControlSample:
    x, y, z, psi = sample.eta_d
    return replace(sample, eta_d=(x, y, z - 0.03, psi))


def sinking(t_s: float, sample: ControlSample) -> ControlSample:
    surge, sway, heave, yaw = sample.delivered.tau
    tau = (surge, sway, heave - 40.0, yaw)
    return replace(sample, delivered=replace(sample.delivered, tau=tau))


def late(t_s: float, sample: ControlSample) -> ControlSample:
    health = LoopHealth(sample.loop.tick, 50.0, 12.0, 900.0, sample.loop.tick // 10, 0)
    return replace(sample, loop=health)


def delayed(t_s: float, sample: ControlSample) -> ControlSample:
    delays = structs.replace(
        sample.state.delays, telemetry_s=0.08, command_s=0.07, telemetry_known=True, command_known=True
    )
    return replace(sample, state=structs.replace(sample.state, delays=delays))


def flat_battery(t_s: float, sample: ControlSample) -> ControlSample:
    return replace(sample, state=structs.replace(sample.state, voltage_v=13.2))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (saturated, "Depth was saturated 20%"),
        (chattering, "Heave thrust chatters: 12"),
        (biased, "mm is left in depth"),
        (sinking, "N up on average. If that was no load, remove"),
        (late, "The loop was late: p99 12.0 ms"),
        (delayed, "Both delays together are 150 ms"),
        (flat_battery, "The battery fell to 13.2 V"),
    ],
)
def test_each_rule_speaks_when_it_should(
    tmp_path: Path, in_waves: list[Step], change: Change, words: str
) -> None:
    log = load([written(tmp_path / "kelp.mcap", in_waves[: 22 * 50], change)])
    assert any(words in line for line in advice(log, figures(log))), advice(log, figures(log))


def test_the_page_is_one_file_with_everything_and_nothing_from_elsewhere(
    dive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [f"--json={tmp_path}/dive.json", f"--table={tmp_path}/held.csv", f"--ticks={tmp_path}/ticks.csv"]
    assert main([str(dive), "--out", str(tmp_path / "out"), *files]) == 0
    html = (tmp_path / "out" / "kelp.html").read_text()
    assert "data:image/png;base64," in html
    assert "http" not in html.replace("http-equiv", "")
    assert "&lt;b&gt;leak&lt;/b&gt;" in html
    assert "abc&lt;script&gt;" in html
    assert "RAMP_DOWN: the operator released the vehicle" in html
    assert (tmp_path / "out" / "kelp.png").stat().st_size > 50_000
    assert "phase 1" in capsys.readouterr().out
    assert json.loads((tmp_path / "dive.json").read_text())["phases"][0]["held"][0]["dof"] == "z"
    assert [row["axis"] for row in rows_of(tmp_path / "held.csv")] == ["heave", "yaw"]


def test_a_row_of_ticks_has_all_keys_of_the_same_moment(log: Log) -> None:
    columns = ticks(log)
    assert {len(column) for column in columns.values()} == {45 * 50}
    assert np.array_equal(columns["state/depth_m"], log.keys["state"]["depth_m"])
    assert np.array_equal(columns["dof/z/e"], log.keys["dof/z"]["e"])
    assert columns["supervisor/state"][30 * 50] == "ACTIVE"
    assert columns["degrees/heading"][700] == pytest.approx(np.degrees(columns["state/heading_rad"][700]))
    assert abs(columns["truth/depth_m"][30 * 50] - columns["state/depth_m"][30 * 50]) < 0.05


def test_foxglove_gets_poses_in_its_own_frames(dive: Path, log: Log, tmp_path: Path) -> None:
    foxglove.write([dive], tmp_path / "pose.mcap")
    with (tmp_path / "pose.mcap").open("rb") as file:
        reader = make_reader(file)
        found = {
            topic: (schema.name, [json.loads(message.data) for _, _, message in reader.iter_messages(topic)])
            for topic in ("/tf", "/pose", "/pose_desired", "/degrees")
            for schema, _, _ in [next(reader.iter_messages(topic))]
            if schema is not None
        }
    assert {topic: name for topic, (name, _) in found.items()} == {
        "/tf": "foxglove.FrameTransform",
        "/pose": "foxglove.PoseInFrame",
        "/pose_desired": "foxglove.PoseInFrame",
        "/degrees": "holdfast.Degrees",
    }
    state, row = log.keys["state"], 30 * 50
    assert found["/pose"][1][row]["pose"]["position"]["z"] == pytest.approx(-state["depth_m"][row])
    assert found["/tf"][1][row]["translation"] == found["/pose"][1][row]["pose"]["position"]
    assert found["/degrees"][1][row]["heading"] == pytest.approx(np.degrees(state["heading_rad"][row]))
    assert len(load([tmp_path / "pose.mcap"]).keys["state"].at_s) == len(state.at_s)


def test_the_notebook_runs_and_its_layouts_name_what_there_is(
    dive: Path, log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    examples = ROOT / "docs" / "examples"
    (tmp_path / "dives").mkdir()
    (tmp_path / "dives" / "kelp.mcap").symlink_to(dive)
    (tmp_path / "out").mkdir()
    rows = [
        {"row": row, "scenario": "waves", "delay_ms": 0, "seed": seed, "held": True, "depth_rms_mm": 3.0}
        for row in ("law", "ppi")
        for seed in (0, 1)
    ]
    write_table(tmp_path / "out" / "bench.csv", rows)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    names: dict[str, object] = {}
    for cell in json.loads((examples / "dive.ipynb").read_text())["cells"]:
        assert not cell.get("outputs"), "outputs do not belong into the repository"
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "dive.ipynb", "exec"), names)
    assert "phase 1, z: RMS" in capsys.readouterr().out
    assert names["rms_mm"] == [[3.0, 3.0], [3.0, 3.0]]

    curves = ElementTree.parse(examples / "plotjuggler.xml").iter("curve")
    wanted = {curve.get(key) for curve in curves for key in ("name", "curve_x", "curve_y")}
    assert wanted - {None, "track", "reference"} <= ticks(log).keys()


def test_the_layout_of_foxglove_names_topics_and_fields_of_a_recording(dive: Path, tmp_path: Path) -> None:
    foxglove.write([dive], tmp_path / "pose.mcap")
    with (tmp_path / "pose.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    fields = {
        channel.topic: json.loads(summary.schemas[channel.schema_id].data)["properties"]
        for channel in summary.channels.values()
    }
    layout = Path(__file__).parents[2] / "docs" / "examples" / "foxglove.json"
    shown = json.loads(layout.read_text())
    panels = shown["configById"]
    paths = [path["value"].partition(".") for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) > 8
    for topic, _, name in paths:
        assert name in fields[topic]
    assert {topic for panel in panels.values() for topic in panel.get("topics", ())} <= fields.keys()
    assert set(re.findall(r'"(\w+!\w+)"', json.dumps(shown["layout"]))) == set(panels)


def rotated(turn: dict[str, float], vector: tuple[float, float, float]) -> Array:
    q = np.array([turn["x"], turn["y"], turn["z"]])
    v = np.array(vector)
    return np.asarray(v + 2.0 * np.cross(q, np.cross(q, v) + turn["w"] * v))


@pytest.mark.parametrize("seed", range(4))
def test_forward_left_and_up_are_where_the_simulator_has_them(seed: int) -> None:
    q = np.random.default_rng(seed).normal(size=4)
    state = (0.0, 0.0, 0.0, *(q / np.linalg.norm(q)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    forward, right, down = np.reshape(rotation(state), (3, 3)).T
    turn = quaternion(*euler(state))
    to_enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    assert rotated(turn, (1.0, 0.0, 0.0)) == pytest.approx(to_enu @ forward)
    assert rotated(turn, (0.0, 1.0, 0.0)) == pytest.approx(to_enu @ -right)
    assert rotated(turn, (0.0, 0.0, 1.0)) == pytest.approx(to_enu @ -down)


def test_a_tick_that_was_lost_leaves_its_cells_empty(log: Log) -> None:
    law = log.keys["dof/z"]
    log.keys["dof/z"] = Columns(
        np.delete(law.at_s, 700), {name: np.delete(column, 700) for name, column in law.of.items()}
    )
    error = ticks(log)["dof/z/e"]
    assert np.flatnonzero(np.isnan(error)).tolist() == [700]
    assert error[701] == law["e"][701]


def test_a_cut_file_is_reported_and_said_to_be_cut(dive: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(dive.read_bytes()[: dive.stat().st_size // 2])
    log = load([cut])
    assert 15.0 < log.duration_s < 30.0
    assert any("was cut" in note for note in log.notes)
    assert figures(log).phases[0].ended == "the recording ended"


def test_a_dive_that_never_engaged_is_a_page_too(tmp_path: Path, in_waves: list[Step]) -> None:
    path = written(tmp_path / "idle.mcap", in_waves[:50])
    assert main([str(path)]) == 0
    assert "It never engaged" in path.with_suffix(".html").read_text()


def test_what_holds_no_dive_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Recording(tmp_path / "x.mcap").close()
    assert main([str(tmp_path / "x.mcap")]) == 2
    assert "no dive in it" in capsys.readouterr().err


def test_thinning_keeps_every_peak() -> None:
    rng = np.random.default_rng(3)
    at_s, values = np.arange(200_000.0), rng.normal(size=200_000)
    values[123_456] = 99.0
    x, y = thinned(at_s, values)
    assert x.size <= 2.1 * POINTS
    assert y.max() == 99.0
    assert (np.diff(x) >= 0.0).all()
