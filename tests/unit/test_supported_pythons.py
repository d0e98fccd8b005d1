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


def test_ci_tries_each_python_that_the_machine_has_beside_the_one_of_make_test(tmp_path):
    """One minor version each: one that does not run, like a shim of pyenv, counts for nothing."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "run", tmp_path / ".ci")
    pyenv = tmp_path / "pyenv" / "versions"
    for path, version in (
        (tmp_path / ".venv" / "bin" / "python", "3.12.7"),
        (tmp_path / "bin" / "python3.11", "3.11.2"),
        (tmp_path / "bin" / "python3.12", "3.12.3"),
        (tmp_path / "bin" / "python3.13", ""),
        (tmp_path / "bin" / "python3.14", ""),
        (pyenv / "3.11.9" / "bin" / "python3.11", "3.11.9"),
        (pyenv / "3.13.0" / "bin" / "python3.13", "3.13.0"),
    ):
        program(path, f"echo {version}" if version else "exit 127")
    for name in ("systemd-nspawn", "chromium"):
        program(tmp_path / "bin" / name, "")
    program(tmp_path / "bin" / "make", 'echo "make $*"')
    done = subprocess.run(
        [tmp_path / ".ci" / "run"],
        env={"PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin", "PYENV_ROOT": str(tmp_path / "pyenv")},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    tested, *quick, said = done.stdout.splitlines()
    assert tested == "make test"
    assert quick == [
        "make quick PYTHONS=python3.11 VENV=build/python3.11",
        f"make quick PYTHONS={pyenv}/3.13.0/bin/python3.13 VENV=build/python3.13",
    ]
    assert said == "make test passed on Python 3.12.7, make quick on 3.11.2 3.13.0"


def program(path: Path, body: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
