"""The comparison of what teaches how much: every variant, with next to no learning."""

import argparse
from pathlib import Path

from tests import thorough
from tests.trainer.compare_teach import VARIANTS, compare


@thorough.only
def test_every_variant_is_taught_and_judged_once(tmp_path: Path) -> None:
    """The floor is driven once; what is done already is not done again."""
    options = argparse.Namespace(
        base="lane_dueling",
        floors=["lab_nominal"],
        map="rings/claw",
        elsewhere=["rings/fish"],
        seconds=30.0,
        drives=1,
        steps=4,
        updates=2,
        seeds=1,
    )
    first, *others = compare(options, tmp_path, {("lab_nominal", VARIANTS[-1], 0)})
    assert [first["variant"], *(row["variant"] for row in others)] == list(VARIANTS[:-1])
    assert {row["rings/fish"] for row in others} <= {0, 1}
    made = (tmp_path / "lab_nominal" / "parsing" / "0").iterdir()
    assert {"parser", "sim_to_real.onnx", "sheet.png"} <= {each.name for each in made}
    everything = {("lab_nominal", variant, 0) for variant in VARIANTS}
    assert not list(compare(options, tmp_path, everything))
