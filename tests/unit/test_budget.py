"""The sizes that `make check` holds."""

import subprocess

from tools.budget import lowered, over, sizes

BUDGET = {"lab": 10, "lab/studies": 3, "docs": 4}
PROJECT = '[tool.holdfast.budget]\n"lab" = 10\n"lab/studies" = 3\n"docs" = 4\n'


def test_a_folder_over_its_budget_is_named_with_its_lines(tmp_path):
    for name, text in (
        ("lab/a.py", "a = 1\n" * 8),
        ("lab/studies/b.py", "b = 1\n" * 5),
        ("docs/c.md", "four words are here"),
        ("docs/example.py", "not = 1\n"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    counted = sizes(tmp_path, BUDGET)
    assert counted == {"lab": 8, "lab/studies": 5, "docs": 4}
    (line,) = over(BUDGET, counted)
    assert "lab/studies: 5 lines" in line
    assert "is 3: delete 2" in line


def test_only_what_became_smaller_is_lowered_and_a_folder_that_is_gone_is_dropped():
    text = lowered(PROJECT, BUDGET, {"lab": 8, "lab/studies": 5, "docs": 0})
    assert text == '[tool.holdfast.budget]\n"lab" = 8\n"lab/studies" = 3\n'
