"""The page after the dive says what the dive was: checked against dives of which we know."""

import json
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from matplotlib import pyplot as plt
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from msgspec.structs import replace
from virtual import ROOT, hold

from companion.config import load_config
from companion.engine import Engine
from companion.records import ControlSample, Request, State
from companion.telemetry import samples
from companion.telemetry import schemas as telemetry
from companion.telemetry.modes import Mode
from dashboard.recording.mcap_file import Item, Reader, Recording
from dashboard.recording.record import readable
from holdfast import RefusedError
from lab.foxglove import convert, in_space
from lab.loop.lockstep import LinkDelay, Lockstep, Step
from lab.report.figures import phases
from lab.report.log import Log, load
from lab.report.report import main
from lab.tables import write_table
from sim_bridge.sim_config import load_config as load_plant
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


def written(path: Path, dive: list[Step], change: Change | None = None, dropped: int = 0) -> Path:
    """Record a dive; `change` spoils the samples, and the recorder says that it dropped some messages."""
    recording = Recording(path)
    recording.describe("holdfast", {"holdfast": "0.1.0", "git": "abc<script>", "vehicle": "kelp"})
    recording.describe("config", {"json": readable(msgspec.json.encode(load_config()))})
    for step in dive:
        sample = step.sample if change is None else change(step.t_s, step.sample)
        stamp = UTC_NS + round(step.t_s * 1e9)
        for key, encoding, payload in samples.encode(sample, "kelp"):
            recording.add(Item(key, encoding, payload, stamp, stamp))
        recording.add(Item("sim/kelp/truth", SCHEMA, encode(step.truth), stamp, stamp))
    key, encoding = telemetry.published("kelp", "event")
    for at_s, text in ((-572, "an earlier hold"), (0.5, "<b>leak</b>"), (step.t_s, "<b>leak</b>")):
        event = telemetry.Event(t_s=0.0, boot_s=0.0, severity="warning", kind="autopilot", text=text)
        stamp = UTC_NS + round(1e9 * at_s)
        recording.add(Item(key, encoding, msgspec.json.encode(event), stamp, stamp))
    status: dict[str, Any] = {
        "recording": True,
        "file": "",
        "size_bytes": 0,
        "messages": 0,
        "free_bytes": 0,
        "said": "",
    }
    recorder = telemetry.Recorder(t_s=0.0, boot_s=0.0, dropped=dropped, **status)
    key, encoding = telemetry.published("kelp", "recorder")
    recording.add(Item(key, encoding, msgspec.json.encode(recorder), stamp, stamp))
    recording.close()
    return path


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
    (phase,) = phases(log)
    assert 1.0 < phase.begin_s < 4.0
    assert phase.end_s == pytest.approx(40.0, abs=0.1)
    assert list(phase.held) == ["z", "psi"]
    depth = phase.held["z"]

    held = phase._replace(begin_s=phase.begin_s + 3.0)
    state = held.part(log.keys["state"])
    apart = 1e3 * (state["depth_m"] - state["depth_desired_m"])
    law = held.part(log.keys["dof/z"])
    resting = apart[np.abs(law["x_d_dot"]) <= 0.005]
    assert depth["RMS"] == pytest.approx(np.sqrt(np.mean(resting**2)))
    assert depth["peak"] == pytest.approx(np.abs(resting).max())
    assert 1.0 < depth["SD"] <= depth["RMS"] < depth["95 % within"] < depth["peak"] < 40.0
    assert depth["moving, RMS"] > depth["RMS"]
    command = phase.part(log.keys["command"])
    assert depth["thrust, RMS"] == pytest.approx(np.sqrt(np.mean(command["heave_delivered_n"] ** 2)))


def test_the_page_is_one_file_with_everything_and_nothing_from_elsewhere(
    dive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(dive), "--out", str(tmp_path / "out")]) == 0
    html = (tmp_path / "out" / "kelp.html").read_text()
    assert "data:image/png;base64," in html
    words = re.sub(r"base64,[^\"]+", "", html)  # a picture's bytes may spell anything
    assert "http" not in words.replace("http-equiv", "")
    assert "&lt;b&gt;leak&lt;/b&gt;" in html
    assert "abc&lt;script&gt;" in html
    assert "<td>depth, SD</td>" in html
    assert (tmp_path / "out" / "kelp.png").stat().st_size > 50_000
    assert "phase 1" in capsys.readouterr().out


