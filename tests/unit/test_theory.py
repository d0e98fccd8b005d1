"""docs/theory.md gives the constants of the code: words are made of each and looked for on the page."""

import math
from pathlib import Path

import pytest

from companion.config import Config
from companion.core import hidden_delay, model_learner, oscillation, predictor, schedule, vehicle_model

PAGE = " ".join((Path(__file__).parents[2] / "docs" / "theory.md").read_text(encoding="utf-8").split())

heave, least = Config().heave, oscillation.LEAST
sum_per_s = (
    heave.lambda_per_s * least**schedule.LAMBDA_POWER + heave.kappa_per_s * least**schedule.KAPPA_POWER
)
surge, sway, in_heave, yaw = (f"{100 * share:g} %" for share in oscillation.SHARES)
sure = model_learner.SURE_OF_LESS
most_gain = math.exp(vehicle_model.MOST_LOG_GAIN)

SENTENCES = (
    f"the demand that is faster than {oscillation.HIGH_PASS_S:g} s",
    f"{surge} in surge and sway, {in_heave} in heave, {yaw} in yaw, "
    f"{100 * oscillation.LEVELLING_SHARE:g} % in roll and pitch",
    f"for this time; within {oscillation.CONFIRMED_S:g} s of another limit cycle, or while s is held below 1 "
    f"| {oscillation.TRANSIENT_S:g} s; {oscillation.AGAIN_S:g} s |",
    f"changed its sign meanwhile | {oscillation.SWINGS} times |",
    f"needs no change of sign | {math.sqrt(oscillation.VIOLENT):.1f} times the share |",
    f"| {oscillation.QUICK_SWINGS}; {oscillation.QUICK_S:g} s; {oscillation.QUICK_LEAVES:g} |",
    f"time constant; least value | {oscillation.SHRINK_S:g} s; {least:g} |",
    f"s then returns to 1 | in {oscillation.RECOVER_S:g} s |",
    f"an RMS above {math.sqrt(oscillation.VIOLENT):.1f} times the share confirms a limit cycle, "
    f"or a second one | within {oscillation.CONFIRMED_S:g} s |",
    f"then grows | {oscillation.RELAPSE_SHARE:g}; by {60.0 / oscillation.FORGET_S:g} a minute |",
    f"s^{schedule.LAMBDA_POWER:g}, s^{schedule.KAPPA_POWER:g}, s² |",
    f"its difference from the mean over {oscillation.MEAN_S:g} s, by s² |",
    f"with λ + κ = {sum_per_s:.1f}/s in heave",
    f"λ decreases with the power {schedule.LAMBDA_POWER:g} and κ with the power {schedule.KAPPA_POWER:g}",
    f"r = s · min(1, {schedule.D_HAT_TOLERATED_S:g} s/delay)",
    f"responds less, {sure[0]:g} in surge and sway, {sure[2]:g} in heave, {sure[3]:g} in yaw",
    f"g stays within 1/{most_gain:g}..{most_gain:g}, T within {vehicle_model.LEAST_LAG_S:g}.."
    f"{vehicle_model.MOST_LAG_S:g} s",
    f"limited to 0..{1e3 * hidden_delay.LARGEST_S:g} ms and changes by at most "
    f"{1e3 * hidden_delay.SLEW:g} ms per second",
    f"a memory of {predictor.MEMORY_S:g} s",
    f"the last {predictor.JUDGED_S:g} s: 0 if the prediction's is less than "
    f'{100 * predictor.USED_FROM:g} % below that of "d stays", '
    f"1 if it is {100 * predictor.USED_WHOLLY:g} % below",
    f"is limited to ±{predictor.MOST:g} ",
)


@pytest.mark.parametrize("sentence", SENTENCES)
def test_the_page_has_the_constants_of_the_code(sentence):
    assert sentence in PAGE
