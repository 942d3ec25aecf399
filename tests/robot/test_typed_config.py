from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Optional, Tuple

import pytest

from robot.contract import ACTION_TWISTS, ACTION_WHEELS, DRIVE, ImageSpec, PolicyContract
from robot.errors import ConfigError, ContractError
from robot.typed_config import from_plain, load_yaml, read_yaml, to_plain


@dataclass(frozen=True)
class Wheel:
    radius_m: float = 0.03
    name: str = "left"


@dataclass(frozen=True)
class Car:
    wheels: Tuple[Wheel, ...] = (Wheel(), Wheel(name="right"))
    bus: int = 1
    size_m: Tuple[float, float] = (0.1, 0.2)
    model: Optional[str] = None
    armed: bool = False


def test_what_is_written_is_read() -> None:
    car = Car(wheels=(Wheel(0.5),), bus=7, model="a", armed=True)
    assert from_plain(Car, to_plain(car)) == car


def test_absent_keys_keep_their_defaults() -> None:
    assert from_plain(Car, {}) == Car()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"bsu": 1}, "unknown key 'bsu'; did you mean 'bus'"),
        ({"wheels": [{"radius": 1.0}]}, r"wheels\[0\]: unknown key 'radius'; did you mean"),
        ({"bus": "one"}, "bus: expected int, got 'one'"),
        ({"bus": True}, "bus: expected int"),
        ({"size_m": [1.0]}, "expected 2 values, got 1"),
        ({"armed": 1}, "armed: expected bool"),
        ({"model": 3}, "model: expected str"),
        ({"size_m": [1.0, math.nan]}, r"size_m\[1\]: expected float, got nan"),
        ({"size_m": [-math.inf, 1.0]}, r"size_m\[0\]: expected float, got -inf"),
        ({"size_m": [10**400, 1.0]}, r"size_m\[0\]: expected float, got 1000"),
        ([], "expected a mapping"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(data: object, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        from_plain(Car, data)


def test_a_missing_or_broken_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="readable"):
        load_yaml(Car, tmp_path / "none.yaml")
    for text in (b"a: [1", b"a: 2026-99-99", b"[" * 5000, b"\xff\xfe\x00", b"a: \x07"):
        (tmp_path / "bad.yaml").write_bytes(text)
        with pytest.raises(ConfigError, match=r"expected (a )?YAML") as refused:
            load_yaml(Car, tmp_path / "bad.yaml")
        assert "\n" not in str(refused.value), "one line"


def test_policy_contract_survives_json() -> None:
    contract = PolicyContract("lane", "dueling", ImageSpec(80, 60, 20), score=0.5, run="r")
    assert PolicyContract.from_json(contract.to_json()) == contract
    assert contract.image.shape == (40, 80, 3)
    unscored = PolicyContract.from_json(PolicyContract("lane", "ppo").to_json())
    assert unscored.score is None


def test_policy_contract_of_another_schema_is_refused() -> None:
    with pytest.raises(ContractError, match="expected schema 1, got 99"):
        PolicyContract.from_json('{"schema": 99}')
    with pytest.raises(ContractError, match="expected JSON"):
        PolicyContract.from_json("{")


def test_the_action_table_is_symmetric_and_takes_the_tightest_lane() -> None:
    for left, right in zip(ACTION_WHEELS, reversed(ACTION_WHEELS)):
        assert tuple(left) == pytest.approx((right.right_mps, right.left_mps))
    for twist, wheels in zip(ACTION_TWISTS, ACTION_WHEELS):
        assert tuple(DRIVE.twist(wheels)) == pytest.approx(tuple(twist))
    tightest_lane_radius_m = 0.3 * 0.44  # right turns on the arena's 0.44 m tiles
    assert ACTION_TWISTS[0].forward_mps / ACTION_TWISTS[0].turn_radps < 0.6 * tightest_lane_radius_m


@dataclass(frozen=True)
class Sided:
    side: Literal["left", "right"] = "left"


def test_a_literal_is_one_of_its_words() -> None:
    assert from_plain(Sided, {"side": "right"}) == Sided("right")
    with pytest.raises(ConfigError, match="did you mean 'left'"):
        from_plain(Sided, {"side": "lefft"})
    with pytest.raises(ConfigError, match="valid: left, right"):
        from_plain(Sided, {"side": 1})


def test_a_message_stays_short_whatever_a_few_lines_of_yaml_stand_for(tmp_path: Path) -> None:
    """Aliases of aliases: 9**9 items in some hundred bytes."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9)]
    bomb = tmp_path / "bomb.yaml"
    bomb.write_text("\n".join(lines) + "\nside: *a8\n", encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        load_yaml(Sided, bomb)
    assert len(str(refused.value)) < 500
    bomb.write_text("\n".join([*lines, "*a8"]).replace("a0: ", "? ", 1), encoding="utf-8")
    with pytest.raises(ConfigError):
        load_yaml(Sided, bomb)


def test_a_yaml_file_has_four_million_bytes_at_most(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    path.write_bytes(b"#" * 4_000_000)
    assert read_yaml(path) == {}
    path.write_bytes(b"#" * 4_000_001)
    with pytest.raises(ConfigError, match="expected a YAML file of at most 4000000 bytes"):
        read_yaml(path)


def test_a_key_given_twice_is_refused_and_merged_ones_are_not(tmp_path: Path) -> None:
    path = tmp_path / "twice.yaml"
    for text in ("bus: 1\narmed: true\nbus: 7\n", "a: {b: 1,\n x: 2,\n b: 3}\n"):
        path.write_text(text)
        with pytest.raises(ConfigError, match=r"'bu?s?' twice in a mapping .*, line 3,"):
            read_yaml(path)
    path.write_text(
        "a: {b: &w {r: 1}, c: &v {<<: *w, r: 2}}\nd: {<<: [*v, *w], r: 3}\n? [x]\n: 4\n"
    )
    with pytest.raises(ConfigError, match="unhashable"):
        read_yaml(path)
    path.write_text("a: {b: &w {r: 1}, c: &v {<<: *w, r: 2}}\nd: {<<: [*v, *w], r: 3}\nr: 4\n")
    assert read_yaml(path) == {"a": {"b": {"r": 1}, "c": {"r": 2}}, "d": {"r": 3}, "r": 4}


@pytest.mark.parametrize(
    "text",
    [
        "model: !!python/name:os.getcwd ''",
        "model: !!python/object/apply:os.getcwd []",
        "model: !!python/object/new:pathlib.PurePath [a]",
        "!!python/tuple [1, 2]",
    ],
)
def test_a_yaml_file_is_data_and_runs_nothing(tmp_path: Path, text: str) -> None:
    (tmp_path / "robot.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"expected YAML in UTF-8, got: could not determine"):
        read_yaml(tmp_path / "robot.yaml")
