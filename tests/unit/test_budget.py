"""The budget of lines: what a contributor is told, and what it does not count."""

import subprocess
from pathlib import Path

from tools import budget


def test_who_is_over_is_told_which_line_to_change() -> None:
    (said,) = budget.over({"lab": 10, "docs": 5}, {"lab": 12, "docs": 5})
    assert said.startswith("lab has 12 lines, 2 too many. Delete as many; or write '\"lab\" = 12' in [tool.")
    assert "pyproject.toml, and the reason in the message of the commit" in said


def test_what_is_made_is_not_counted(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    for name, text in {
        "docs/page.md": "two words\n<!-- made by `holdfast` -->\nany number of words",
        "docs/results.md": "one\n<!--table:waves-->\n|1|2 3|\n<!--end-->\ntwo",
        "lab/code.py": "a = 1\nb = 2\n",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert budget.sizes(tmp_path, {"docs": 9, "lab": 9}) == {"docs": 4, "lab": 2}
    text = '"docs" = 9\n"lab" = 9\n"gone" = 9\n'
    renewed = budget.renewed(text, {"docs": 9, "lab": 9, "gone": 9}, {"docs": 100, "lab": 2, "gone": 0})
    assert renewed == '"docs" = 105\n"lab" = 3\n'
