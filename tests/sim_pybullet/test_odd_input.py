"""Maps, looks, scenarios and arguments that are wrong or rare: refused clearly, or served."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot.contract import ImageSpec
from robot.errors import DuckpilotError
from robot.geometry import wrap_angle
from robot.navigation.map_objects import objects_of
from robot.navigation.road_map import read_map
from sim_pybullet.env import make, make_world
from sim_pybullet.racing.track import TRACKS_DIR, Segment, Track, is_track
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.vec_env import DuckpilotVecEnv

SMALL: dict[str, Any] = {"image": ImageSpec(8, 6, 2), "pool_size": 1}
MAPS = Path(__file__).parents[2] / "robot" / "maps"
RING = [["curve_left/W", "curve_left/N"], ["curve_left/S", "curve_left/E"]]
FLAGS = ("static: false", "optional: true")


@pytest.mark.parametrize(
    ("task", "choices", "told"),
    [
        ("track", {"style": "rice", "road_map": "karting"}, "did you mean 'race'"),
        ("lane", {"lane": 3}, "lane"),
        ("lane", {"laps": float("nan")}, "laps"),
        ("lane", {"laps": "two"}, "laps"),
        ("lane", {"lanes": "inner"}, "did you mean 'lane'"),
        ("lane", {"world_seed": -1}, "world_seed: expected 0"),
        ("lane", {"pool_size": 0}, "pool_size: expected 1"),
    ],
)
def test_what_a_task_cannot_use_is_refused(task: str, choices: Any, told: str) -> None:
    with pytest.raises(DuckpilotError, match=told):
        make(task, **{**SMALL, **choices})


def test_maps_and_scenarios_may_be_paths(tmp_path: Path) -> None:
    (tmp_path / "nobody.yaml").write_text("robots_pcs: [ego]\n")
    make("lane", road_map=MAPS / "loop.yaml", **SMALL).close()
    make("traffic", scenario=tmp_path / "nobody.yaml", **SMALL).close()


@pytest.mark.parametrize("maps", [None, {"loop": 1}, iter(["loop"])])
def test_maps_may_be_any_collection_and_choices_numpys(maps: Any) -> None:
    world = make_world("lane", road_map=maps, laps=np.int64(2), start_spread=np.float32(1), **SMALL)
    assert [each.name for each in world.task.road_maps] == ["loop"]
    world.close()


@pytest.mark.parametrize(
    ("look", "without"),
    [
        ("light:\n", ["light"]),
        ("light: 5\n", ["light"]),
        ("- light\n", ["light"]),
        ("ground: {texture_seed: -1}\n", []),
        ("clutter: {boxes: {integer: [0, .inf]}}\n", []),
        (f"ground: {{wear: {{uniform: [0, 1{'0' * 400}]}}}}\n", []),
        ("ground: {asphalt_rgb: {grey: [50, 60, .inf]}}\n", []),
    ],
)
def test_looks_that_cannot_be_are_refused(tmp_path: Path, look: str, without: list[str]) -> None:
    (tmp_path / "look.yaml").write_text(look)
    with pytest.raises(DuckpilotError):
        load_look_sampler(tmp_path / "look.yaml", without=without)


def test_a_tile_in_centimetres_is_refused() -> None:
    with pytest.raises(DuckpilotError, match=r"at most 5 m, got 58\.5"):
        read_map({"tile_size": 58.5, "tiles": RING}, "ring")


@pytest.mark.parametrize("height_m", [80, 1e308])
def test_things_as_high_as_towers_are_refused(height_m: float) -> None:
    things = [{"kind": "duckie", "pos": [1, 1], "height": height_m}]
    road_map = read_map({"tile_size": 0.585, "tiles": RING, "objects": things}, "ring")
    with pytest.raises(DuckpilotError, match="at most 10 m"):
        objects_of(road_map)


def test_a_ring_full_of_things_is_refused(tmp_path: Path) -> None:
    text = "tile_size: 0.44\ntiles:\n- [curve_left/W, curve_left/N]\n- [curve_left/S, curve_left/E]"
    around = [1.0 + 0.7 * np.exp(1j * angle) for angle in np.arange(0.0, 6.28, 0.5)]
    ducks = [f"- {{kind: duckie, pos: [{at.real:.3f}, {at.imag:.3f}]}}" for at in around]
    (tmp_path / "full.yaml").write_text("\n".join((text, "objects:", *ducks)))
    world = make_world("lane", road_map=str(tmp_path / "full.yaml"), **SMALL)
    with pytest.raises(DuckpilotError, match="expected room to begin"):
        world.reset()
    world.close()


@pytest.mark.parametrize("flag", FLAGS)
def test_nobody_begins_in_what_may_stand_in_the_lane(tmp_path: Path, flag: str) -> None:
    things, path = ["objects:"], make_world("lane", **SMALL).task.paths
    for x_m, y_m in path.points_at(np.arange(8)[None] * path.length_m[0] / 8)[0].tolist():
        place = f"[{x_m / 0.585:.3f}, {4 - y_m / 0.585:.3f}]"
        things.append(f"- {{kind: duckiebot, pos: {place}, {flag}}}")
    text = "\n".join(((MAPS / "loop.yaml").read_text(), *things))
    (tmp_path / "loop.yaml").write_text(text)
    world = make_world("lane", 24, tmp_path / "loop.yaml", **SMALL)
    world.reset()
    assert not world.step(np.full(24, 2)).collided.any()
    world.close()


@pytest.mark.parametrize("town", ["hamlet", "town"])
def test_a_pose_in_a_junction_is_on_the_way_that_it_heads_for(town: str) -> None:
    world = make_world("traffic_junctions", road_map=town, scenario="lf", **SMALL)
    rng = np.random.default_rng(0)
    for way in world.task.streets.tours[0]:  # type: ignore[attr-defined]
        for arc_m in np.arange(0.0, way.length_m, 0.25):
            at = way.pose_at(arc_m)
            x_m, y_m = at.to_world(np.array((0.0, rng.uniform(-0.03, 0.03)))).tolist()
            world.task.reset_at(np.array([0]), np.array([(x_m, y_m, at.heading_rad)]), rng)
            assert abs(float(wrap_angle(world.task.course.heading_error_rad[0]))) < 0.6
    world.close()


def test_cars_without_headway_stay_on_the_road(tmp_path: Path) -> None:
    (tmp_path / "close.yaml").write_text("robots_npcs: [a, b, c]\nnpc_headway_s: [0, 0]\n")
    env = make("traffic", scenario=str(tmp_path / "close.yaml"), **SMALL)
    env.reset(seed=1)
    for _ in range(60):
        env.step(6)
        assert np.isfinite(env.world.task.crowd.drivers.poses).all()  # type: ignore[attr-defined]
    env.close()


def test_a_track_without_an_angle_is_refused() -> None:
    with pytest.raises(DuckpilotError, match="above 0"):
        Track("round", (Segment(radius_m=30.0),))


def test_only_a_mapping_with_segments_is_a_track(tmp_path: Path) -> None:
    (tmp_path / "number.yaml").write_text("5\n")
    assert not is_track(tmp_path / "number.yaml")
    assert is_track(TRACKS_DIR / "karting.yaml")


def test_stable_baselines3_may_say_where_robots_begin() -> None:
    envs = DuckpilotVecEnv(make_world("lane", 2, **SMALL))
    envs.set_options({"pose": (1.5, 0.175, 0.0)})
    envs.reset()
    np.testing.assert_allclose(envs.world.poses, [(1.5, 0.175, 0.0)] * 2, atol=1e-9)
    envs.reset()  # for once only
    assert abs(envs.world.poses[0, 0] - 1.5) > 1e-6
    envs.close()
