"""`holdfast demo --dvl`: a short one leaves all that the long one does."""

from pathlib import Path

import msgspec
import pytest

from lab.demo import demo
from lab.demo.place import PlaceFigures, PlaceStory
from lab.demo.place_show import perform

SHORT = PlaceStory(counts_s=5.0, path_s=6.0, end_s=7.0)


def test_a_short_demo_leaves_table_picture_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    png, json = tmp_path / "demo-dvl.png", tmp_path / "demo-dvl.json"
    assert perform(SHORT, png, json) == 0
    printed = capsys.readouterr().out
    assert "POSHOLD" in printed
    assert "place error, RMS" in printed
    assert png.read_bytes().startswith(b"\x89PNG")
    written = msgspec.json.decode(json.read_bytes())
    for name in ("poshold", "place", "path"):
        assert 0.0 < msgspec.convert(written[name], PlaceFigures).place_rms_mm < 1000.0


def test_the_real_firmware_is_refused_with_a_dvl(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        demo.main(["--dvl", "--firmware"])
    assert ended.value.code == 2
    assert "leave --firmware out" in capsys.readouterr().err
