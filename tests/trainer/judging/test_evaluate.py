import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from robot.contract import Action, ImageSpec, PolicyContract
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy
from robot.navigation.road_map import load_map
from sim_pybullet import episodes
from sim_pybullet.batch import DriveMetrics
from sim_pybullet.look import NOMINAL
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.manoeuvres import Manoeuvres
from trainer.cli import main
from trainer.export import export_network
from trainer.judging import blocks, judge
from trainer.judging.evaluate import Drive, open_policy, ridden, summarise
from trainer.judging.intervals import share
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy
from trainer.options import EvaluateOptions
from trainer.presets import preset


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "untrained.onnx"
    config = preset("lane", "ddqn", "debug")
    contract = PolicyContract("lane", "ddqn", config.image)
    export_network(GreedyNetwork(build_policy(config)), contract, path)
    return path


@pytest.fixture(scope="module")
def navigator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "untrained.onnx"
    config = preset("navigation", "ddqn", "debug")
    contract = PolicyContract("navigation", "ddqn", config.image, path_points=10)
    export_network(GreedyNetwork(build_policy(config)), contract, path)
    return path


def evaluate(*asked: Any, **more: Any) -> list[Drive]:
    return sorted(drive for drive, _ in ridden(*asked, **more))


def drive(model: Path, seeds: range) -> list[Drive]:
    return evaluate(OnnxPolicy(model), "lane", [load_map("loop")], [NOMINAL], seeds)


