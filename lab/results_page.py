"""The tables of docs/results.md, from the files in docs/results/.

On a page a table stands between `<!--table:NAME-->` and `<!--end-->`, or, for a picture, what made it
between `<!--made:NAME-->` and `<!--end-->`. Its file, docs/results/NAME.json,
has `columns`, `rows` and the `provenance` of `lab.study`; `holdfast lab bench reality --out docs/results`
makes it.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from holdfast import own_version
from lab.measured_sources import ROOT, measured_code

FOLDER = ROOT / "docs" / "results"
PAGE = FOLDER.with_suffix(".md")
MARKED = re.compile(r"(<!--(table|made):(\S+)-->\n).*?(<!--end-->)", re.DOTALL)


def filled(page: str, stamp: bool = False) -> str:
    """Return the page with the tables of today's files.

    `stamp` says of each whether the code that it measured is that of this version. Otherwise the stamp of a
    table that was not measured again stays.
    """
    code = measured_code()

    def shown(marked: re.Match[str]) -> str:
        content = json.loads((FOLDER / f"{marked[3]}.json").read_text(encoding="utf-8"))
        lines = table(content) + "\n" if marked[2] == "table" else ""
        line = made(content["provenance"])
        stamped = re.search(rf"^{re.escape(line)}(, {own_version()}.*)$", marked[0], re.MULTILINE)
        kept = stamped[1] if stamped else ""
        said = f", {own_version()}: {age(content['provenance'], code)}" if stamp else kept
        return f"{marked[1]}\n{lines}{line}{said}\n\n{marked[4]}"

    return MARKED.sub(shown, page)


def table(content: Mapping[str, Any]) -> str:
    """Return a table in Markdown."""
    columns = content["columns"]
    head, *lines = (f"|{'|'.join(line)}|\n" for line in (columns, *content["rows"]))
    return head + "|---" * len(columns) + "|\n" + "".join(lines)


def made(provenance: Mapping[str, str]) -> str:
    """Return what made a table."""
    command = re.sub(r" --(out|table|workers) \S+", "", provenance["command"])
    return f"`{command}`, {provenance['commit']}, {provenance['date']:.10}"


def age(provenance: Mapping[str, str], code: str) -> str:
    """Return whether the code that a table measured is still that of the digest `code`."""
    return "same code" if provenance["code"] == code else "**older code**"
