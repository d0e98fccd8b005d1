"""Every link in the documents leads somewhere, and what they quote is what the program says."""

import re
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path

import pytest

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


def test_every_page_of_the_site_stands_in_its_contents():
    site = ROOT / "docs"
    contents = [
        line for block in FENCE.findall((site / "index.md").read_text()) for line in block.splitlines()
    ]
    listed = {page for line in contents if re.match(r"\w", line) for page in site.glob(f"{line}.md")}
    assert {page for page in site.rglob("*.md") if page.name != "index.md"} == listed


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


def test_troubleshooting_names_conditions():
    text = (ROOT / "docs" / "troubleshooting.md").read_text()
    part = text[text.index("| condition |") : text.index("## It holds badly")]
    named = re.findall(r"^\| ([A-Z ]+) \|", part, re.MULTILINE)
    assert len(named) > 8
    assert set(named) <= {title(condition.name or "") for condition in Condition}
