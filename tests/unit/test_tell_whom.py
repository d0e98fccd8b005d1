"""Which vehicle a command goes to where none is named."""

import pytest

from companion.telemetry.schemas import Reply
from dashboard import commands, zenoh_client
from dashboard.terminal import tell


@pytest.fixture
def sea(monkeypatch):
    """Vehicles that are heard; each takes every command."""
    heard: list[str] = []
    told: list[tuple[object, ...]] = []

    class Subscription:
        connected = True
        others = zenoh_client.Subscription.others

        def __init__(self, key_expression, endpoint):
            pass

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def companions(self):
            return set(heard)

        def tell(self, vehicle, command, what):
            told.append((vehicle, command, what))
            return Reply(done=True, said="so it is")

    monkeypatch.setattr(tell, "Subscription", Subscription)
    monkeypatch.setattr(tell, "PATIENCE_S", 0.1)
    return heard, told


def test_the_only_vehicle_needs_no_name(sea):
    heard, told = sea
    heard.append("kelp")
    assert commands.engage([]) == commands.release([]) == commands.hold([]) == 0
    assert commands.tell(["goto", "depth_m=2"]) == commands.goto(["--depth", "2"]) == 0
    assert [(vehicle, command) for vehicle, command, _ in told] == [
        ("kelp", "engage"),
        ("kelp", "release"),
        ("kelp", "path"),
        ("kelp", "goto"),
        ("kelp", "goto"),
    ]
    assert told[2][2] == {"action": "hold"}


def test_a_name_that_is_empty_is_no_missing_name(sea, capsys):
    """A shell's variable that is not set."""
    heard, told = sea
    heard.append("kelp")
    assert commands.engage([""]) == commands.tell(["", "engage"]) == commands.follow(["--pause", ""]) == 2
    assert not told


def test_of_several_one_is_named_before_or_after_the_options(sea):
    heard, told = sea
    heard += ["kelp", "wrack"]
    assert commands.release(["wrack"]) == commands.tell(["wrack", "engage"]) == 0
    assert commands.goto(["wrack", "--depth", "2"]) == commands.goto(["--depth", "2", "wrack"]) == 0
    assert commands.follow(["--pause", "wrack"]) == 0
    assert {vehicle for vehicle, *_ in told} == {"wrack"}


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["kelp", "wrack"], "these are heard: kelp, wrack"),
        (["\x1b[31mkelp", "wrack"], "these are heard: \\x1b[31mkelp, wrack"),
        ([], "none is heard"),
    ],
)
def test_which_vehicle_is_asked_where_it_is_not_clear(sea, capsys, names, says):
    heard, told = sea
    heard += names
    assert commands.release([]) == 2
    assert says in capsys.readouterr().err
    assert not told
