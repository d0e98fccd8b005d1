"""Every link in the documents leads somewhere, and what they quote is what the program says."""

import ast
import re
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path

import pytest
from shown import says

import holdfast
from companion.records import Condition
from companion.telemetry.glossary import title

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


@cache
def anchors(page):
    """The anchors that GitHub and MyST make of a page's headings."""
    text = FENCE.sub("", page.read_text())
    words = (re.sub(r"[^\w\- ]", "", line.lower()) for line in re.findall(r"^#+ (.*)", text, re.MULTILINE))
    return {line.strip().replace(" ", "-") for line in words}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page):
    for link in LINK.findall(FENCE.sub("", page.read_text())):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target.resolve()), link


@cache
def options(command):
    """The options that a command's help names."""
    said = StringIO()
    with redirect_stdout(said), pytest.raises(SystemExit):
        holdfast.main([*command.split(), "--help"])
    return set(re.findall(r"--[a-z][a-z-]*", said.getvalue()))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_that_a_page_shows_exists_with_its_options(page):
    if page.name == "CHANGELOG.md" or page.parent.name == "decisions":
        return  # they name the commands of their day
    text = page.read_text().replace("\\\n", " ")
    shown = [line for block in FENCE.findall(text) for line in block.splitlines()[1:-1]]
    shown += re.findall(r"`([^`\n]+)`", FENCE.sub("", text))
    known = holdfast.commands_by_name().keys() | {"lab"}
    for line in shown:
        for command, rest in re.findall(
            r"(?:^|[/ ])holdfast ((?:lab )?[a-z]+)((?: [^|;#&]*)?)", line.split("  #")[0]
        ):
            if not re.match(r"^(\$ |[A-Z_]+=\S+ |\S*/)?holdfast ", line.strip()):
                continue
            assert command in known, line
            assert set(re.findall(r"(?<!\S)--[a-z][a-z-]*", rest)) <= options(command), line


PACKAGES = "companion|sim_bridge|lab|dashboard|holdfast"
MODULE = re.compile(rf"(?<![\w./@'\"-])(?:{PACKAGES})(?:\.[A-Za-z_]\w*)+(?![\w/-])")
FILE = re.compile(rf"(?<![\w./-])(?:{PACKAGES}|tests|blueos|systemd)/[\w/.-]*\w\.(?:py|toml|md)\b")
NO_MODULE = re.compile(r"\.(toml|token|v1|laws|compensators)$")
"""Files, schemas and groups of entry points have dots too."""
SOURCES = sorted(path for name in (*PACKAGES.split("|"), "tests") for path in (ROOT / name).rglob("*.py"))


@cache
def prose(path):
    """A page without its examples; of a program the docstrings and comments."""
    text = path.read_text()
    if path.suffix == ".md":
        return FENCE.sub("", text)
    strings = (node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Expr))
    said = [one.value for one in strings if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    return "\n".join([*said, *re.findall(r"(?:^|\s)#.*", text)])


@cache
def is_there(name):
    """Whether a dotted name leads to a module, and what follows stands in it."""
    place, parts = ROOT, name.split(".")
    while parts and (place / parts[0]).is_dir():
        place /= parts.pop(0)
    module = place / "__init__.py"
    if parts and (place / f"{parts[0]}.py").is_file():
        module = place / f"{parts.pop(0)}.py"
    words = set(re.findall(r"\w+", module.read_text())) if module.is_file() else set()
    return words >= set(parts)


def test_no_dead_module_is_named_in_prose():
    assert not is_there("companion.types")
    pages = [page for page in PAGES if page.name != "CHANGELOG.md" and page.parent.name != "decisions"]
    found = {(path, name) for path in (*pages, *SOURCES) for name in MODULE.findall(prose(path))}
    dead = {(str(path), name) for path, name in found if not (NO_MODULE.search(name) or is_there(name))}
    files = {(path, name) for path in (*pages, *SOURCES) for name in FILE.findall(prose(path))}
    dead |= {(str(path), name) for path, name in files if not (ROOT / name).exists()}
    assert not dead


def test_troubleshooting_names_conditions():
    text = (ROOT / "docs" / "troubleshooting.md").read_text()
    part = text[text.index("| condition |") : text.index("## It holds badly")]
    named = re.findall(r"^\| ([A-Z ]+) \|", part, re.MULTILINE)
    assert len(named) > 8
    assert set(named) <= {title(condition.name or "") for condition in Condition}


def test_the_picture_of_the_loop_is_the_code_of_the_tick():
    """All calls of `Engine.step` in their order, but the one for a number that is not finite.

    Engine or assembly imports each file.
    """
    picture = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    drawn = re.findall(r"^  (\w+) +([\w/]+)\.py  ", picture, re.MULTILINE)
    engine, assembly = (
        ast.parse((ROOT / "companion" / name).read_text(encoding="utf-8"))
        for name in ("engine.py", "assembly.py")
    )
    imported = {
        f"{node.module}{name}"
        for node in (*ast.walk(engine), *ast.walk(assembly))
        if isinstance(node, ast.ImportFrom)
        for name in ("", *(f".{alias.name}" for alias in node.names))
    }
    (step,) = (node for node in ast.walk(engine) if isinstance(node, ast.FunctionDef) and node.name == "step")
    calls = sorted(
        (node.func.lineno, node.func.attr.lstrip("_"))
        for node in ast.walk(step)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    )
    assert [name for _, name in calls if name != "without_motion"] == [name for name, _ in drawn]
    assert all(f"companion.{file.replace('/', '.')}" in imported for _, file in drawn)


def test_what_a_page_shows_is_what_is_said_but_for_its_numbers():
    shown = "depth 3.00 m, -2 mm\n...\nREADY: ...\n"
    assert says(shown, "depth 12.1 m, +4 mm\nheading 3\nREADY: engage\n")
    assert not says(shown, "depth 12.1 cm, +4 mm\nREADY: engage\n")
    assert not says(shown, "depth 12.1 m, +4 mm\nREADY: engage\nIDLE\n")
    assert not says("depth 3 m\nREADY: ...\n", "depth 3 m\nheading 3\nREADY: engage\n")


@cache
def messages():
    """All words of the programs; what is filled in is a gap."""
    texts = (path.read_text(encoding="utf-8") for path in SOURCES if "tests" not in path.parts)
    joined = re.sub(r'"\s*\n\s*f?"', "", "\n".join(texts))
    return re.sub(r"\{[^{}]*\}", "\0", joined)


@pytest.mark.parametrize("page", ["troubleshooting.md", "sitl.md", "tuning.md"])
def test_what_a_page_quotes_is_what_the_program_says(page):
    """Runs of words between numbers, names and colons; firmware and system have words of their own."""
    text = FENCE.sub("", (ROOT / "docs" / page).read_text(encoding="utf-8"))
    begins = re.compile(r"udp port|no |nothing|Nobody|it may|REFUSED|the |a tick|too far|1/lam")
    quotes = [" ".join(quote.split()) for quote in re.findall(r"`([^`]+)`", text)]
    quoted = [quote for quote in quotes if begins.match(quote)]
    assert quoted
    for quote in quoted:
        for part in re.split(r"[:,]|\.\.\.|\S*[\d_]\S*|REFUSED|udp port|^no ", quote):
            if len(part.split()) > 1:
                assert part.strip() in messages(), quote