def assert_same(drives: list[Drive], others: list[Drive]) -> None:
    """To the rounding of another place in the world."""
    for one, other in zip(drives, others, strict=True):
        assert one._replace(metrics=other.metrics, laps=other.laps) == other
        assert one.metrics == pytest.approx(other.metrics, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("look", ["nominal", "randomised", "reality"])
def test_an_episode_is_the_same_alone_and_in_company(model: Path, look: str) -> None:
    def keep(seeds: list[int]) -> list[Drive]:
        policy, rings = OnnxPolicy(model), [load_map("loop"), load_map("rings/pretzel")]
        looks = load_look_sampler(look)
        return evaluate(policy, "lane", rings, looks, seeds, lane="both")

    together = keep(list(range(1018, 1043)))
    assert [d.seed for d in together] == list(range(1018, 1043))
    assert_same(keep([1021]), together[3:4])
    assert_same(keep([1041, 1020]), [together[2], together[23]])
    assert len({d.metrics for d in together}) == 25
    rings = ("loop", "pretzel")
    assert [d.map for d in together] == [rings[s % 2] for s in range(1018, 1043)]
    assert [d.lane for d in together] == [("outer", "inner")[s // 2 % 2] for s in range(1018, 1043)]


def test_a_policy_drives_by_its_own_table_of_actions(tmp_path: Path) -> None:
    """Another order of the same actions, and a stop that is never chosen, change no drive."""
    config = preset("lane", "ddqn", "debug")
    torch.manual_seed(1)  # of some networks two values are equal, and rounding chooses
    policy = build_policy(config)
    contract = PolicyContract("lane", "ddqn", config.image)
    export_network(GreedyNetwork(policy), contract, tmp_path / "usual.onnx")
    network = GreedyNetwork(policy)
    network.head = torch.nn.Sequential(network.head, _Reversed())
    own = replace(contract, actions=(*contract.actions[::-1], (0.0, 0.0)))
    export_network(network, own, tmp_path / "own.onnx")
    usual, other = (
        evaluate(open_policy(tmp_path / name), "lane", [load_map("loop")], [NOMINAL], range(3))
        for name in ("usual.onnx", "own.onnx")
    )
    assert_same(usual, other)


class _Reversed(torch.nn.Module):
    """Values (N, A) in the opposite order, and one more that is worth less than all."""

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        least = values.min(dim=1, keepdim=True).values - 1.0
        return torch.cat((values.flip(1), least), 1)


def test_missions_are_the_same_alone_and_by_drifting_poses(navigator: Path) -> None:
    looks = load_look_sampler("randomised", "arena")

    def navigate(seeds: range) -> list[Drive]:
        arena = [load_map("arena")]
        return evaluate(OnnxPolicy(navigator), "navigation", arena, looks, seeds)

    together = navigate(range(103, 107))
    assert [d.seed for d in together] == [103, 104, 105, 106]
    assert_same(navigate(range(104, 105)), together[1:2])
    assert len({d.metrics for d in together}) == 4


def test_few_episodes_cost_few_robots_and_few_worlds(
    model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    painted, seen = [], []
    policy, looks = OnnxPolicy(model), load_look_sampler("randomised")
    paint, values = episodes.paint_world, OnnxPolicy.values
    monkeypatch.setattr(episodes, "paint_world", lambda *a: painted.append(a[0].name) or paint(*a))
    monkeypatch.setattr(OnnxPolicy, "values", lambda *a: seen.append(len(a[1])) or values(*a))
    drives = evaluate(policy, "lane", [load_map("loop")], looks, range(1000, 1004))
    assert painted == ["loop"]
    decisions = sum(round(d.metrics.survival_time_s / 0.1) for d in drives)
    assert sum(seen) == decisions  # nobody looks who has nothing to drive


def test_looks_vary_from_episode_to_episode_and_worlds_from_group_to_group() -> None:
    """Whoever judges in one look all along, or in the same few, judges that look."""
    loop, looks = load_map("loop"), load_look_sampler("randomised")
    found = episodes.NumberedEpisodes([loop], looks, 32, 5, range(40, 72))
    assert len(found.begin(np.arange(32))) == 32
    drawn = [found.setting(robot, 0)[2] for robot in range(32)]
    for of in (lambda k: k.drive, lambda k: k.sensor, lambda k: k.timing):
        assert len({of(look) for look in drawn}) == 32
    for part in (lambda k: k.ground, lambda k: k.camera, lambda k: k.light):
        assert len({part(look) for look in drawn}) == 8  # four share the paint


def test_all_manoeuvres_are_driven_once_from_any_seed_on(navigator: Path) -> None:
    task = Manoeuvres([load_map("arena")], 1)
    rng, all_robots = np.random.default_rng(0), np.array([0])
    lengths = []
    for number in range(7, 7 + 32):
        task.reset(all_robots, rng, number)
        lengths.append(float(task.paths.length_m[0]))
    assert sorted(lengths) == pytest.approx(sorted(m.length_m for m in task.manoeuvres))


def test_an_evaluation_is_the_same_in_processes_and_when_it_was_cut_off(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(blocks, "ROBOTS", 2)

    def command(name: str, *more: str) -> int:
        asked = ["--model", str(model), "--episodes", "5", "--json", str(tmp_path / name)]
        return main(["evaluate", *asked, *more])

    assert command("whole.json", "--workers", "1") == 0
    assert command("shared.json", "--workers", "2") == 0
    real, driven = judge.ridden, list[list[int]]()

    def interrupted(*asked: Any) -> Any:
        if len(driven) == 2:
            raise KeyboardInterrupt
        driven.append(list(asked[4]))
        return real(*asked)

    monkeypatch.setattr(judge, "ridden", interrupted)
    assert command("cut.json", "--workers", "1") == 130
    assert "cut.blocks keeps what was driven" in capsys.readouterr().out.replace("\n", "")
    assert not (tmp_path / "cut.json").exists()
    driven.clear()
    assert command("cut.json", "--workers", "1") == 0
    assert driven == [[1004]]
    whole, *others = (
        (tmp_path / f"{name}.json").read_bytes() for name in ("whole", "shared", "cut")
    )
    assert others == [whole, whole]
    assert not (tmp_path / "cut.blocks").exists()


def test_a_place_that_cannot_be_written_is_refused_before_the_drives(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(judge, "ridden", lambda *_: pytest.fail("drove"))
    (tmp_path / "file").write_text("")
    for bad in (tmp_path, tmp_path / "file" / "e.json", model):
        assert main(["evaluate", "--model", str(model), "--json", str(bad)]) == 2


def test_collisions_are_collisions_and_other_failures_are_not() -> None:
    metrics = DriveMetrics(1.0, 2.0, 0.1, 0.0, 0.05)
    ends = [(True, True), (True, False), (True, False), (False, False)]
    drives = [Drive(k, not f, metrics, f, None, c, "a") for k, (f, c) in enumerate(ends)]
    inputs = EvaluateOptions("m", "lane", ("loop",), episodes=4, seed=0)

    class Policy:
        contract = PolicyContract("lane", "ddqn", ImageSpec())

    result = summarise(inputs, Policy(), drives)  # type: ignore[arg-type]
    assert (result.collisions, result.failed_ends) == (1, 3)
    assert [(row.map, row.episodes, row.succeeded) for row in result.by_map] == [("a", 4, 1)]


def test_which_lane_is_a_matter_of_rings(navigator: Path, capsys: Any) -> None:
    assert main(["evaluate", "--model", str(navigator), "--lane", "both", "--episodes", "1"]) == 2
    assert "lane: expected none for the task navigation" in capsys.readouterr().err


@pytest.mark.parametrize(("lane", "lanes"), [(None, ("outer",) * 2), ("inner", ("inner",) * 2)])
def test_a_drive_tells_its_lane_and_keeps_no_frames(
    model: Path, lane: str | None, lanes: tuple[str, ...]
) -> None:
    rings = [load_map("loop")]
    rides = list(ridden(OnnxPolicy(model), "lane", rings, [NOMINAL], range(2), lane=lane))
    assert tuple(drive.lane for drive, _ in rides) == lanes
    assert not any(ride.frames for _, ride in rides)


def test_an_untrained_policy_fails_and_its_figures_add_up(model: Path) -> None:
    policy, drives = OnnxPolicy(model), drive(model, range(40, 60))
    inputs = EvaluateOptions(str(model), "lane", ("loop",), episodes=20, seed=40)
    result = summarise(inputs, policy, drives)
    assert result.episodes == 20
    assert result.success_rate == 1.0 - len(result.failures) / 20
    assert set(result.failures) <= set(range(40, 60))
    times = [d.metrics.survival_time_s for d in drives]
    assert result.survival_time_s == pytest.approx(np.mean(times))


def test_command_writes_the_agreed_keys(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.json"
    arguments = ["evaluate", "--model", str(model), "--episodes", "3", "--seed", "7"]
    assert main([*arguments, "--json", str(out)]) == 0
    written = json.loads(out.read_text())
    for key in ("schema", "inputs", "episodes", "success_rate", "mean_path_distance_m"):
        assert key in written
    for key in ("survival_time_s", "driven_lane_m", "outside_lane_s", "failures"):
        assert key in written
    assert written["inputs"]["seed"] == 7
    assert written["episodes"] == 3


def test_wrong_inputs_are_status_2(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--model", str(model), "--map", "lop"]) == 2
    assert "loop" in capsys.readouterr().err
    assert main(["evaluate", "--model", str(model), "--look", "nominl"]) == 2
    assert "nominal" in capsys.readouterr().err
    assert main(["evaluate", "--model", str(model.parent / "none.onnx")]) == 2
    assert main(["evaluate", "--model", str(model), "--episodes", "0"]) == 2


def test_a_zeroed_input_is_zero_and_the_other_is_not(navigator: Path) -> None:
    policy = OnnxPolicy(navigator)
    seen = []

    class Watched:
        contract = policy.contract

        def values(self, pictures: np.ndarray, path: np.ndarray) -> np.ndarray:
            seen.append((bool(pictures.any()), bool(path.any())))
            return policy.values(pictures, path)

    arena = [load_map("arena")]
    for zero in (None, "image", "path"):
        drives = evaluate(
            Watched(),
            "navigation",
            arena,
            [NOMINAL],
            range(1),
            zero,
        )
        assert [d.seed for d in drives] == [0]
        assert set(seen) == {(zero != "image", zero != "path")}
        seen.clear()


def test_who_is_told_its_last_commands_is_told_them_when_it_is_judged() -> None:
    asked = []

    class Told:
        contract = PolicyContract("lane", "coached", commands=5)

        def values(self, pictures: np.ndarray, path: np.ndarray) -> np.ndarray:
            asked.append(path[0])
            return np.eye(5)[[len(asked) % 2]]

    (drive,) = evaluate(Told(), "lane", [load_map("loop")], [NOMINAL], range(1))
    assert drive.failed
    pairs = np.array([asked[-1][k : k + 2] for k in range(0, 10, 2)])
    turns = [(0.2541, 0.3459), (0.0576, 0.3024)]
    last = [turns[(len(asked) - k) % 2] for k in (4, 3, 2, 1, 0)]
    np.testing.assert_allclose(pairs, np.array(last) / 0.3459, atol=1e-5)
    assert not asked[0].any()


def test_junctions_may_be_blank(navigator: Path) -> None:
    """Their pictures are zeros, and only theirs; the path stays."""
    policy = OnnxPolicy(navigator)
    asked = ("navigation", [load_map("arena")], [NOMINAL], range(4), "junctions")
    seen = []

    class Watched:
        contract = policy.contract

        def values(self, pictures: np.ndarray, path: np.ndarray) -> np.ndarray:
            seen.append((bool(pictures.any()), bool(path.any())))
            return np.eye(5)[[Action.STRAIGHT]]  # on into a junction

    evaluate(Watched(), *asked)
    assert set(seen) == {(True, True), (False, True)}


def test_navigation_is_evaluated_on_several_maps_with_pose_error(
    navigator: Path, tmp_path: Path
) -> None:
    out = tmp_path / "e.json"
    arguments = ["evaluate", "--model", str(navigator), "--map", "arena", "hamlet"]
    asked = ["--pose-error", "arena", "--zero", "image", "--episodes", "2", "--seed", "19"]
    assert main([*arguments, *asked, "--json", str(out)]) == 0
    inputs = json.loads(out.read_text())["inputs"]
    assert (inputs["task"], inputs["maps"]) == ("navigation", ["arena", "hamlet"])
    assert (inputs["pose_error"], inputs["zero"]) == ("arena", "image")


def test_lane_keeping_has_no_path_to_zero(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--model", str(model), "--zero", "path"]) == 2
    assert "expected image, got path" in capsys.readouterr().err


def test_a_race_track_has_no_junctions_to_blank(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["evaluate", "--model", str(SHIPPED_MODELS / "track_ppo.onnx"), "--zero", "junctions"]
    assert main([*asked, "--episodes", "1", "--workers", "1"]) == 2
    assert "a race track has none" in capsys.readouterr().err


def test_wilson_interval_of_the_literature() -> None:
    assert share(200, 200).low == pytest.approx(0.981, abs=5e-4)
    assert share(50, 50).low == pytest.approx(0.929, abs=5e-4)
    assert share(0, 10).low == pytest.approx(0.0, abs=1e-12)


def test_a_look_without_all_that_varies_is_the_nominal_one(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "e.json"
    groups = ["ground", "sky", "light", "clutter", "camera", "sensor", "drive", "timing"]
    arguments = ["evaluate", "--model", str(model), "--episodes", "3", "--json", str(out)]
    assert main([*arguments, "--look", "randomised", "--without", *groups]) == 0
    bare = json.loads(out.read_text())
    assert main([*arguments, "--look", "nominal"]) == 0
    nominal = json.loads(out.read_text())
    assert bare["inputs"]["without"] == groups
    assert {**bare, "inputs": None} == {**nominal, "inputs": None}
    assert main([*arguments, "--look", "randomised", "--without", "sensor.nois"]) == 2
