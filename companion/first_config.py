"""What `holdfast init` asks; the configuration follows from the answers. No terminal."""

from typing import NamedTuple

from companion.config import PRESET_KEY, PRESETS, presets

TEMPLATE = "custom"
"""The file of `config/vehicles/` that is there to be copied."""


class Choice(NamedTuple):
    """One answer: the word for it, what it means, and the value that it sets."""

    word: str
    meaning: str
    value: str


class Question(NamedTuple):
    """One question, whose answer is the value of `key`; its option of the command line has its `name`.

    The first of the choices is the default. Where there are none, the answer is the value.
    """

    name: str
    text: str
    key: str
    choices: tuple[Choice, ...] = ()
    default: str = ""

    @property
    def prompt(self) -> str:
        """The question with its choices, as people see it."""
        if not self.choices:
            return f"{self.text} [{self.default}] "
        width = max(len(choice.word) for choice in self.choices)
        rows = (
            f"  {number}  {choice.word:{width}}  {choice.meaning}\n"
            for number, choice in enumerate(self.choices, 1)
        )
        return f"{self.text}\n{''.join(rows)}Number or word [{self.choices[0].word}] "

    def value(self, answer: str) -> str:
        """Return the value of an answer; of an empty one the default. Raises ValueError for no answer."""
        if not self.choices:
            return answer or self.default
        for number, choice in enumerate(self.choices, 1):
            if answer in ("", choice.word, str(number)):
                return choice.value
        words = ", ".join(choice.word for choice in self.choices)
        raise ValueError(f"--{self.name} {answer}: want one of {words}")


def questions() -> tuple[Question, ...]:
    """Return what is asked, in order."""
    names = sorted(set(presets()) - {TEMPLATE}, key=lambda name: (name != "heavy", name == "ardusub", name))
    return (
        Question("vehicle", "Which vehicle is it?", PRESET_KEY, tuple(map(_preset, names))),
        Question("name", "What is it called? The name stands in telemetry.", "vehicle.name", (), "bluerov2"),
        Question(
            "where",
            "Where does Holdfast run?",
            "link.endpoint",
            (
                Choice("simulator", "beside `holdfast sim`", "udp-listen:127.0.0.1:14550"),
                Choice("blueos", "on the vehicle's BlueOS", "tcp:127.0.0.1:5777"),
                Choice("pi", "on a plain Raspberry Pi, by its serial line", "serial:/dev/ttyAMA0:921600"),
                Choice("extension", "in the BlueOS extension", "udp-connect:host.docker.internal:14550"),
                Choice("topside", "where BlueOS sends MAVLink", "udp-listen:0.0.0.0:14550"),
            ),
        ),
        Question(
            "holds",
            "What does Holdfast hold?",
            "vehicle.steering_mode",
            (
                Choice("depth", "depth; the firmware keeps the rest: for a first dive", "stabilize"),
                Choice("all", "depth, heading, roll, pitch, and the position where there is one", "manual"),
            ),
        ),
        Question(
            "control",
            "Who may send commands, such as `holdfast tell`?",
            "telemetry.allow_control",
            (
                Choice("local", "programs on the same computer", "local"),
                Choice("always", "everybody who reaches its Zenoh", "always"),
                Choice("never", "nobody", "never"),
            ),
        ),
    )


def places() -> list[list[str]]:
    """Return the endpoints on which a vehicle is looked for, those of one port or device together."""
    where = next(question for question in questions() if question.name == "where")
    groups: dict[str, list[str]] = {}
    for choice in where.choices:
        kind, _, place = choice.value.partition(":")
        if kind != "serial":
            groups.setdefault(f"{kind} {place.rpartition(':')[2]}", []).append(choice.value)
    return list(groups.values())


def proposing(asked: Question, value: str) -> Question:
    """Return a question whose first choice, which Enter takes, has a value that was found."""
    if not value or not asked.choices:
        return asked
    there = [choice for choice in asked.choices if choice.value == value]
    first = there[0] if there else Choice("found", f"where it is heard, {value}", value)
    return asked._replace(choices=(first, *(choice for choice in asked.choices if choice is not first)))


def _preset(name: str) -> Choice:
    first_line = (PRESETS / f"{name}.toml").read_text(encoding="utf-8").partition("\n")[0]
    return Choice(name, first_line.lstrip("# ").partition(". ")[0], name)
