"""What the clean environments of ``make package`` are filled with."""

from pathlib import Path

import pytest

from tests.package import asked_for


def test_extras_and_what_they_ask_for_are_followed() -> None:
    plain = asked_for(["uvicorn>=0.30"], {""})
    assert {"uvicorn", "h11", "click"} <= plain
    assert "websockets" not in plain
    assert "websockets" in asked_for(["uvicorn[standard]>=0.30"], {""})
    ours = ["uvicorn>=0.30; extra == 'monitor'", "numpy>=1.24", "tomli; python_version < '3.0'"]
    assert asked_for(ours, {""}) == {"numpy"}
    assert "uvicorn" in asked_for(ours, {"monitor"})


def test_a_version_that_the_metadata_rule_out_is_noticed() -> None:
    with pytest.raises(AssertionError, match="numpy>=99"):
        asked_for(["numpy>=99"], {""})


def test_an_image_installs_the_program_once_its_sources_have_come() -> None:
    stages = (Path(__file__).parents[1] / "Dockerfile").read_text("utf-8").split("\nFROM ")[1:]
    assert len(stages) == 2
    for stage in stages:  # an editable install finds no package before, and says nothing
        assert stage.rfind("\nCOPY ") < stage.rfind("pip install ") < stage.rfind("--editable .")
