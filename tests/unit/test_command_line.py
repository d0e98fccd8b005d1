"""What every command has in common at a terminal: statuses, one line for what cannot be, quiet endings."""

import errno
import os
import socket
import subprocess
import sys
from importlib.metadata import EntryPoint
from typing import Any

import pytest

import holdfast
from companion.app import parting
from companion.config import load_config as load_companion
from sim_bridge.commands import vehicle_file
from sim_bridge.sim_config import load_config


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "--config", "nowhere"],
        ["check", "--config", "nowhere"],
        ["identify", "--config", "nowhere", "--yes"],
        ["sim", "--vehicle", "nowhere.toml"],
        ["lab", "tune", "ppi", "--config", "nowhere"],
        ["report", "nowhere"],
        ["lab", "rerun", "nowhere"],
        ["replay", "nowhere"],
        ["lab", "bench", "reality", "--set", "nowhere.x=1"],
        ["watch", "--once", "--connect", "nowhere"],
        ["record", "--connect", "nowhere"],
        ["dashboard", "--connect", "nowhere"],
        ["tell", "bluerov2", "engage", "--connect", "nowhere"],
        ["goto", "bluerov2", "--depth", "2", "--connect", "nowhere"],
        ["follow", "bluerov2", "nowhere.toml"],
        ["sim", "--zenoh", "nowhere", "--tcp", "127.0.0.1:0"],
    ],
)
def test_what_is_not_there_is_named_in_one_line_with_status_2(arguments, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stderr.isatty", lambda: False, raising=False)
    assert holdfast.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    named = " ".join(arguments[: 2 if arguments[0] == "lab" else 1])
    assert line.startswith(f"holdfast {named}: ")
    assert "nowhere" in line


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["lab", "faults", "--dives", "0"], "'0' is not a whole number of 1 or more"),
        (["lab", "faults", "--first", "-1"], "'-1' is not a whole number of 0 or more"),
        (["lab", "bench", "dives", "--table", "dives.parquet"], "must end in .csv; pandas or pyarrow"),
        (["sim", "--tcp", "a:99999"], "'a:99999' is not HOST:PORT"),
        (["dashboard", "--listen", "8600"], "'8600' is not HOST:PORT"),
        (["tell"], "the following arguments are required: [VEHICLE] COMMAND"),
        (["follow", "kelp", "a.toml", "b.toml"], "one file, and at most one vehicle before it"),
        (["follow"], "which FILE?"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, says, capsys):
    with pytest.raises(SystemExit) as leaving:
        holdfast.main(arguments)
    assert leaving.value.code == 2
    assert says in capsys.readouterr().err


@pytest.fixture
def stand_in(monkeypatch):
    """Make a function the command `run`."""

    def register(function):
        class Point(EntryPoint):
            def load(self):
                return function

        found = {"run": Point("run", "companion.x:y", "group")}
        monkeypatch.setattr(holdfast, "commands_by_name", lambda: found)

    return register


def _raise(error):
    raise error


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (KeyboardInterrupt(), 130, ""),
        (OSError(errno.ENOSPC, "No space left"), 1, "holdfast run: [Errno 28] No space left\n"),
        *(
            (ModuleNotFoundError("no", name=f"{module}.web"), 2, f"pip install 'holdfast-rov[{extra}]'\n")
            for module, extra in (("aiohttp", "dashboard"), ("cma", "lab"), ("mcap", "recording"))
        ),
    ],
)
def test_what_a_command_meets_is_a_line_and_a_status(stand_in, capsys, error, status, said):
    stand_in(lambda argv: _raise(error))
    assert holdfast.main(["run"]) == status
    assert capsys.readouterr().err.endswith(said)


def test_of_several_extras_the_commands_own_is_named_and_what_none_brings_is_a_fault_of_ours(stand_in):
    for command, extra in (("watch", "dashboard"), ("lab bench", "lab"), ("demo", "demo")):
        assert holdfast.extra_of("rich", command) == extra
    stand_in(lambda argv: _raise(ModuleNotFoundError("No module named 'nothing'", name="nothing")))
    with pytest.raises(ModuleNotFoundError):
        holdfast.main(["run"])


