"""What the clean environments of ``make package`` are filled with."""

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
