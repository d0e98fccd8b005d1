"""A release says the same version wherever it says one, and its notes come out of the changelog."""

import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


@pytest.mark.parametrize(
    ("file", "line"),
    [("CITATION.cff", f"\nversion: {VERSION}\n"), ("SECURITY.md", f"Today that is {VERSION}.")],
)
def test_the_version_is_the_same_everywhere(file: str, line: str) -> None:
    assert line in (ROOT / file).read_text()


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    """A copy of `.ci/notes` in a project at version 1.2.3."""
    (tmp_path / ".ci").mkdir()
    (tmp_path / "pyproject.toml").write_text('version = "1.2.3"\n')
    (tmp_path / "CHANGELOG.md").write_text(
        "# Changelog\n\n## [Unreleased]\n- later\n\n## [1.2.3] - 2026-01-01\n- now\n\n## [1.2.2]\n- before\n"
    )
    return Path(shutil.copy(ROOT / ".ci" / "notes", tmp_path / ".ci"))


def test_the_notes_are_the_section_of_the_version(notes: Path) -> None:
    assert _run(notes, "v1.2.3") == (0, "- now\n", "")


def test_a_tag_that_is_not_the_projects_version_is_refused(notes: Path) -> None:
    assert _run(notes, "v1.2.2") == (1, "", "pyproject.toml has another version than v1.2.2\n")


def test_a_version_that_the_changelog_does_not_tell_is_refused(notes: Path) -> None:
    (notes.parents[1] / "CHANGELOG.md").write_text("## [Unreleased]\n- now\n")
    assert _run(notes, "v1.2.3") == (1, "", "CHANGELOG.md has no section '## [1.2.3]'\n")


def _run(script: Path, tag: str) -> tuple[int, str, str]:
    done = subprocess.run([script, tag], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr
