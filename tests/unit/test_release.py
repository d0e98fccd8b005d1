"""A release says the same version wherever it says one, and its notes come out of the changelog."""

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path
from zipfile import ZipFile

from hatchling.builders.wheel import WheelBuilder

from holdfast import DISTRIBUTION

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION = PROJECT["version"]


def test_the_version_is_the_same_everywhere_and_takes_thirty_lines_of_the_changelog() -> None:
    for file, line in (
        ("blueos/Dockerfile", f'LABEL version="{VERSION}"'),
        ("CITATION.cff", f"\nversion: {VERSION}\n"),
        ("docs/install.md", f"export WHEEL=holdfast_rov-{VERSION}-py3-none-any.whl\n"),
        ("docs/install.md", f"NAME/holdfast:{VERSION} --push"),
        ("docs/install.md", f"tar xf holdfast-{VERSION}.tar.gz\nsudo holdfast-{VERSION}/install "),
    ):
        assert line in (ROOT / file).read_text()
    _, *versions = (ROOT / "CHANGELOG.md").read_text().split("\n## ")
    assert versions[0].startswith("[Unreleased]")
    assert versions[1].startswith(f"[{VERSION}] - ")
    assert all(len(text.splitlines()) <= 30 for text in versions)


def test_no_document_or_hint_installs_the_project_that_is_called_holdfast() -> None:
    """In the package index that name is somebody else's."""
    assert PROJECT["name"] == DISTRIBUTION
    strangers = re.compile(
        r"holdfast\[[a-z.]|\binstall(?: +-\S+)* +['\"]?holdfast(?![\w-])|holdfast-[^\s/'\"`]*\.whl"
    )
    for text in ("pip install holdfast", "pip install -U 'holdfast[lab]'", "dist/holdfast-*.whl"):
        assert strangers.search(text), text
    patterns = ["*.md", "*.toml", "Makefile", ".ci/*", ".github/*/*", "blueos/*", "docs/*/*", "docs/**/*.md"]
    packages = {entry.module.partition(".")[0] for entry in entry_points(group="holdfast.commands")}
    patterns += [f"{package}/**/*.*" for package in packages]
    files = {path for pattern in patterns for path in ROOT.glob(pattern) if path.is_file()}
    texts = {path: path.read_text(errors="ignore") for path in files if path.suffix != ".pyc"}
    assert len(texts) > 250
    assert not {str(path): match[0] for path, text in texts.items() if (match := strangers.search(text))}


def test_an_installation_adds_nothing_but_holdfast_to_the_top_level(tmp_path: Path) -> None:
    (wheel,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])
    site = tmp_path / "site"
    with ZipFile(wheel) as file:
        file.extractall(site)
    assert {path.name for path in site.iterdir()} == {"holdfast", f"holdfast_rov-{VERSION}.dist-info"}
    program = "import sys, holdfast, companion; print(companion.__file__); holdfast.main(sys.argv[1:])"
    command, environment = [sys.executable, "-c", program, "sim", "--list"], {"PYTHONPATH": str(site)}
    said = subprocess.check_output(command, text=True, cwd=tmp_path, env={**os.environ, **environment})
    assert said.startswith(str(site / "holdfast" / "companion"))
    assert "six thrusters" in said, "config/ is there"
