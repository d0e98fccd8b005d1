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

from lab.sources import ROOT, measured_code

FOLDER = ROOT / "docs" / "results"
PAGE = FOLDER.with_suffix(".md")
MARKED = re.compile(r"(<!--(table|made):(\S+)-->\n).*?(<!--end-->)", re.DOTALL)


def filled() -> str:
    """Return the page with the tables of today's files."""
    code = measured_code()

    def shown(marked: re.Match[str]) -> str:
        content = json.loads((FOLDER / f"{marked[3]}.json").read_text(encoding="utf-8"))
        lines = table(content) + "\n" if marked[2] == "table" else ""
        return f"{marked[1]}\n{lines}{made(content['provenance'], code)}\n{marked[4]}"

    return MARKED.sub(shown, PAGE.read_text(encoding="utf-8"))


def table(content: Mapping[str, Any]) -> str:
    """Return a table in Markdown."""
    columns = content["columns"]
    head, *lines = (f"|{'|'.join(line)}|\n" for line in (columns, *content["rows"]))
    return head + "|---" * len(columns) + "|\n" + "".join(lines)


def made(provenance: Mapping[str, str], code: str) -> str:
    """Return what made a table, and whether the code that it measured is still that of the digest `code`."""
    command = re.sub(r" --(out|table|workers) \S+", "", provenance["command"])
    age = "same code" if provenance["code"] == code else "**older code**"
    return f"`{command}`, {provenance['commit']}, {provenance['date']:.10}, {age}\n"
