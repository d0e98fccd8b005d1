"""`holdfast identify` on the command line: what it refuses; what was interrupted is not written."""

import pytest

import holdfast
from companion import app


@pytest.fixture
def driven(monkeypatch, tmp_path):
    """Run the command in a folder of its own; `drive` stands for the process and does with the manoeuvre."""

    def run(drive, *arguments):
        monkeypatch.chdir(tmp_path)

        def identify(config, setpoint, *, arm, requests, manoeuvre):
            drive(manoeuvre)
            return 0

        monkeypatch.setattr(app, "run", identify)
        return holdfast.main(["identify", *arguments])

    return run


def ctrl_c_after_the_first_axis(manoeuvre):
    manoeuvre.moved.append(2)


def taken_over(manoeuvre):
    manoeuvre.moved.append(2)
    manoeuvre.failure, manoeuvre.done = "the pilot took an axis", True


@pytest.mark.parametrize(
    ("drive", "said"),
    [(ctrl_c_after_the_first_axis, "broken off: stopped"), (taken_over, "the pilot took an axis")],
)
def test_what_was_broken_off_is_not_written(driven, tmp_path, capsys, drive, said):
    assert driven(drive, "--yes") == 1
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def never(manoeuvre):
    raise AssertionError("it moved")


def test_it_does_not_move_unasked(driven, capsys):
    assert driven(never) == 2
    assert "--yes" in capsys.readouterr().err


def test_a_file_that_is_there_stays(driven, tmp_path, capsys):
    (tmp_path / "vehicle.toml").write_text("mine", encoding="utf-8")
    assert driven(never, "--yes") == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "vehicle.toml").read_text(encoding="utf-8") == "mine"


def test_a_wrong_vehicle_is_refused_before_it_moves(driven, capsys):
    assert driven(never, "--yes", "--vehicle", "nonesuch") == 2
    assert "must be one of ardusub, bluerov2" in capsys.readouterr().err
