"""The scripts of docs/data.md: the first dives, as it stands there."""

import asyncio
import re
import subprocess
import sys
from pathlib import Path

import pytest
from test_tell import VEHICLE, diving
from tools.processes import free_port

from companion.telemetry.schemas import Supervisor
from dashboard.zenoh_client import Subscription
from holdfast import RefusedError
from holdfast.client import connect

PAGE = Path(__file__).parents[2] / "docs" / "data.md"


def test_the_script_of_the_page_dives() -> None:
    script, _ = re.findall(
        r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    with diving("--arm") as seen:
        here = script.replace('connect("bluerov2")', f'connect("bluerov2", "{seen.endpoint}")')
        assert here != script
        done = subprocess.run(
            [sys.executable, "-c", here], capture_output=True, text=True, timeout=90.0, check=False
        )
        assert done.returncode == 0, done.stderr
        assert re.fullmatch(r"reached (3\.9[89]|4\.0[012]) m\n", done.stdout)

        async def told() -> None:
            async with connect("", seen.endpoint) as v:  # the only one
                assert v.name == VEHICLE
                async for record in v.records("supervisor"):
                    assert isinstance(record, Supervisor)
                    assert record.state != "ACTIVE"
                    break
                with pytest.raises(RefusedError, match="max_depth_m"):
                    await v.goto(depth_m=500)
                with pytest.raises(AttributeError, match="there is no command 'dive'"):
                    await v.dive()

        asyncio.run(told())


def test_a_vehicle_that_there_is_not_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("holdfast.client.FOUND_S", 0.3)

    async def nobody() -> None:
        async with connect("kelp", f"tcp/127.0.0.1:{free_port()}"):
            pass

    with pytest.raises(RefusedError, match=r"'kelp' is not heard at tcp/.*; none is heard"):
        asyncio.run(nobody())


class Sea:
    """Two vehicles; the second is heard a moment after the first."""

    others = Subscription.others

    def __init__(self, key_expression: str, endpoint: str) -> None:
        self._asked = 0

    def __enter__(self) -> "Sea":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def companions(self) -> set[str]:
        self._asked += 1
        return {"kelp"} if self._asked < 3 else {"kelp", "wrack"}


@pytest.mark.parametrize(
    ("name", "says"), [("wrack", "wrack"), ("", "these are heard: kelp, wrack")], ids=["named", "not named"]
)
def test_of_two_vehicles_none_is_taken_by_chance(
    monkeypatch: pytest.MonkeyPatch, name: str, says: str
) -> None:
    """The one that was heard first was steered."""
    monkeypatch.setattr("holdfast.client.Subscription", Sea)

    async def taken() -> str:
        try:
            async with connect(name) as v:
                return v.name
        except RefusedError as error:
            return str(error)

    assert says in asyncio.run(taken())
