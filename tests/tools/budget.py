"""Holds the size of each package: `python -m tests.tools.budget`, which `make check` calls.

`[tool.holdfast.budget]` of pyproject.toml names folders with their largest number of lines of Python. A
folder named there counts for itself, not for the one around it. `docs` counts the words of Markdown, without
what `holdfast lab schema` makes. `--set`, for a release, writes SLACK more than today's sizes; a folder that
is gone leaves the table.
"""

import argparse
import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path

PRODUCTION = ("companion", "dashboard", "holdfast", "lab", "sim_bridge")
SLACK = 1.05
MADE = re.compile(r"<!-- ?[Mm]ade by.*|<!--table:.*?<!--end-->", re.DOTALL)
"""What `holdfast lab schema --write` makes: the rest of a page, or a table."""


def sizes(root, folders):
    """Return the lines of Python of each folder (of `docs` the words of Markdown)."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py", "*.md"],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    counted = dict.fromkeys(folders, 0)
    for name in listed.stdout.splitlines():
        owners = [folder for folder in folders if name.startswith(f"{folder}/")]
        file = root / name
        words = name.startswith("docs/")
        if not owners or not file.is_file() or words != name.endswith(".md"):
            continue
        text = file.read_text()
        counted[max(owners, key=len)] += len(MADE.sub("", text).split()) if words else text.count("\n")
    return counted


def over(budget, counted):
    """Return a line for each folder over its budget."""
    return [
        f"{folder} has {counted[folder]} {'words' if folder == 'docs' else 'lines'}, "
        f"{counted[folder] - limit} too many. Delete as many; or write '\"{folder}\" = {counted[folder]}' in "
        "[tool.holdfast.budget] of pyproject.toml, and the reason in the message of the commit"
        for folder, limit in budget.items()
        if counted[folder] > limit
    ]


def renewed(text, budget, counted):
    """Return the text of pyproject.toml with SLACK more than today's sizes."""
    for folder, limit in budget.items():
        row = f'"{folder}" = {math.ceil(SLACK * counted[folder])}\n' if counted[folder] else ""
        text = re.sub(rf'^"{folder}" = {limit}\n', row, text, flags=re.MULTILINE)
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--set", action="store_true", help="write 5 %% more than today's sizes")
    options = parser.parse_args()
    project = Path("pyproject.toml")
    text = project.read_text()
    budget = tomllib.loads(text)["tool"]["holdfast"]["budget"]
    counted = sizes(Path(), budget)
    if options.set:
        project.write_text(renewed(text, budget, counted))
        return 0
    total = sum(lines for folder, lines in counted.items() if folder.partition("/")[0] in PRODUCTION)
    sys.stdout.write(
        f"{total} lines of production Python; tests {counted['tests']}, docs {counted['docs']} words\n"
    )
    excess = over(budget, counted)
    sys.stderr.writelines(f"over budget: {line}\n" for line in excess)
    return int(bool(excess))


if __name__ == "__main__":
    sys.exit(main())
