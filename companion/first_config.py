"""What `holdfast init` asks, and the configuration that follows from the answers. No terminal."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from companion.config import DEFAULT_FILE, PRESETS, presets
from companion.config_text import with_values

TEMPLATE = "custom"
"""The file of `config/vehicles/` that is there to be copied."""


class Choice(NamedTuple):
    """One answer: the word for it, what it means, and the keys that it sets."""

    word: str
    meaning: str
    values: Mapping[str, str]


class Question(NamedTuple):
    """One question; its option of the command line has its name. The first choice is the default.

    Where there are no `choices`, the answer is the value of `key`.
    """

    name: str
    text: str
    choices: tuple[Choice, ...] = ()
    key: str = ""
    default: str = ""


def _preset(name: str) -> Choice:
    first_line = (PRESETS / f"{name}.toml").read_text(encoding="utf-8").partition("\n")[0]
    return Choice(name, first_line.lstrip("# ").partition(". ")[0], {"vehicle.preset": name})


def questions() -> tuple[Question, ...]:
    """Return what is asked, in order."""
    names = sorted(set(presets()) - {TEMPLATE}, key=lambda name: (name != "heavy", name))
    return (
        Question("vehicle", "Which vehicle is it?", tuple(map(_preset, names))),
        Question("name", "What is it called? The name stands in telemetry.", (), "vehicle.name", "bluerov2"),
        Question(
            "where",
            "Where does Holdfast run?",
            (
                Choice("simulator", "beside `holdfast sim`", {"link.endpoint": "udp-listen:127.0.0.1:14550"}),
                Choice("blueos", "on the vehicle's BlueOS", {"link.endpoint": "tcp:127.0.0.1:5777"}),
                Choice(
                    "extension",
                    "in the BlueOS extension",
                    {"link.endpoint": "udp-connect:host.docker.internal:14550"},
                ),
                Choice(
                    "topside",
                    "on a computer to which BlueOS sends MAVLink",
                    {"link.endpoint": "udp-listen:0.0.0.0:14550"},
                ),
            ),
        ),
        Question(
            "holds",
            "What does Holdfast hold?",
            (
                Choice(
                    "depth",
                    "depth; the firmware keeps roll, pitch and heading (STABILIZE): for a first dive",
                    {"vehicle.steering_mode": "stabilize"},
                ),
                Choice(
                    "all",
                    "depth, heading, roll and pitch (MANUAL), and the position where one is measured",
                    {"vehicle.steering_mode": "manual"},
                ),
            ),
        ),
        Question(
            "control",
            "Who may send commands, such as `holdfast tell`?",
            (
                Choice("local", "programs on the same computer", {"telemetry.allow_control": "local"}),
                Choice("always", "everybody who reaches its Zenoh", {"telemetry.allow_control": "always"}),
                Choice("never", "nobody", {"telemetry.allow_control": "never"}),
            ),
        ),
    )


def prompt(question: Question) -> str:
    """Return a question with its choices, as people see it."""
    if not question.choices:
        return f"{question.text} [{question.default}] "
    width = max(len(choice.word) for choice in question.choices)
    choices = "".join(
        f"  {number}  {choice.word:{width}}  {choice.meaning}\n"
        for number, choice in enumerate(question.choices, 1)
    )
    return f"{question.text}\n{choices}Number or word [{question.choices[0].word}] "


def values_of(question: Question, answer: str) -> Mapping[str, str]:
    """Return the keys that an answer sets; an empty one is the default. Raises ValueError for no answer."""
    answer = answer.strip()
    if not question.choices:
        return {question.key: answer or question.default}
    words = [choice.word for choice in question.choices]
    if answer.isdecimal() and 1 <= int(answer) <= len(words):
        answer = words[int(answer) - 1]
    if answer and answer not in words:
        raise ValueError(f"--{question.name} {answer}: want one of {', '.join(words)}")
    return question.choices[words.index(answer) if answer else 0].values


def answered(given: Mapping[str, str | None], ask: Callable[[Question], str] | None) -> dict[str, str]:
    """Return the keys that all answers set: those `given` by name, and of the others what `ask` returns.

    Without `ask` the others are the defaults. `ask` is called again for an answer that is none.
    """
    values: dict[str, str] = {}
    for question in questions():
        answer = given.get(question.name)
        if answer is not None or ask is None:
            values |= values_of(question, answer or "")
            continue
        while True:
            try:
                values |= values_of(question, ask(question))
                break
            except ValueError:
                continue
    return values


def config_text(values: Mapping[str, str]) -> str:
    """Return the shipped configuration, comments and all, with these values."""
    return with_values(DEFAULT_FILE.read_text(encoding="utf-8"), values)