def test_warnings_stand_before_all_else_and_each_is_said_once(
    in_waves: list[Step], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def late(t_s: float, sample: ControlSample) -> ControlSample:
        return replace(sample, loop=replace(sample.loop, late_ticks=3 * (t_s > 8.0)))

    some = [*in_waves[: 10 * 50], *in_waves[11 * 50 : 20 * 50]]
    path = written(tmp_path / "kelp.mcap", some, late, dropped=7)
    path.write_bytes(path.read_bytes()[:-500])
    assert main([str(path)]) == 0
    html = path.with_suffix(".html").read_text()
    assert html.index("<h2>Warnings") < html.index("<img") < html.index("<h2>How well")
    shown = html[html.index("<ul>") : html.index("</ul>")].splitlines()
    assert shown[0].startswith("<ul><li>warning (autopilot): &lt;b&gt;leak")
    assert "earlier" not in html, "it came before the recording"
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("* ")]
    assert len(said) == len(shown)
    lost = (
        "3 ticks were left out by the loop",
        "50 ticks are missing in the file",
        "7 messages were dropped",
    )
    for words in ("2 times until", *lost, "was cut"):
        assert sum(words in line for line in said) == 1


def test_the_notebook_runs(
    dive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
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
    rows.append({**rows[-1], "seed": 2, "held": False, "depth_rms_mm": ""})
    write_table(tmp_path / "out" / "bench.csv", rows)
    (tmp_path / "docs" / "examples").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "docs" / "examples")  # where Jupyter runs a notebook: in its own folder
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    names: dict[str, object] = {}
    for cell in json.loads((examples / "dive.ipynb").read_text())["cells"]:
        assert not cell.get("outputs"), "outputs do not belong into the repository"
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "dive.ipynb", "exec"), names)
    assert "phase 1, z: RMS" in capsys.readouterr().out
    assert names["rms_mm"] == [[3.0, 3.0], [3.0, 3.0]]


def test_foxglove_reads_poses_places_and_log_by_its_own_decoder(dive: Path, log: Log, tmp_path: Path) -> None:
    out = tmp_path / "space.mcap"
    assert main([str(dive), "--out", str(tmp_path), "--foxglove", str(out)]) == 0
    read: dict[str, list[Any]] = {}
    with out.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        channels = {channel.topic for channel in reader.get_summary().channels.values()}  # type: ignore[union-attr]
        for schema, channel, message, decoded in reader.iter_decoded_messages(
            ["/tf", "/pose", "/desired", "/log"]
        ):
            assert schema
            read.setdefault(f"{channel.topic} {schema.name}", []).append((message.log_time, decoded))
    assert {f"holdfast/kelp/{tail}" for tail in telemetry.EVERY_TICK} <= channels, "all of the dive is there"
    poses = read["/pose foxglove.PoseInFrame"]
    assert len(poses) == 450
    at_s = [(at_ns - log.began_ns) / 1e9 for at_ns, _ in poses]
    state = log.keys["state"]
    depth_m, heading_rad = (
        np.interp(at_s, state["at_s"], state[name]) for name in ("depth_m", "heading_rad")
    )
    np.testing.assert_allclose([pose.pose.position.z for _, pose in poses], -depth_m, atol=1e-9)
    for (_, pose), heading in zip(poses, heading_rad, strict=True):
        q = pose.pose.orientation
        east, north = 1.0 - 2.0 * (q.y**2 + q.z**2), 2.0 * (q.x * q.y + q.w * q.z)  # of the nose
        assert np.arctan2(east, north) == pytest.approx(heading, abs=1e-6)
    assert len(read["/desired foxglove.PoseInFrame"]) == len(read["/tf foxglove.FrameTransform"]) == 450
    logged = [entry.message for _, entry in read["/log foxglove.Log"]]
    assert logged == ["an earlier hold", "<b>leak</b>", "<b>leak</b>"]
    layout = (ROOT / "docs" / "examples" / "foxglove.json").read_text()
    assert set(re.findall(r'"(/\w+)', layout)) <= channels | {"/location"}


def test_the_copy_for_foxglove_of_a_cut_recording_has_an_index(dive: Path, tmp_path: Path) -> None:
    cut, out = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    cut.write_bytes(dive.read_bytes()[:-20_000])
    reader = Reader(cut)
    count = sum(1 for _ in reader)
    assert not reader.whole
    convert(cut, out, None)
    with out.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count > count


