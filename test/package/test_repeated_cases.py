"""What `make test` leaves out is named as it is called."""

from __future__ import annotations

import re
from pathlib import Path

from repeated_cases import ONE_CASE, USUAL_METHODS

from stab_ros.methods import METHODS

TESTS = Path(__file__).parents[1]


def test_every_test_of_one_case_is_there_and_has_several() -> None:
    text = "\n".join(path.read_text() for path in TESTS.rglob("test_*.py"))
    several = r"^@(?:pytest\.mark\.parametrize\(|every_)(?:.|\n)*?^def (test_\w+)"
    parametrised = {*re.findall(several, text, re.MULTILINE)}
    assert parametrised >= ONE_CASE


def test_usual_methods_are_methods() -> None:
    assert {*METHODS} > USUAL_METHODS
