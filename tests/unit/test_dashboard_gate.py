"""Who may look, who may command, and what may be sent at all."""

import json
from pathlib import Path
from typing import get_type_hints

import pytest

from companion.config import AxisSection
from companion.records import State
from dashboard.web import gate, vocabulary
from dashboard.web.command import announcement, settings
from holdfast import validation

NAMES = ("localhost", "blueos.local")


@pytest.mark.parametrize(
    ("host", "ours"),
    [
        *((host, True) for host in ("127.0.0.1:8600", "192.168.2.2", "[::1]:8600", "localhost:1")),
        ("blueos.local:8600", True),
        *((host, False) for host in ("", "evil.example", "127.0.0.1.evil.example", "evil.example:8600")),
        *((host, False) for host in ("[", "1", "local")),
    ],
)
def test_a_number_or_a_name_of_ours_is_us_and_another_name_is_a_rebound_one(host: str, ours: bool) -> None:
    assert gate.host_is_ours(host, NAMES) is ours


def test_only_our_own_pages_have_our_origin() -> None:
    ours, evil = "127.0.0.1:8600", "evil.example"
    assert gate.same_origin(f"http://{ours}", ours)
    assert gate.same_origin(f"https://{ours}", ours)
    others = ["http://127.0.0.1:8601", "http://127.0.0.1", f"http://{evil}", f"http://{ours}.{evil}", ""]
    for origin in (*others, f"http://evil@{ours}", "null", f"file://{ours}", "http://[", None):
        assert not gate.same_origin(origin, ours), origin


def test_only_the_token_unlocks() -> None:
    assert gate.token_is_right("Bearer secret", "secret")
    wrong = ("Bearer Secret", "Bearer", "Bearer ", "bearer secret", "Basic secret", "Bearer sécret", "", None)
    for header in wrong:
        assert not gate.token_is_right(header, "secret"), header
    assert not gate.token_is_right("Bearer ", ""), "no token is unlocked by nothing"


def test_the_policy_lets_nothing_in_from_elsewhere() -> None:
    policy = gate.headers(framed=False)["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors *" in gate.headers(framed=True)["Content-Security-Policy"]


def test_control_has_to_be_asked_for(tmp_path: Path) -> None:
    assert settings([]).token == ""
    assert settings([]).host == "127.0.0.1"
    one, other = settings(["--allow-control"]).token, settings(["--allow-control"]).token
    assert len(one) >= 16
    assert one != other
    file = tmp_path / "token"
    file.write_text("0123456789abcdef\n", encoding="utf-8-sig")
    assert settings(["--allow-control", "--token-file", str(file)]).token == "0123456789abcdef"
    assert settings(["--listen", "[::1]:80"]).host == "::1"


def test_a_log_gets_the_place_of_a_token_and_a_terminal_the_token(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text("0123456789abcdef\n")
    options = settings(["--allow-control", "--token-file", str(file), "--listen", "[::]:80"])
    assert (
        announcement(options, 80, terminal=True) == "dashboard: http://127.0.0.1:80/#token=0123456789abcdef"
    )
    logged = announcement(options, 80, terminal=False)
    assert logged == f"dashboard: http://127.0.0.1:80/ unlock it with the token in {file}"
    made = settings(["--allow-control"])
    assert announcement(made, 80, terminal=False).endswith(f"#token={made.token}"), "it is nowhere else"
    assert announcement(settings([]), 80, terminal=False) == "dashboard: http://127.0.0.1:80/"


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["--token-file", "x"], "nothing to unlock"),
        (["--allow-control", "--token-file", "/nowhere/x"], "cannot be read"),
        (["--allow-control", "--token-file", "short"], "16 or more"),
    ],
)
def test_a_wrong_option_is_explained(
    argv: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("short").write_text("short")
    with pytest.raises(ValueError, match=says):
        settings(argv)


def test_the_pages_fields_have_the_ranges_of_the_configuration() -> None:
    said = dict(line.removesuffix(";").split(" = ", 1) for line in vocabulary.module().splitlines())
    commands = json.loads(said["export const COMMANDS"])
    configured = get_type_hints(AxisSection, include_extras=True)
    numbers = {name: field for name, field in commands["gains"].items() if field["least"] is not None}
    assert len(numbers) == 7
    for name, field in numbers.items():
        assert (field["least"], field["most"]) == validation.bounds(configured[name])
        assert field["title"], "the form calls it nothing"
    assert json.loads(said["export const MODES"])["19"] == "MANUAL"
    assert set(json.loads(said["export const STATES"])) == set(State)
