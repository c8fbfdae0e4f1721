"""Options of another law are refused: nothing that is told is taken no notice of."""

from __future__ import annotations

import pytest
from inprocess import call

BAD = (
    ("lqg", "--poles=-5,-6,-7", "--poles: is of placement: lqg takes no notice of it"),
    ("placement", "--weights=psi=0.1", "--weights: is of lqg and arx and identified"),
    ("pi", "--mt=1.3", "--mt: is of pid"),
    ("lqg", "--zeta=0.7", "--zeta: is of pi"),
    ("pid", "--ratio=3", "--ratio: is of lead and lag"),
)


@pytest.mark.parametrize(("law", "option", "says"), BAD)
def test_an_option_of_another_law_is_one_line(law: str, option: str, says: str) -> None:
    code, _, errors = call(("design", law, "--model", "models/hoop.yaml", option))
    assert code == 2 and says in errors and errors.count("\n") == 1


def test_poles_are_of_placement_for_any_plant() -> None:
    code, _, errors = call(("design", "lqg", "--plant", "pendulum", "--poles=-5,-6"))
    assert code == 2 and "--poles: is of placement" in errors