def test_foxglove_has_the_place_on_the_map_where_there_is_one(in_waves: list[Step]) -> None:
    state = samples.records(in_waves[-1].sample)[0]
    there = replace(
        state, x_m=1000.0, y_m=-500.0, depth_m=3.0, roll_rad=0.0, pitch_rad=0.1, absent=(), t_s=0.0
    )
    key, _ = telemetry.published("kelp", "state")
    shown = {one.topic: one.message for one in in_space(key, telemetry.to_json(there), 0, (60.0, 10.0))}
    assert shown["/location"].latitude == pytest.approx(60.0 + 1000.0 / 111_320.0, abs=1e-5)
    assert shown["/location"].longitude == pytest.approx(10.0 - 500.0 / (111_320.0 * 0.5), abs=1e-5)
    assert shown["/location"].altitude == -3.0
    q = shown["/pose"].pose.orientation
    assert 2.0 * (q.x * q.z - q.w * q.y) == pytest.approx(np.sin(0.1)), "bow up is up"
    no_place = telemetry.to_json(replace(there, absent=("x_m",)))
    assert "/location" not in {one.topic for one in in_space(key, no_place, 0, (60.0, 10.0))}


def test_plain_mcap_reads_a_recording_as_the_page_says(
    dive: Path, log: Log, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    _, script = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert len([line for line in script.splitlines() if line]) == 7
    exec(compile(script.replace("dives/NAME.mcap", str(dive)), "data.md", "exec"), {})
    depths = [float(line.split()[1]) for line in capsys.readouterr().out.splitlines()]
    np.testing.assert_array_equal(depths, np.nan_to_num(log.keys["state"]["depth_m"]))


def test_a_dive_that_never_engaged_is_a_page_too(tmp_path: Path, in_waves: list[Step]) -> None:
    path = written(tmp_path / "idle.mcap", in_waves[:50])
    assert main([str(path)]) == 0
    assert "it never engaged" in path.with_suffix(".html").read_text()


def by_the_pilot(t_s: float, sample: ControlSample) -> ControlSample:
    """The same motion, in ALT_HOLD: nothing is engaged."""
    verdict = replace(sample.verdict, state=State.PILOT, reason="the pilot steers")
    return replace(sample, verdict=verdict, state=replace(sample.state, mode=Mode.ALT_HOLD))


def test_two_dives_stand_beside_each_other(
    dive: Path, in_waves: list[Step], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording without engagement counts too: errors are about the mean of its longest flight mode."""
    still = in_waves[12 * 50 : 24 * 50]
    other = written(tmp_path / "alt-hold.mcap", still, by_the_pilot)
    (phase,) = phases(load([other]))
    state = load([other]).keys["state"]
    assert phase.mode == "ALT_HOLD"
    calm = 1e3 * state["depth_m"][state["at_s"] >= 3.0]
    assert phase.held["z"]["SD"] == pytest.approx(calm.std(), rel=1e-3)
    assert main([str(other), str(dive), "--out", str(tmp_path)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert any(line.startswith("* alt-hold: it never engaged") for line in told)
    said = [line for line in told if not line.startswith("* ")]
    assert said[0].split() == ["alt-hold", "kelp"]
    assert said[1].split() == ["steered", "by", "ALT_HOLD", "Holdfast"]
    (row,) = (line for line in said if line.startswith("depth, SD"))
    assert row.split()[2:4] == [f"{phase.held['z']['SD']:.2f}", "mm"]
    assert "data:image/png" in (tmp_path / "compared.html").read_text()
    assert (tmp_path / "compared.png").stat().st_size > 20_000


def test_parts_of_one_dive_are_joined_if_asked(in_waves: list[Step], tmp_path: Path) -> None:
    parts = [written(tmp_path / f"{n}.mcap", in_waves[n * 1000 : (n + 1) * 1000]) for n in range(2)]
    assert load(parts).duration_s == pytest.approx(40.0, abs=0.1)
    assert main([*map(str, parts), "--join"]) == 0
    assert "phase 1" in parts[0].with_suffix(".html").read_text()


def test_what_holds_no_dive_is_refused(tmp_path: Path) -> None:
    Recording(tmp_path / "x.mcap").close()
    with pytest.raises(RefusedError, match="no dive in it"):
        main([str(tmp_path / "x.mcap")])
