"""Which Pythons Holdfast runs on: the same everywhere it is said, and what `make` does with others."""

import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

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


def test_a_python_that_does_not_fit_is_refused_in_words(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    (new := tmp_path / "new").write_text('#!/bin/sh\ntest "$1" = --version && echo Python 3.15.0\n')
    new.chmod(0o755)
    outer = ("MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS", "MAKELEVEL", "PYTHONS")  # of `make test PYTHONS=...`
    done = subprocess.run(
        ["make", "--no-print-directory", ".venv/pyvenv.cfg", f"PYTHONS=nowhere {new}"],
        cwd=tmp_path,
        env={name: value for name, value in os.environ.items() if name not in outer},
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "Holdfast needs Python 3.11 to 3.14" in done.stderr
    assert "new: Python 3.15.0" in done.stderr
