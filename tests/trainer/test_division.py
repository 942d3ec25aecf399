"""Nothing is learned or chosen where policies are judged."""

import shutil
from pathlib import Path

import pytest
import yaml

from robot.errors import ConfigError
from robot.navigation.road_map import MAPS_FOLDER, ROAD_SIDES, load_map, read_map, shipped_maps
from sim_pybullet.randomise import LOOKS_DIR
from trainer.cli import main
from trainer.division import (
    division,
    fingerprint,
    maps_named,
    part_of,
    refuse_judging_look,
    refuse_judging_maps,
)
from trainer.envs import make_env
from trainer.options import TrainOptions
from trainer.presets import preset

JUDGING = MAPS_FOLDER / "judging" / "rings" / "zed.yaml"


def test_every_shipped_map_belongs_to_one_part_and_no_two_parts_share_roads() -> None:
    maps = division().maps
    parts = {"training": maps.training, "choosing": maps.choosing, "judging": maps.judging}
    listed = [name for names in parts.values() for name in names]
    assert sorted(listed) == sorted(shipped_maps())
    outside = [line.split()[1] for line in division().outside]
    prints = [*(fingerprint(load_map(name)) for name in listed), *outside]
    assert len(set(prints)) == len(prints)
    for part, names in parts.items():
        assert {part_of(load_map(name)) for name in names} == {part}


def test_there_is_enough_to_learn_on_and_to_judge_by() -> None:
    maps = division().maps
    assert sum(name.startswith("judging/rings/") for name in maps.judging) >= 8
    assert sum(name.startswith("judging/towns/") for name in maps.judging) >= 4
    assert {"town", "arena"} <= set(maps.choosing)
    assert {name for name in maps.training if name.startswith("rings/")} >= {"rings/zigzag"}
    sizes = {load_map(n).tile_size_m for n in maps.judging if "rings" in n}
    assert min(sizes) <= 0.45
    assert max(sizes) >= 0.61


def test_the_named_files_of_others_are_known_by_their_roads(data_dir: Path) -> None:
    files = {path.stem: path for path in (data_dir / "maps").rglob("*.yaml")}
    for line in division().outside:
        name, digits = line.split()
        assert fingerprint(load_map(files[name])) == digits
        assert part_of(load_map(files[name])) == "judging"
    assert part_of(load_map(files["small_loop"])) is None
    assert part_of(load_map(files["calibration_map_int"])) is None  # no roads at all


def _turned(tiles: list[list[str]]) -> list[list[str]]:
    """The map after a quarter turn counter-clockwise, written by hand."""
    turn = {"S": "E", "E": "N", "N": "W", "W": "S"}
    rows, columns = len(tiles), len(tiles[0])
    new = [[tiles[i][columns - 1 - j] for i in range(rows)] for j in range(columns)]
    return [[_spelt(tile, turn) for tile in row] for row in new]


def _mirrored(tiles: list[list[str]]) -> list[list[str]]:
    """The map in a mirror that hangs in the east; a left bend becomes a right one."""
    pairs = (("curve_left", "curve_right"), ("3way_left", "3way_right"))
    twin = {**dict(pairs), **{right: left for left, right in pairs}}
    swap = {"E": "W", "W": "E", "N": "N", "S": "S"}
    rows = [[_spelt(tile, swap) for tile in reversed(row)] for row in tiles]
    return [[_replaced(tile, twin) for tile in row] for row in rows]


def _spelt(tile: str, orientations: dict[str, str]) -> str:
    kind, slash, orientation = (part.strip() for part in tile.partition("/"))
    return f"{kind}/{orientations[orientation]}" if slash and kind in ROAD_SIDES else tile


def _replaced(tile: str, kinds: dict[str, str]) -> str:
    kind, slash, orientation = (part.strip() for part in tile.partition("/"))
    return kinds.get(kind, kind) + slash + orientation


