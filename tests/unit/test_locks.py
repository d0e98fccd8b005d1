"""The locks: every file that is installed is known by its hash, and none by an address."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOCKS = {path.stem: path.read_text().strip() for path in (ROOT / "requirements").glob("*.lock")}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def name_of(requirement):
    return re.findall(r"^[\w.-]+", requirement)[0]


def pins(lock):
    """Versions by name, and how many hashes each has."""
    return {
        name_of(entry): (re.findall(r"==([^\s;]+)", entry)[0], entry.count("--hash=sha256:"))
        for entry in re.split(r"\n(?=\S)", LOCKS[lock])
    }


def wanted(*extras):
    """What pyproject.toml names, by name."""
    texts = [*PROJECT["dependencies"], *(t for e in extras for t in PROJECT["optional-dependencies"][e])]
    return {name_of(text) for text in texts} - {PROJECT["name"]}


@pytest.mark.parametrize("lock", LOCKS)
def test_every_version_is_pinned_with_its_hashes_and_nothing_else_is_there(lock):
    assert all(count > 0 for _, count in pins(lock).values())
    rest = re.sub(r"--hash=sha256:[0-9a-f]{64}", "", LOCKS[lock])
    assert not re.search(r"/|--|@", rest), "an address, an option"


def test_all_that_the_project_names_is_there_and_a_pilot_gets_no_tools_of_development():
    assert wanted("dashboard", "lab", "recording", "dev") <= pins("dev").keys()
    assert wanted("dashboard", "recording") <= pins("vehicle").keys()
    assert wanted("docs") <= pins("docs").keys()
    assert wanted("dashboard", "demo") | {"hatchling", "editables"} <= pins("demo").keys()
    large = {"atheris", "llvmlite", "mypy", "numba", "playwright", "pytest"}
    assert large <= pins("dev").keys()
    assert not large & pins("demo").keys()


def test_everybody_gets_the_versions_that_were_tested():
    docs, dev = pins("docs"), pins("dev")
    assert {name: docs[name] for name in docs.keys() & dev.keys()}.items() <= dev.items()
    assert pins("vehicle").items() | pins("demo").items() <= dev.items()
