"""Which Pythons Holdfast runs on: the same everywhere it is said, and what `make` does with others."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SUPPORTED = [3, 11], [3, 12], [3, 13], [3, 14]


def test_the_same_pythons_are_named_everywhere():
    classified = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert [numbers(name) for name in classified] == [*SUPPORTED]
    assert PROJECT["requires-python"] == f">=3.{SUPPORTED[0][1]},<3.{SUPPORTED[-1][1] + 1}"
    for row in re.findall(r"python: (\[.+\])", (ROOT / ".github" / "workflows" / "ci.yml").read_text()):
        assert [numbers(name) for name in re.findall(r"[\d.]+", row)] == [*SUPPORTED]
    makefile = (ROOT / "Makefile").read_text()
    (names,) = re.findall(r"^PYTHONS := python3 (.+)", makefile, re.MULTILINE)
    assert sorted(numbers(name) for name in names.split()) == [*SUPPORTED]
    bounds = re.findall(r"\((3, \d+)\) <= sys.version_info\[:2\] <= \((3, \d+)\)", makefile)
    assert bounds == [(f"3, {SUPPORTED[0][1]}", f"3, {SUPPORTED[-1][1]}")]
    for page in ("Makefile", "README.md", "CONTRIBUTING.md", "docs/install.md", "docs/tutorial.md"):
        assert "Python 3.11 to 3.14" in (ROOT / page).read_text(), page


def numbers(name: str) -> list[int]:
    return [int(part) for part in name.removeprefix("python").split(".")]


@pytest.fixture
def make(tmp_path: Path):
    """`make .venv/pyvenv.cfg` beside a copy of the Makefile; returns its status and all that it says."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    outer = ("MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS", "MAKELEVEL", "PYTHONS")  # of `make test PYTHONS=...`
    environment = {name: value for name, value in os.environ.items() if name not in outer}

    def run(*arguments: str) -> tuple[int, str]:
        done = subprocess.run(
            ["make", "--no-print-directory", ".venv/pyvenv.cfg", *arguments],
            cwd=tmp_path,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout

    return run


def pretend(path: Path, version: tuple[int, int]) -> str:
    """Write a program that takes itself for a Python of this version, and makes venvs of itself."""
    path.write_text(
        f"""#!{sys.executable}
import pathlib, shutil, sys
this = pathlib.Path(__file__).resolve()
sys.version_info = (*{version}, 0)
sys._base_executable = (this.parent / "made-by").read_text() if this.name == "python" else str(this)
if sys.argv[1] == "--version":
    print("Python {version[0]}.{version[1]}.0")
elif sys.argv[1] == "-c":
    exec(sys.argv[2])
else:
    folder = pathlib.Path(sys.argv[-1])
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "bin").mkdir(parents=True)
    (folder / "pyvenv.cfg").write_text(f"executable = {{this}}")
    (folder / "bin" / "made-by").write_text(str(this))
    shutil.copy(this, folder / "bin" / "python")
"""
    )
    path.chmod(0o755)
    return str(path)


def test_the_first_python_that_fits_is_taken_and_none_is_refused_in_words(make, tmp_path):
    new, fits = pretend(tmp_path / "new", (3, 15)), pretend(tmp_path / "fits", (3, 14))
    status, said = make(f"PYTHONS={new}")
    assert status == 2
    assert "Holdfast needs Python 3.11 to 3.14" in said
    assert "new: Python 3.15.0" in said
    assert make(f"PYTHONS=nowhere {new} {fits}")[0] == 0
    assert (tmp_path / ".venv" / "bin" / "made-by").read_text() == fits
