"""What a part of the controller is worth; and a short demo from its command."""

import dataclasses
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace
from shown import output, says

import holdfast
from lab.demo import demo
from lab.demo.demo_dives import NAMES, DemoFigures, dive_holdfast, worth
from lab.demo.story import Story


@dataclasses.dataclass(frozen=True)
class Short(Story):
    """Ten seconds."""

    depth_m: float = 2.0
    wave_height_m: float = 0.1
    waves_s: float = 3.0
    path_s: float = 4.0
    load_on_s: float = 8.0
    load_off_s: float = 9.0
    end_s: float = 10.0


SHORT = Short()


def test_what_a_part_is_worth_comes_from_the_figures() -> None:
    rest = dict.fromkeys(DemoFigures.__struct_fields__[1:], 0.0)
    without = DemoFigures(phase_rms_mm=dict.fromkeys("abcd", 10.0), **rest)
    with_it = replace(without, phase_rms_mm={"a": 8.0, "b": 9.6, "c": 10.4, "d": 12.0})
    assert worth("The network", without, with_it) == (
        "The network lowers the error: a -20 %; it raises it: d +20 %; it brings nothing (within 5 %): b, c."
    )
    assert worth("It", with_it, with_it) == "It brings nothing (within 5 %): a, b, c, d."


def test_a_vehicle_that_is_released_ends_the_demo_with_the_reason() -> None:
    storm = dataclasses.replace(SHORT, current_m_s=3.0, wave_height_m=4.0)
    with pytest.raises(ValueError, match="the controller released the vehicle: "):
        dive_holdfast(storm, "", None, lambda _: None)


def test_a_short_demo_leaves_table_picture_and_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(demo, "Story", Short)
    json = tmp_path / "figures" / "demo.json"
    assert holdfast.main(["demo", "--out", str(tmp_path), "--json", str(json)]) == 0
    content = msgspec.json.decode(json.read_bytes())
    for name in NAMES:
        result = content[name]
        assert 0.0 < result["depth_rms_mm"] < result["depth_peak_mm"] < 500.0
        assert list(result["phase_rms_mm"]) == ["waves", "path", "load hung on", "load dropped"]
    assert content["holdfast"]["depth_rms_mm"] < content["alt_hold"]["depth_rms_mm"]
    assert (tmp_path / "demo.png").read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out
    table, _ = output("tutorial.md", "Errors, RMS").rsplit("...\n", 1)
    assert says(f"...\n{table}...", said)
    assert all(sentence in " ".join(said.split()) for sentence in content["worth"])
