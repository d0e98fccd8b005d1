"""systemd itself judges the units: each must parse without a word, and expose little."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

UNITS = Path(__file__).parents[2] / "systemd"
COMMANDS = {
    "holdfast.service": "run --config ",
    "holdfast-record.service": "record --out /var/lib/",
    "holdfast-dashboard.service": "dashboard --listen ",
    "holdfast-sim@.service": "sim --vehicle %i",
}
MOST_EXPOSURE = 1.1  # systemd's scale: 0 is sealed, 10 is open

if shutil.which("systemd-analyze") is None and not os.environ.get("CI"):
    pytest.skip("systemd-analyze is not installed: .ci/apt brings it", allow_module_level=True)


@pytest.fixture(params=COMMANDS)
def unit(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A unit with a program that exists here in place of the one that exists on the vehicle."""
    installed = "/opt/holdfast/bin/holdfast"
    text = (UNITS / request.param).read_text()
    assert f"ExecStart={installed} {COMMANDS[request.param]}" in text
    copy: Path = tmp_path / request.param
    copy.write_text(text.replace(f"ExecStart={installed}", "ExecStart=/bin/true"))
    return copy


def test_systemd_accepts_the_unit_without_a_word(unit: Path) -> None:
    verdict = _analyze("verify", str(unit))
    assert (verdict.returncode, verdict.stdout, verdict.stderr) == (0, "", "")


def test_the_unit_is_hardened(unit: Path) -> None:
    verdict = _analyze("security", "--offline=true", "--no-pager", str(unit))
    exposure = re.search(r"Overall exposure level for \S+: ([\d.]+)", verdict.stdout)
    assert exposure, verdict.stdout + verdict.stderr
    assert float(exposure[1]) <= MOST_EXPOSURE


def _analyze(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True, check=False)
