"""`holdfast --help` lists every command, and imports no package that is not used."""

import json
import os
import platform
import subprocess
import sys
from importlib.metadata import entry_points

import pytest

import holdfast
from holdfast import version


def test_help_is_a_screenful_that_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert holdfast.main([]) == 0
    said = capsys.readouterr().out
    assert holdfast.main(["--help"]) == 0
    assert capsys.readouterr().out == said
    lines = said.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 100
    listed = [line.split(maxsplit=2) for line in lines if line.startswith("  holdfast ")]
    assert all(len(words) == 3 for words in listed), "no docstring to serve as its help"
    assert len(listed) <= 20
    assert {name for _, name, _ in listed} == {
        entry.name for entry in entry_points(group="holdfast.commands")
    }
    assert holdfast.main(["lab"]) == 0
    lab = capsys.readouterr().out
    assert all(f"  holdfast lab {entry.name} " in lab for entry in entry_points(group="holdfast.lab"))


def test_an_unknown_command_gets_advice(capsys):
    assert holdfast.main(["swim"]) == 2
    complaint = capsys.readouterr().err
    assert all(said in complaint for said in ("no command 'swim'", "watch", "--help"))


def test_no_thread_of_zenoh_can_abort_the_end_of_a_command() -> None:
    program = """
import atexit, sys, holdfast
def command(arguments, name):
    import zenoh
    print("done")
    return 3
holdfast._dispatch = command
atexit.register(print, "torn down")
holdfast.run()
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (3, "done\n", "")


@pytest.mark.parametrize("option", ["-V", "--version"])
def test_version(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert holdfast.main([option]) == 0
    first, python, ardusub = capsys.readouterr().out.splitlines()
    assert first == f"holdfast {version.running()}"
    assert python.startswith(f"Python {platform.python_version()}")
    assert ardusub == "for ArduSub 4.5 and newer, tested with 4.7"


def test_a_checkout_says_its_commit_and_whether_it_was_changed(tmp_path, monkeypatch):
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    (tmp_path / "law.py").write_text("KAPPA = 1\n")
    monkeypatch.setattr(version, "CHECKOUT", tmp_path)
    assert version.revision.__wrapped__() == "", "an installation"
    for arguments in (["init", "-q"], ["add", "."], ["commit", "-qm", "one"]):
        subprocess.run([*git, *arguments], check=True)
    clean = version.revision.__wrapped__()
    assert len(clean) == 12
    (tmp_path / "law.py").write_text("KAPPA = 2\n")
    assert version.revision.__wrapped__() == f"{clean}-dirty"


@pytest.fixture(scope="module")
def helps():
    """The help of every command, where what only searches need is not installed."""
    program = """if True:
        import contextlib, io, json, sys
        for name in ("numba", "cma"):
            sys.modules[name] = None
        import holdfast
        said = {}
        for name in holdfast.commands_by_name():
            with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):
                holdfast.main([*name.split(), "--help"])
            said[name] = out.getvalue()
        print(json.dumps(said))
    """
    environment = os.environ | {"COLUMNS": "110"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, env=environment)
    return json.loads(done.stdout)


@pytest.mark.parametrize("command", holdfast.commands_by_name())
def test_every_commands_help_has_examples_and_fits_the_screen(command, helps):
    lines = helps[command].splitlines()
    assert max(map(len, lines)) <= 110
    assert lines[lines.index("examples:") + 1].startswith("  holdfast ")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"]])
def test_the_front_door_is_light(arguments: list[str]) -> None:
    program = (
        "import sys, holdfast\n"
        f"assert holdfast.main({arguments}) == 0\n"
        "heavy = {'numpy', 'zenoh', 'msgspec', 'rich', 'pymavlink', 'matplotlib', 'asyncio'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "--depth-only", "--heading", "90"], "the firmware keeps the heading"),
        (["run", "--depth", "-5"], "--depth = -5: must be 0 to 100 (supervisor.max_depth_m)"),
        (["run", "--depth", "40", "--set", "supervisor.max_depth_m=30"], "must be 0 to 30 (supervisor."),
        (["run", "--heading", "400"], "--heading = 400: must be -360 to 360"),
        (
            ["run", "--set", "yaw.learning_rate=1000", "--set", "yaw.compensator=network"],
            "yaw.learning_rate = 1000: mass kappa / learning rate is 0.001 s",
        ),
        *(
            ([command, "--set", "yaw.lambda_per_s=25", "--set", "yaw.kappa_per_s=25"], says)
            for command in ("run", "check")
            for says in ("yaw.lambda_per_s = 25", "1/lambda + 1/kappa is 0.080 s and must be over 0.160 s")
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line_before_anything_starts(capsys, arguments, says):
    """Yaw with the units of heave: at 1000 it turned by 134 degrees before it was handed over."""
    assert holdfast.main(arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
