"""What a page of the documents shows as a command's output, as a pattern for what the command says."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"^```\n(.*?)^```", re.DOTALL | re.MULTILINE)
NUMBER = r"[+-]?\d[\d.]*"


def output(page: str, begins: str) -> str:
    """Return the block of a page under docs/ that has a line which begins so."""
    blocks = BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))
    (found,) = (text for text in blocks if re.search(rf"^{re.escape(begins)}", text, re.MULTILINE))
    return str(found)


def says(shown: str, said: str) -> bool:
    """Whether a command said what is shown: numbers and commits are free, and what stands for `...`."""
    lines = [_line(line) for line in shown.rstrip("\n").split("\n")]
    heard = "\n".join(line.rstrip() for line in said.rstrip("\n").split("\n"))
    return re.fullmatch("".join(lines), f"{heard}\n") is not None


def _line(line: str) -> str:
    if line == "...":
        return r"(?:.*\n)*?"
    text, rest = (line.removesuffix("..."), ".*") if line.endswith("...") else (line, "")
    text = re.sub(r"\([0-9a-f]{12}\)", "(\0)", re.sub(r"\d{8}T\d{6}Z", "\1", text))
    text = re.sub(rf"(?<!\w){NUMBER}", "\2", text.rstrip())
    pattern = re.escape(text).replace("\0", r"[0-9a-f]*(?:-dirty)?").replace("\1", r"\w+")
    return re.sub(r"(?:\\ |─)+", r"[ ─]+", pattern).replace("\2", NUMBER) + rest + r"\n"
