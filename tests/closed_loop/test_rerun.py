"""A recorded dive goes through the engine again: the same code and configuration give the same bytes."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from dive_logs import dive as logged_dive
from dive_logs import write_blueos_mcap, write_tlog
from virtual import ROOT, Somebody, hold

import holdfast
from companion.config import Config, load_config
from companion.engine import Engine
from companion.records import ZERO, Request
from companion.telemetry import schemas as telemetry
from companion.telemetry.operator_commands import Goto
from dashboard.recording.mcap_file import Item, Recording
from dashboard.recording.record import readable
from lab.loop.lockstep import LinkDelay, Lockstep
from lab.rerun.rerun import HEARTBEAT, configured, load, main, rerun
from sim_bridge.sim_config import load_config as load_plant
from sim_bridge.vehicle import Vehicle


class Scribe(Engine):
    """An engine that notes every tick as `holdfast run` does."""

    ticks: list[telemetry.Raw]
    ground: list[tuple[int, bytes]]
    handed: dict[str, Any]

    def step(self, now_s, datagrams, loop, requests=(), ground=(), excitation=ZERO):
        ground, self.ground = self.ground, []
        out, sample = super().step(now_s, datagrams, loop, requests, ground, excitation)
        raw = telemetry.Raw(
            tick=loop.tick,
            now_s=now_s,
            heard=datagrams,
            ground=ground,
            out=out,
            requests=[request.name for request in requests],
            **self.handed,
        )
        self.handed = {}
        self.ticks.append(raw)
        return out, sample


@pytest.fixture(scope="module")
def dive() -> list[telemetry.Raw]:
    """Eight seconds: engage, a place at once, a retune, a move; then the pilot takes over from the ground."""
    config = load_config()
    setpoint = hold(1.0)
    engine = Scribe(config, setpoint, arm=True)
    engine.ticks, engine.ground = [], []
    engine.handed = {
        "start": telemetry.Start(
            config=msgspec.to_builtins(config),
            setpoint=setpoint.eta_d,
            arm=True,
            version="0",
        )
    }
    plant = load_plant(ROOT / "config" / "sim.toml", ["waves.enabled=true"])
    loop = Lockstep(Vehicle(plant, 3), engine, LinkDelay(), 3)
    loop.requests = [Request.ENGAGE]
    for tick in range(400):
        if tick == 200:
            engine.guide(Goto(depth_m=1.5, at_once=True))
            engine.handed = {"order": ("goto", b'{"depth_m": 1.5, "at_once": true}')}
        if tick == 330:
            order = ("goto", b'{"depth_m": 1.2, "heading_deg": 40}')
            engine.guide(Goto(depth_m=1.2, heading_deg=40.0))
            engine.handed = {"order": order}
        if tick == 300:
            heave = msgspec.structs.replace(config.heave, kappa_per_s=8.0, compensator="observer")
            tuned = msgspec.structs.replace(config, heave=heave)
            engine.retune(tuned)
            engine.handed = {"config": msgspec.to_builtins(tuned)}
        if tick == 380:
            engine.ground = [(round(engine.ticks[-1].now_s * 1e9), Somebody().stick())]
        loop.tick()
    return engine.ticks


def written(path: Path, ticks: list[telemetry.Raw], config: Config | None = None) -> Path:
    recording = Recording(path)
    if config is not None:
        recording.describe("config", {"json": readable(msgspec.json.encode(config))})
    key, encoding = telemetry.published("kelp", "raw")
    for raw in ticks:
        recording.add(Item(key, encoding, msgspec.msgpack.encode(raw), raw.tick, raw.tick))
    recording.close()
    return path


def test_the_same_code_sends_the_same_bytes(dive, tmp_path, capsys):
    assert any(len(raw.out) for raw in dive[300:])
    one, two = written(tmp_path / "1.mcap", dive[:250]), written(tmp_path / "2.mcap", dive[240:])
    assert main([str(two), str(one)]) == 0
    said = capsys.readouterr().out
    assert "400 ticks" in said
    assert "1 requests, 2 orders and 1 retunes" in said
    assert "every byte sent is the same" in said


@pytest.mark.parametrize("lost", ["order", "config", "start", "ground"])
def test_what_the_operator_did_matters(dive: list[telemetry.Raw], tmp_path: Path, lost: str) -> None:
    """Without the orders, the retune, the start or the sticks the commands are others: all are repeated."""
    ticks = [msgspec.structs.replace(raw, **{lost: () if lost == "ground" else None}) for raw in dive]
    tape = load([written(tmp_path / "x.mcap", ticks, load_config())])
    first = {"order": 200, "config": 300, "start": 1, "ground": 380}[lost]
    different = rerun(tape, configured(tape)).different
    assert different
    assert first <= different[0] <= first + 120


def test_what_the_pilot_was_shown_between_two_heartbeats_is_no_part_of_the_dive(
    dive: list[telemetry.Raw], tmp_path: Path
) -> None:
    """Texts for the pilot share the sequence numbers of our heartbeat, and are not in the recording."""
    at, known = 4, 7  # sequence number, message id

    def counted_on(frame: bytes) -> bytes:
        if frame[known] != HEARTBEAT:
            return frame
        return frame[:at] + bytes([(frame[at] + 3) % 256]) + frame[at + 1 :]

    ticks = [msgspec.structs.replace(raw, out=tuple(map(counted_on, raw.out))) for raw in dive]
    assert ticks != dive
    tape = load([written(tmp_path / "x.mcap", ticks)])
    assert rerun(tape, configured(tape)).different == []


def test_other_gains_are_a_table(
    dive: list[telemetry.Raw], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path / "x.mcap", dive)
    assert main([str(path), "--set", "heave.kappa_per_s=9"]) == 1
    said = capsys.readouterr().out
    assert "1 retunes of the dive were left out" in said
    rows = {line.split()[0]: line.split() for line in said.splitlines()[-4:]}
    assert int(rows["heave"][1]) > 100
    assert float(rows["heave"][3].rstrip("%")) > 1.0


def test_what_is_missing_is_said(dive: list[telemetry.Raw], tmp_path: Path) -> None:
    path = written(tmp_path / "x.mcap", [*dive[50:100], *dive[110:]], load_config())
    path.write_bytes(path.read_bytes()[:-500])
    tape = load([path])
    configured(tape)
    notes = "\n".join(tape.notes)
    assert "begins with tick 51" in notes
    assert "ticks 101 to 110 are missing" in notes
    assert "was cut" in notes


def test_a_configuration_of_another_day_is_laid_on_todays(dive: list[telemetry.Raw], tmp_path: Path) -> None:
    old = msgspec.to_builtins(load_config())
    old["heave"]["flux_capacity"] = 1.21
    del old["yaw"]["dead_zone"]
    old["heave"]["kappa_per_s"] = 7.5
    assert dive[0].start is not None
    start = msgspec.structs.replace(dive[0].start, config=old)
    tape = load([written(tmp_path / "x.mcap", [msgspec.structs.replace(dive[0], start=start)])])
    config = configured(tape)
    assert config.heave.kappa_per_s == 7.5
    assert any("heave.flux_capacity = 1.21" in note for note in tape.notes)
    assert any("yaw.dead_zone is newer" in note for note in tape.notes)


@pytest.mark.parametrize("spoiled", [{"out": [b""]}, {"requests": ["DANCE"]}])
def test_a_spoiled_tick_is_refused_in_one_line(dive, tmp_path, capsys, spoiled):
    file = written(tmp_path / "x.mcap", [msgspec.structs.replace(dive[0], **spoiled), *dive[1:5]])
    assert holdfast.main(["lab", "rerun", str(file)]) == 2
    assert capsys.readouterr().err.startswith(f"holdfast lab rerun: {file}: cannot be read: ")


def test_a_dive_without_raw_ticks_cannot_be_run_again(tmp_path, capsys):
    recording = Recording(tmp_path / "x.mcap")
    recording.close()
    with pytest.raises(ValueError, match=r"telemetry\.raw=true"):
        load([tmp_path / "x.mcap"])
    assert holdfast.main(["lab", "rerun", str(tmp_path / "x.mcap")]) == 2
    assert holdfast.main(["lab", "rerun", str(tmp_path / "none.mcap")]) == 2
    assert "none.mcap" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (write_tlog, "pool.tlog"),
        (write_blueos_mcap, "recorder.mcap"),
    ],
)
def test_a_log_of_somebody_else_is_refused_with_the_command_that_reads_it(write, name, tmp_path, capsys):
    write(logged_dive(5.0), tmp_path / name)
    assert holdfast.main(["lab", "rerun", str(tmp_path / name)]) == 2
    said = "is no recording of Holdfast; `holdfast identify --from` finds the vehicle in it"
    assert capsys.readouterr().err == f"holdfast lab rerun: {tmp_path / name}: {said}\n"
