"""`holdfast init` and `holdfast config check`: from a few answers to a configuration that runs."""

import io
from pathlib import Path

import msgspec
import pytest

import holdfast
from companion.config import DEFAULT_FILE, PRESETS, load_config
from companion.first_config import questions
from companion.predive import search


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(search, "search", lambda config, groups: None)
    return tmp_path


@pytest.mark.parametrize(
    ("question", "word"), [(one.name, choice.word) for one in questions() for choice in one.choices]
)
def test_every_answer_makes_a_configuration_that_runs_with_its_comments(here, question, word):
    assert holdfast.main(["init", "--yes", f"--{question}", word]) == 0
    made = load_config(here / "companion.toml")
    assert made.heave == load_config().heave or question == "vehicle"
    assert (here / "companion.toml").read_text().count("#") == DEFAULT_FILE.read_text().count("#")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_answers_stand_in_the_file_and_what_an_option_answers_is_not_asked(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal("bluerov2\n2\n\nnever\n"))
    assert holdfast.main(["init", "--name", "kelp"]) == 0
    made = load_config(Path("companion.toml"))
    assert made.vehicle.frame == "vectored"
    assert made.vehicle.name == "kelp"
    assert made.link.endpoint == "tcp:127.0.0.1:5777"
    assert made.vehicle.steering_mode == "stabilize", "the default is for a first dive"
    assert made.telemetry.allow_control == "never"
    said = capsys.readouterr().out
    assert "What is it called" not in said
    assert all(choice.word in said for question in questions() for choice in question.choices)
    assert "holdfast check --config companion.toml" in said


def test_what_is_heard_is_proposed(monkeypatch, capsys):
    """Four times Enter: a six-thruster vehicle on a serial line that no choice names."""
    found = search.Found("serial:/dev/ttyACM0:115200", "ArduSub 4.5.7", "vectored", "bluerov2")
    listened_on = []

    def heard(config, groups):
        listened_on.extend(groups)
        return found

    monkeypatch.setattr(search, "search", heard)
    monkeypatch.setattr("sys.stdin", Terminal("\n" * 5))
    assert holdfast.main(["init"]) == 0
    made = load_config(Path("companion.toml"))
    assert (made.link.endpoint, made.vehicle.frame) == (found.endpoint, "vectored")
    assert "Heard: ArduSub 4.5.7, vectored at serial:/dev/ttyACM0:115200." in capsys.readouterr().out
    assert ["udp-listen:127.0.0.1:14550", "udp-listen:0.0.0.0:14550"] in listened_on


def test_each_serial_line_is_looked_at_once(tmp_path):
    for name in ("ttyAMA0", "ttyUSB1", "tty7"):
        (tmp_path / name).touch()
    (tmp_path / "serial0").symlink_to("ttyAMA0")
    lines = search.serial_lines(tmp_path)
    assert [line[0] for line in lines] == [
        f"serial:{tmp_path}/{name}:921600" for name in ("ttyUSB1", "serial0")
    ]


def test_ctrl_d_writes_nothing(here, monkeypatch):
    monkeypatch.setattr("sys.stdin", Terminal(""))
    assert holdfast.main(["init"]) == 130
    assert not list(here.iterdir())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "say --yes"),
        (["--yes", "--where", "moon"], "want one of simulator, blueos, pi, extension, topside"),
        (["--yes", "--name", "a b"], "vehicle.name"),
    ],
)
def test_what_cannot_be_is_refused_and_writes_nothing(here, capsys, monkeypatch, arguments, says):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert holdfast.main(["init", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    assert not list(here.iterdir())


def test_a_file_that_is_there_stays(here, capsys):
    (here / "companion.toml").write_text("mine")
    assert holdfast.main(["init", "--yes"]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (here / "companion.toml").read_text() == "mine"


@pytest.mark.parametrize("file", [DEFAULT_FILE, *sorted(PRESETS.glob("*.toml"))], ids=lambda file: file.stem)
def test_every_shipped_file_is_sound(file, capsys):
    assert holdfast.main(["config", "check", str(file)]) == 0
    assert "that `holdfast run` takes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[heave]\n# a word\nkappa_per_s = 800", 3),
        ("heave.kappa_per_s = 800", 1),
        ("\n[ heave ] # here\n  kappa_per_s=800", 3),
        ("[surge]\nkappa_per_s = 4\n[heave]\nkapa_per_s = 4", 4),
        ("[heave]\nkappa_per_s = 4 5", 2),
    ],
)
def test_what_is_wrong_in_a_file_has_its_line(here, capsys, text, line):
    (here / "mine.toml").write_text(text)
    assert holdfast.main(["config", "check", "mine.toml"]) == 2
    assert f"line {line}" in capsys.readouterr().err


def test_every_key_is_shown_with_its_range_and_where_it_comes_from(here, capsys):
    (here / "mine.toml").write_text('[vehicle]\npreset = "bluerov2"\n[heave]\nkappa_per_s = 8.0\n')
    assert holdfast.main(["config", "show", "mine.toml", "--set", "yaw.max_rate=0.5"]) == 0
    rows = {line.split()[0]: " ".join(line.split()[1:]) for line in capsys.readouterr().out.splitlines()}
    sections = msgspec.to_builtins(load_config()).items()
    assert list(rows) == [f"{section}.{key}" for section, keys in sections for key in keys]
    assert rows["heave.kappa_per_s"] == "8.0 number, 0.05 to 50 1/s mine.toml"
    assert rows["heave.mass"] == f"24.6 number, 1 to 1000 kg {PRESETS / 'bluerov2.toml'}"
    assert rows["yaw.max_rate"] == "0.5 number, 0.01 to 3 m/s or rad/s --set"
    assert rows["heave.lambda_per_s"].endswith(" default")