@pytest.mark.parametrize("name", ["judging/rings/zed", "judging/towns/delta", "town", "hamlet"])
def test_a_copy_is_the_same_map_however_it_lies_and_another_is_not(name: str) -> None:
    data = yaml.safe_load(shipped_maps()[name].read_text(encoding="utf-8"))
    known = fingerprint(load_map(name))
    tiles = data["tiles"]
    border = [["grass"] * (len(tiles[0]) + 1), *[[*row, "asphalt"] for row in tiles]]
    once = _turned(tiles)
    for same in (border, once, _turned(once), _turned(_turned(once)), _mirrored(tiles)):
        assert fingerprint(read_map({"tiles": same, "tile_size": 0.3}, "copy")) == known
    less = [*tiles[:-1], ["floor"] * len(tiles[0])]
    assert fingerprint(read_map({"tiles": less, "tile_size": 0.585}, "other")) != known


@pytest.mark.parametrize("option", ["--map", "--judge-map"])
@pytest.mark.parametrize("what", ["judging/rings/zed", "judging/rings", "copy"])
def test_training_refuses_judging_maps_by_name_folder_and_content(
    option: str, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "mine.yaml"
    shutil.copy(JUDGING, copy)
    name = str(copy) if what == "copy" else what
    out = tmp_path / "run"
    assert main(["train", "--preset", "debug", "--out", str(out), option, name]) == 2
    said = capsys.readouterr().err
    assert "kept for judging policies" in said
    assert "train on loop" in said
    assert "choose on" in said
    assert not out.exists()


def test_translators_and_parsers_learn_from_no_judging_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "frames"
    asked = ["collect", "--out", str(out), "--map", "judging/towns", "--frames", "2"]
    assert main(asked) == 2
    assert "expected one to learn on" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("option", ["--look", "--judge-look"])
@pytest.mark.parametrize("what", ["reality", "reality/lab", "copy"])
def test_training_refuses_judging_looks_by_name_and_content(
    option: str, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "mine.yaml"
    shutil.copy(LOOKS_DIR / "reality" / "hall.yaml", copy)
    name = str(copy) if what == "copy" else what
    out = tmp_path / "run"
    assert main(["train", "--preset", "debug", "--out", str(out), option, name]) == 2
    said = capsys.readouterr().err
    assert "kept for judging policies" in said or "kept for judging" in said
    assert "randomised" in said
    assert not out.exists()


@pytest.mark.parametrize("order", [1, -1])
def test_one_judging_map_or_look_among_others_is_refused(order: int, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="got zed, whose roads"):
        refuse_judging_maps([load_map("loop"), load_map("judging/rings/zed")][::order])
    names = ("a.yaml", "b.yaml")[::order]
    (tmp_path / names[0]).write_text("ground: {brightness: 0.9}")
    refuse_judging_look(str(tmp_path))
    shutil.copy(LOOKS_DIR / "reality" / "hall.yaml", tmp_path / names[1])
    with pytest.raises(ConfigError, match="kept for judging"):
        refuse_judging_look(str(tmp_path))


def test_a_config_that_was_edited_by_hand_is_refused_where_the_world_is_made() -> None:
    from dataclasses import replace

    config = replace(preset("lane", "ppo", "debug"), maps=("judging/rings/hat",))
    with pytest.raises(ConfigError, match="kept for judging"):
        make_env(config, 1, 0)


def test_a_folder_of_shipped_maps_stands_for_all_of_them() -> None:
    assert maps_named(["loop", "judging/towns/"]) == (
        "loop",
        "judging/towns/delta",
        "judging/towns/knot",
        "judging/towns/ribs",
        "judging/towns/weave",
    )
    assert maps_named(["my.yaml"]) == ("my.yaml",)
    assert "rings/bean" in TrainOptions(map=("rings",)).config().maps


def test_shipped_presets_learn_and_choose_outside_the_judging_part() -> None:
    for task in ("lane", "navigation"):
        for name in preset(task, "ppo", "fast").maps:
            assert part_of(load_map(name)) in ("training", "choosing")