def test_a_base_installation_checks_without_rich_and_says_what_watch_needs():
    program = """if True:
        import sys
        for name in ("rich", "aiohttp", "matplotlib", "mcap", "numba"):
            sys.modules[name] = None
        import companion.app, companion.predive.app, holdfast
        from companion.predive.check import CheckRow, Grade
        row = CheckRow("link", Grade.REFUSED, "none", "why", "fix")
        companion.predive.app.inspect = lambda config, **options: ([row], [])
        print(holdfast.main(["check"]))
        print(holdfast.main(["watch", "--once"]))
    """
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        " REFUSED  link: none",
        "          why. Fix: fix",
        "NOT ready: link: none",
        "2",
        "2",
    ]
    extra = f"{sys.executable} -m pip install 'holdfast-rov[dashboard]'"
    assert f"holdfast watch: needs rich. Install the extra: {extra}" in done.stderr


def test_a_reader_that_went_away_ends_it_without_a_word():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [sys.executable, "-m", "holdfast", "lab", "schema"],
        stdout=writing,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.parametrize("command", ["check", "sim", "dashboard", "run"])
def test_a_port_that_is_taken_is_named(command, capsys, caplog):
    kind = socket.SOCK_STREAM if command == "dashboard" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as held:
        held.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            held.listen()
        port = held.getsockname()[1]
        arguments = {
            "check": ["check", "--set", f"link.endpoint=udp-listen:127.0.0.1:{port}"],
            "run": [
                *("run", "--set", f"link.endpoint=udp-listen:127.0.0.1:{port}"),
                *("--set", "telemetry.endpoint=tcp/127.0.0.1:1"),
            ],
            "sim": ["sim", "--physics-only", f"127.0.0.1:{port}"],
            "dashboard": ["dashboard", "--listen", f"127.0.0.1:{port}", "--connect", "tcp/127.0.0.1:1"],
        }
        assert holdfast.main(arguments[command]) == 1
    said = capsys.readouterr().err + caplog.text
    assert f"port {port} is taken by another process, which `sudo ss -" in said
    assert "end that, or choose another port" in said
    assert "Traceback" not in said


def test_a_folder_for_figures_that_cannot_be_is_refused_before_hours_pass(capsys):
    assert holdfast.main(["lab", "bench", "--json", "/proc/nowhere/figures.json"]) == 2
    assert capsys.readouterr().err == "holdfast lab bench: /proc/nowhere: No such file or directory\n"


def test_vehicle_means_the_preset_and_name_the_name_in_run_and_sim_alike(capsys, monkeypatch):
    for preset in ("heavy", "bluerov2", "ardusub"):
        plant = load_config(vehicle_file(preset))
        assert load_companion(overrides=[f"vehicle.preset={preset}"]).vehicle.frame == plant.thrusters.frame
    asked: dict[str, Any] = {}
    monkeypatch.setattr("companion.app.run", lambda config, *rest, **more: asked.update(run=config.vehicle))
    monkeypatch.setattr("sim_bridge.app.run", lambda config, seed, settings: asked.update(sim=settings) or 0)
    for command in ("run", "sim"):
        holdfast.main([command, "--vehicle", "bluerov2", "--name", "kelp"])
    assert (asked["run"].name, asked["run"].frame) == ("kelp", "vectored")
    assert asked["sim"].vehicle == "kelp"


def test_a_simulated_vehicle_that_there_is_not_is_refused_with_those_there_are(capsys):
    with pytest.raises(SystemExit):
        holdfast.main(["sim", "--vehicle", "submarine"])
    there_are = "neither one of heavy, ardusub, bluerov2, dvl-a50, harbour, heavy-skid, swell, tank-heavy nor"
    assert there_are in capsys.readouterr().err


def test_neutral_is_claimed_of_a_vehicle_that_was_heard_alone():
    assert parting(steering=True, silent=False) == "the vehicle was left neutral"
    assert "not heard" in parting(steering=True, silent=True)
    assert parting(steering=False, silent=True) == "it was not steering"


def test_bash_completes_commands_and_starts_nothing():
    command = [sys.executable, "-m", "holdfast", "--print-completion", "bash"]
    script = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    asked = f"""{script}
        COMP_WORDS=(holdfast reco); COMP_CWORD=1
        PATH=; _shtab_holdfast; printf "%s\n" "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(["bash"], input=asked, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["record"]
