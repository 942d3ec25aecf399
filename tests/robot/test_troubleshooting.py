"""The manual names what the robot can say."""

from __future__ import annotations

import re

import pytest

from robot.cli import COMMANDS
from robot.cli.install import ROOT
from robot.safety.gates import Reason
from robot.safety.state_machine import HOLDS, State

TROUBLESHOOTING = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", TROUBLESHOOTING, re.M | re.S))
AT_REST = (Reason.BOOT, Reason.PERSON)


def test_every_reason_has_its_section_and_no_section_is_left_over() -> None:
    assert set(SECTIONS) == {reason.value for reason in Reason}


@pytest.mark.parametrize("reason", [r for r in Reason if r not in AT_REST])
def test_each_section_says_the_state_that_its_reason_leads_to(reason: Reason) -> None:
    state = State.HOLD if reason in HOLDS else State.FAULT
    said = SECTIONS[reason.value].split(".")[0]
    in_parts = TROUBLESHOOTING.index(f"### `{reason.value}`") > TROUBLESHOOTING.index(
        "All are FAULT."
    )
    assert said == state.value or (in_parts and state is State.FAULT)


@pytest.mark.parametrize("page", ["first-drive.md", "troubleshooting.md"])
def test_the_pages_name_no_command_that_does_not_exist(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    named = set(re.findall(r"(?:-m robot|[`\n]duckpilot) ([a-z]+)\b", text))
    assert len(named) > 2
    assert named <= {*COMMANDS, "localizer", "monitor"}
