"""Teaching: a base learns on, a person's steering becomes examples, a bad teacher is found out."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from rich.console import Console

from robot.contract import ACTION_TWISTS, DRIVE, PolicyContract, Proof, Stick
from robot.errors import ConfigError, ContractError
from robot.geometry import Twist, wrap_angle
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy, read_contract
from robot.navigation.path import lane_loop, path_input
from robot.navigation.road_map import load_map, read_map
from robot.recording.drive_file import png
from robot.recording.reader import Sample
from robot.recording.topics import Turn
from sim_pybullet.episodes import NumberedEpisodes
from sim_pybullet.look import NOMINAL
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.navigation import RandomRoutes
from tests.tools.recorded import recorded
from tests.trainer import judge_teach_loop
from tools.data.drives import write_drive
from trainer.export import export_network
from trainer.judging.evaluate import Ride
from trainer.judging.intervals import share
from trainer.learners.networks import GreedyNetwork
from trainer.twin import proof as proofs
from trainer.twin import teach as twin_teach
from trainer.twin import translation
from trainer.twin.cli import fit_command, teach_command
from trainer.twin.examples import AHEAD_M, Examples, examples_of, foretold, ways_driven
from trainer.twin.manner import Manner
from trainer.twin.proof import where_failed
from trainer.twin.recorded import Recorded
from trainer.twin.teach import TeachConfig, base_file, how_much, load_base, new_model, teach
from trainer.twin.translation import twin_to_real

LANE = PolicyContract("lane", "coached")
LEFT = (0.06, 0.30)


def drive(states: list[str], wheels: list[tuple[float, float]]) -> Recorded:
    count = len(states)
    turns = [
        Turn(k, 0.1 * k, 0.01, 0.0, state, "", "", pair)
        for k, (state, pair) in enumerate(zip(states, wheels, strict=True))
    ]
    images = np.zeros((count, 120, 160, 3), np.uint8)
    nothing, here = np.zeros((0, 4)), np.array([(0.0, 0.0, 0.0, 0.0), (9.0, 0.0, 0.0, 0.0)])
    times_s = 0.1 * np.arange(count)
    return Recorded("loop", np.zeros((0, 2)), times_s, images, nothing, here, 0.0, tuple(turns))


def examples(one: Recorded, held_out: bool = False) -> Examples:
    return examples_of([one], [np.zeros((len(one.turns), 3))], LANE, held_out)


def test_what_a_person_did_at_a_take_over_counts_most() -> None:
    states = ["AUTO"] * 10 + ["MANUAL"] * 60 + ["AUTO"] * 30
    seen = examples(drive(states, [LEFT] * 100))
    assert len(seen.shares) == 60  # of the first 70 %, those that a person drove
    assert set(seen.shares.argmax(axis=1)) == {0}  # LEFT
    assert np.unique(seen.weights[:30]) == [4.0]
    assert np.unique(seen.weights[30:]) == [1.0]


def test_steering_between_two_actions_is_a_share_of_each() -> None:
    """By the nearest alone a bend of 7 per metre would be taught as one of 3."""
    bends_pm = [twist.turn_radps / twist.forward_mps for twist in ACTION_TWISTS]
    wanted_pm = np.linspace(-12.0, 12.0, 40)
    wheels = [DRIVE.wheels(Twist(0.2, 0.2 * bend)) for bend in wanted_pm.tolist()]
    one = drive(["MANUAL"] * 40, wheels)._replace(map_name="")
    seen = examples_of([one], [None], LANE, held_out=False)
    assert np.allclose(seen.shares @ bends_pm, wanted_pm[:28], atol=1e-5)
    assert np.allclose(seen.shares.sum(axis=1), 1.0)
    assert ((seen.shares > 1e-6).sum(axis=1) <= 2).all()


def test_what_is_marked_bad_teaches_nothing_and_what_corrects_it_counts_most() -> None:
    one = drive(["AUTO"] * 4 + [""] * 2 + ["MANUAL"] * 4 + [""] * 2 + ["MANUAL"] * 38, [LEFT] * 50)
    seen = examples(one)  # of the first 35 turns
    assert len(seen.shares) == 35 - 4 - 2 - 2
    assert seen.weights[0] == 4.0


def test_parts_of_a_drive_are_apart() -> None:
    one = drive(["MANUAL"] * 100, [LEFT] * 100)
    parts = [examples(one, held_out) for held_out in (False, True)]
    assert sum(len(part.shares) for part in parts) == 100
    assert len(parts[1].shares) == pytest.approx(30, abs=1)


def test_the_last_three_tenths_of_each_drive_are_held_out_whatever_the_others_last() -> None:
    drives = [drive(["MANUAL"] * n, [LEFT] * n)._replace(map_name="") for n in (40, 100)]
    learned, held_out = (examples_of(drives, [None, None], LANE, part) for part in (False, True))
    assert len(learned.shares) == 28 + 70
    assert len(held_out.shares) == 12 + 30


def test_who_goes_backwards_drove_no_way() -> None:
    path = RandomRoutes(load_map("arena")).draw(np.random.default_rng(0))
    poses = [path.pose_at(path.length_m - 0.02 * k) for k in range(50)]
    told = np.array([(0.1 * k, *pose) for k, pose in enumerate(poses)])
    one = drive(["MANUAL"] * 50, [LEFT] * 50)._replace(map_name="arena", fused=told)
    assert ways_driven(one) == [None] * 50


def test_the_way_that_a_person_drove_is_what_a_navigator_would_have_been_told() -> None:
    road_map = load_map("arena")
    path = RandomRoutes(road_map).draw(np.random.default_rng(0))
    count = int(path.length_m / 0.02)
    told = [(0.1 * k, *path.pose_at(0.02 * k)) for k in range(count)]
    driven = drive(["MANUAL"] * count, [LEFT] * count)
    one = driven._replace(map_name="arena", fused=np.array(told))
    ways = ways_driven(one)
    far = round(AHEAD_M / 0.02) + 1
    assert all(way is not None for way in ways[: count - far])
    assert all(way is None for way in ways[count - far + 2 :])  # nobody knows where it went
    here = [path_input(path, path.pose_at(0.02 * k)) for k in range(count - far)]
    told_of = [way.told for way in ways if way is not None][: count - far]
    assert np.abs(np.subtract(told_of, here)).max() < 0.05


@pytest.mark.parametrize("policy", [LANE, PolicyContract("navigation", "ppo", path_points=10)])
def test_right_is_the_way_back_to_the_lane_however_a_person_weaves(policy: PolicyContract) -> None:
    path = RandomRoutes(load_map("arena")).draw(np.random.default_rng(0))
    count = int(path.length_m / 0.02)
    poses = [path.pose_at(0.02 * k) for k in range(count)]
    told = [(0.1 * k, *pose) for k, pose in enumerate(poses)]
    weaving = [LEFT if k // 8 % 2 else LEFT[::-1] for k in range(count)]
    one = drive(["MANUAL"] * count, weaving)._replace(map_name="arena", fused=np.array(told))
    right = [(*pose.to_world(np.array([[0.0, -0.04]]))[0], pose.heading_rad) for pose in poses]
    seen = examples_of([one], [np.array(right)], policy, held_out=False)
    turns = np.abs(np.diff([pose.heading_rad for pose in poses]))
    straight = [k for k in range(len(seen.shares)) if turns[k : k + 15].max() < 1e-6]
    assert len(straight) > 20
    # 14 cm ahead it is back on its way: a bend of 3.8 per metre
    assert set(seen.shares[straight].argmax(axis=1).tolist()) == {1}
    steered = np.sign(seen.bends_pm[straight])
    assert {-1.0, 1.0} <= set(steered.tolist())  # though the person went both ways


def test_to_the_west_the_way_is_told_as_anywhere() -> None:
    """There headings jump from pi to -pi."""
    lane = lane_loop(load_map("loop"))
    around = [lane.pose_at(0.02 * k) for k in range(900)]
    west = np.array([abs(pose.heading_rad) > 3.14 for pose in around])
    poses = around[next(k for k in range(800) if west[k : k + 60].all()) :][:50]
    headings = wrap_angle(np.pi + np.where(np.arange(50) % 2, 0.01, -0.01))
    told = [(0.1 * k, *pose[:2], headings[k]) for k, pose in enumerate(poses)]
    one = drive(["MANUAL"] * 50, [LEFT] * 50)._replace(fused=np.array(told))
    ways = ways_driven(one._replace(times_s=one.times_s + 0.05))[:10]
    assert np.abs([way.told for way in ways if way is not None]).max() < 0.03
    assert None not in ways


def test_where_a_person_took_over_they_are_right_and_not_the_expert() -> None:
    path = RandomRoutes(load_map("arena")).draw(np.random.default_rng(0))
    count = int(path.length_m / 0.02)
    poses = np.array([path.pose_at(0.02 * k) for k in range(count)])
    told = np.column_stack((0.1 * np.arange(count), poses))
    one = drive(["AUTO"] * 2 + ["MANUAL"] * (count - 2), [LEFT] * count)
    one = one._replace(map_name="arena", fused=told)
    right = examples_of([one], [poses], LANE, held_out=False).shares.argmax(axis=1)
    assert set(right[:30]) == {0}  # LEFT, as they did
    assert 2 in right[31:]  # STRAIGHT, as the expert would


def test_who_is_told_its_last_commands_is_taught_at_rest_whatever_a_person_did_before() -> None:
    """They go on as they did: who learned that would repeat its own commands."""
    one = drive(["MANUAL"] * 8, [LEFT] * 8)
    turns = tuple(replace(turn, path=(0.5,) * 10) for turn in one.turns)
    one = one._replace(turns=turns)
    for contract, expected in (
        (replace(LANE, commands=5), [0.0] * 10),
        (replace(LANE, path_points=10), [0.5] * 10),
        (replace(LANE, path_points=10, commands=5), [0.5] * 10 + [0.0] * 10),
    ):
        paths = examples_of([one], [np.zeros((8, 3))], contract, False).paths
        assert paths is not None
        assert paths[0].tolist() == expected
    assert examples(one).paths is None


@pytest.mark.parametrize(
    ("wheels", "count"),
    [((0.0, 0.0), 0), ((0.04, 0.05), 0), ((0.05, 0.06), 7), ((-0.2, -0.1), 0)],
)
def test_standing_and_going_back_are_no_examples(wheels: tuple[float, float], count: int) -> None:
    assert len(examples(drive(["MANUAL"] * 10, [wheels] * 10)).shares) == count


def test_who_took_over_from_nobody_corrects_nothing() -> None:
    assert set(examples(drive(["READY"] * 2 + ["MANUAL"] * 48, [LEFT] * 50)).weights) == {1.0}


def test_only_clear_steering_is_foretold_and_not_by_driving_straight_on() -> None:
    bends = np.array((2.4, 2.6, -2.4, -2.6))
    seen = Examples(np.zeros((4, 1)), None, np.zeros((4, 5)), np.ones(4), bends)
    assert foretold(np.zeros(4, int), seen, LANE) == (1, 2)  # LEFT
    assert foretold(np.full(4, 2), seen, LANE) == (0, 2)  # STRAIGHT


def test_steering_that_is_half_reversed_is_not_foretold() -> None:
    bends = np.tile((5.0, -5.0), 50)
    reversed_half = np.where(np.arange(100) < 50, bends, -bends)
    seen = [
        Examples(np.zeros((100, 1)), None, np.zeros((100, 5)), np.ones(100), b)
        for b in (bends, reversed_half)
    ]
    good = np.where(bends > 0, 0, 4)
    assert foretold(good, seen[0], LANE) == (100, 100)
    assert foretold(good, seen[1], LANE) == (50, 100)


@pytest.mark.parametrize("name", ["lane_coached", "lane_ppo", "lane_sight", "nav_dueling"])
def test_a_shipped_policy_can_learn_on(name: str) -> None:
    network, contract = load_base(base_file(name))  # compared with ONNX in there
    assert contract.task == ("navigation" if name == "nav_dueling" else "lane")
    assert any(part.requires_grad for part in network.parameters())


def test_without_a_map_recordings_are_what_is_learned_from_first_of_all() -> None:
    """By half of them only, 67 in place of 74 % of a real drive's turns were told."""
    by_map, without = how_much(True), how_much(False)
    assert by_map.steps == 2_700
    assert by_map.recorded < by_map.batch
    assert without.steps == 900
    assert without.recorded > 6 * without.batch
    assert how_much(True, 7).steps == how_much(False, 7).steps == 7


def test_a_folder_with_another_policy_is_no_place_for_a_taught_one(tmp_path: Path) -> None:
    """Such as its base: that would be lost, and the taught one be compared with itself."""
    network, contract = load_base(base_file("lane_coached"))
    model = new_model(tmp_path)
    export_network(network, contract, model)
    with pytest.raises(ConfigError, match="expected no policy here yet"):
        new_model(tmp_path)
    export_network(network, replace(contract, taught_from="lane_coached"), model)
    assert new_model(tmp_path) == model, "left half-way"


def test_a_base_is_a_shipped_policy_whatever_lies_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lane_coached").mkdir()
    assert base_file("lane_coached") == SHIPPED_MODELS / "lane_coached.onnx"
    (tmp_path / "own.onnx").write_bytes(b"")
    assert base_file("own.onnx") == Path("own.onnx")
    with pytest.raises(ConfigError, match="did you mean 'lane_coached'"):
        base_file("lane_coach")


def test_a_base_that_cannot_learn_is_refused() -> None:
    with pytest.raises(ContractError, match="a policy in FP32"):
        load_base(SHIPPED_MODELS / "lane_ppo_int8.onnx")


@pytest.mark.parametrize("base", ["lane_coached", "lane_sight"])
def test_a_base_learns_on_and_carries_its_proof(base: str, tmp_path: Path) -> None:
    torch.manual_seed(0)
    network, contract = load_base(base_file(base))
    before = network.head[0].weight.clone()
    image = np.zeros((40, *contract.picture_shape), np.uint8)
    bends = np.full(40, 13.0)
    left = np.tile(np.eye(5, dtype=np.float32)[0], (40, 1))
    paths = np.zeros((40, contract.told), np.float32) if contract.told else None
    person = Examples(image, paths, left, np.ones(40), bends)
    config = TeachConfig(steps=20, robots=2, batch=16, recorded=32, every=1, painted=1)
    teach(network, contract, (load_map("loop"), [NOMINAL]), person, config, seed=0)
    assert not torch.equal(before, network.head[0].weight)
    model = tmp_path / "model.onnx"
    taught = replace(contract, taught_from=base)
    export_network(network, taught, model)
    actions = OnnxPolicy(model).values(person.images, paths).argmax(axis=1)
    assert foretold(actions, person, contract) == (40, 40)  # what the person did, again and again
    proof = Proof(1, 0, 0.0, 0.8, 40, 40, "a sentence")
    export_network(network, replace(taught, proof=proof), model)
    assert OnnxPolicy(model).contract.proof == proof
    assert "proven to 0% of drives" in OnnxPolicy(model).contract.unproven


def test_without_a_map_worlds_are_driven_as_the_person_would(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And half of what they did themselves is by chance: of the recorded, half is their manner."""
    torch.manual_seed(0)
    network, contract = load_base(base_file("lane_sight"))
    worlds = []

    class Always(Manner):
        def shares(self, images: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
            worlds.append(images.copy())
            assert otherwise.sum(axis=1) == pytest.approx(np.ones(len(images)))
            return np.tile(np.eye(5, dtype=np.float32)[0], (len(images), 1))

    monkeypatch.setattr(twin_teach, "manner_of", lambda person, sight: Always(sight, 0.5, 1.0))
    images = np.zeros((8, *contract.picture_shape), np.uint8)
    straight = np.tile(np.eye(5, dtype=np.float32)[2], (8, 1))
    paths = np.zeros((8, contract.told), np.float32)
    did = network.actions({"image": images, "path": paths})[0]
    person = Examples(images, paths, straight, np.ones(8), np.full(8, 5.0 if did > 2 else -5.0))
    config = TeachConfig(steps=120, robots=2, batch=32, recorded=32, every=1, painted=1)
    teach(network, contract, None, person, config, seed=0)
    seen = np.concatenate(worlds[1:])
    told = np.zeros((len(seen), contract.told), np.float32)
    assert (network.actions({"image": seen, "path": told}) == 0).mean() > 0.9
    values = network.logits({"image": images[:1], "path": paths[:1]}).softmax(1)[0]
    assert values[[0, 2]].tolist() == pytest.approx([0.5, 0.5], abs=0.15)


def test_without_a_map_a_base_that_steers_alike_stays_right_in_the_looks_of_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The expert would teach it worse: taught by its labels, virtual robots kept fewer lanes."""
    torch.manual_seed(0)
    network, contract = load_base(base_file("lane_sight"))
    before, seen = copy.deepcopy(network), list[dict[str, np.ndarray]]()
    monkeypatch.delattr(twin_teach, "manner_of")
    actions = GreedyNetwork.actions

    def watched(which: GreedyNetwork, now: dict[str, np.ndarray]) -> np.ndarray:
        seen.append({name: part.copy() for name, part in now.items()})
        return actions(which, now)

    monkeypatch.setattr(GreedyNetwork, "actions", watched)
    images = np.zeros((8, *contract.picture_shape), np.uint8)
    person = Examples(
        images,
        np.zeros((8, contract.told), np.float32),
        np.tile(np.eye(5, dtype=np.float32)[4], (8, 1)),
        np.ones(8),
        np.zeros(8),
    )
    wanted = list[torch.Tensor]()

    def loss(logits: torch.Tensor, told: torch.Tensor) -> torch.Tensor:
        wanted.append(told[:96])
        return torch.nn.functional.cross_entropy(logits, told)

    monkeypatch.setattr(twin_teach, "cross_entropy", loss)
    config = TeachConfig(steps=150, robots=4, batch=96, recorded=32, every=1, painted=1)
    teach(network, contract, None, person, config, seed=0)
    right = before.logits({n: np.concatenate([s[n] for s in seen[1:]]) for n in seen[0]})
    known = {row.tobytes() for row in right.softmax(1).detach().numpy().round(3)}
    asked = [row.tobytes() in known for row in torch.cat(wanted).numpy().round(3)]
    assert np.mean(asked) > 0.95, "by what it was, not by what it becomes"
    worlds = {n: np.concatenate([s[n] for s in seen[1:]]) for n in seen[0]}
    alike = actions(network, worlds) == actions(before, worlds)
    assert len(alike) == 600
    assert alike.mean() > 0.8
    assert (actions(network, person.observed) == 4).all(), "and it learned what they did"
    kept = before.features.convolutions.state_dict()
    for name, part in network.features.convolutions.state_dict().items():
        assert torch.equal(part, kept[name]), "it sees as it did"


@pytest.mark.parametrize("base", ["lane_coached", "lane_ppo"])
def test_without_a_map_who_sees_by_layers_of_its_own_is_no_base(
    base: str, unmapped: Path, tmp_path: Path
) -> None:
    """So few pictures spoil them: `lane_coached` drove 16 of 30 times before, and 0 after."""
    with pytest.raises(ConfigError, match="base lane_sight"):
        teach_command((unmapped,), base, tmp_path / "taught")
    assert not (tmp_path / "taught" / "model.onnx").exists()


@pytest.mark.parametrize(("base", "stays"), [("lane_coached", False), ("lane_sight", True)])
def test_on_a_map_who_sees_by_layers_of_its_own_learns_to_see_there(base: str, stays: bool) -> None:
    network, contract = load_base(base_file(base))
    before = copy.deepcopy(network.features.convolutions.state_dict())
    paths = np.zeros((0, contract.told), np.float32) if contract.told else None
    nothing = np.zeros((0, *contract.picture_shape), np.uint8), paths, np.zeros((0, 5))
    nobody = Examples(*nothing, np.zeros(0), np.zeros(0))
    config = TeachConfig(steps=2, robots=2, batch=4, painted=1)
    where = load_map("loop"), [NOMINAL]
    teach(network, contract, where, nobody, config, 0)
    after = network.features.convolutions.state_dict()
    assert all(torch.equal(part, before[name]) for name, part in after.items()) == stays


@pytest.mark.parametrize(("base", "by_base"), [("lane_sight", True), ("lane_coached", False)])
def test_the_expert_is_right_in_the_twin_and_a_base_that_sees_by_sight_elsewhere(
    base: str, by_base: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    network, contract = load_base(base_file(base))
    worlds_of, told = twin_teach._worlds, list[np.ndarray]()

    def worlds(*given: Any) -> list[Any]:
        twin, usual = made = worlds_of(*given)
        twin.expert_actions = lambda: np.zeros(2, int)  # type: ignore[method-assign]
        usual.expert_actions = lambda: np.full(2, 4)  # type: ignore[method-assign]
        return made

    def loss(logits: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
        told.append(wanted.numpy())
        return logits.sum() * 0.0

    monkeypatch.setattr(twin_teach, "_worlds", worlds)
    monkeypatch.setattr(twin_teach, "cross_entropy", loss)
    paths = np.zeros((0, contract.told), np.float32) if contract.told else None
    nothing = np.zeros((0, *contract.picture_shape), np.uint8), paths, np.zeros((0, 5))
    nobody = Examples(*nothing, np.zeros(0), np.zeros(0))
    config = TeachConfig(steps=30, robots=2, batch=32, every=1, painted=1)
    teach(network, contract, (load_map("loop"), [NOMINAL]), nobody, config, 0)
    rows = np.concatenate(told)
    left, right = ((rows == np.eye(5)[k]).all(axis=1).mean() for k in (0, 4))
    assert 0.4 < left < 0.6
    assert right == (0.0 if by_base else pytest.approx(1.0 - left))
    assert rows.sum(axis=1) == pytest.approx(np.ones(len(rows)), abs=1e-5)


def test_on_a_map_nobody_asks_for_a_manner(monkeypatch: pytest.MonkeyPatch) -> None:
    network, contract = load_base(base_file("lane_sight"))
    monkeypatch.delattr(twin_teach, "manner_of")
    images = np.zeros((8, *contract.picture_shape), np.uint8)
    paths, shares = np.zeros((8, contract.told), np.float32), np.full((8, 5), 0.2, np.float32)
    did = network.actions({"image": images, "path": paths})[0]
    other = Examples(images, paths, shares, np.ones(8), np.full(8, 5.0 if did > 2 else -5.0))
    config = TeachConfig(steps=2, robots=2, batch=4, painted=1)
    teach(network, contract, (load_map("loop"), [NOMINAL]), other, config, 0)


def test_what_counts_most_is_learned_most_often(monkeypatch: pytest.MonkeyPatch) -> None:
    network, contract = load_base(base_file("lane_sight"))
    told = list[np.ndarray]()

    def loss(logits: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
        told.append(wanted.numpy()[4:])
        return logits.sum() * 0.0

    monkeypatch.setattr(twin_teach, "cross_entropy", loss)
    shares = np.repeat(np.eye(5, dtype=np.float32)[[0, 4]], 5, axis=0)
    images = np.zeros((10, *contract.picture_shape), np.uint8)
    paths, weights = np.zeros((10, contract.told), np.float32), np.repeat((1.0, 4.0), 5)
    person = Examples(images, paths, shares, weights, np.zeros(10))
    config = TeachConfig(steps=20, robots=2, batch=4, recorded=50, every=1, painted=1)
    teach(network, contract, None, person, config, 0)
    assert np.concatenate(told).shape == (1_000, 5)
    assert np.concatenate(told)[:, 4].mean() == pytest.approx(0.8, abs=0.05)


def test_who_drove_nothing_still_tells_of_what_a_policy_takes() -> None:
    nobody = examples_of([], [], read_contract(base_file("lane_sight")), held_out=False)
    assert {n: p.shape for n, p in nobody.observed.items()} == {
        "image": (0, 40, 80, 3),
        "path": (0, 10),
    }
    assert {p.dtype for p in nobody.observed.values()} == {np.dtype("uint8"), np.dtype("float32")}
    assert list(examples_of([], [], LANE, held_out=False).observed) == ["image"]


def test_each_drive_of_a_proof_has_a_floor_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def ridden(*given: Any, lane: str | None) -> list[Any]:
        assert lane == "both"
        asked.extend(given[4])
        episodes = NumberedEpisodes(given[2], given[3], len(given[4]), 0, given[4])
        floors = [episodes.setting(k, 0)[1] for k in range(len(given[4]))]
        assert len(set(map(id, floors))) == len(floors)
        return []

    monkeypatch.setattr(proofs, "ridden", ridden)
    contract = read_contract(base_file("lane_coached"))
    nobody = Examples(np.zeros((0, *contract.picture_shape), np.uint8), None, *[np.zeros(0)] * 3)
    twin = load_map("loop"), load_look_sampler("randomised")
    proofs.prove(base_file("lane_coached"), twin, nobody, 24, print)
    assert len(set(asked)) == 24
    assert min(asked) == 50_000, "no floor that it learned on"
    assert sum(number % 2 for number in asked) == 12, "rings are driven in both directions"


def test_a_proof_is_of_every_drive_and_says_how_sure_that_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 18 successes in 20 Wilson's interval is from 69.9 to 97.2 %."""
    road_map, ends = load_map("loop"), np.array((0.3, 0.3, 0.0))
    rides = iter(range(100))

    def ridden(*given: Any, lane: str | None) -> Any:
        for _ in given[4]:
            success = next(rides) >= 2
            yield SimpleNamespace(success=success), Ride(poses=[ends + 1.2, ends], look=NOMINAL)

    monkeypatch.setattr(proofs, "ridden", ridden)
    monkeypatch.setattr(proofs, "foretold", lambda *_: (30, 41))
    shape = read_contract(base_file("lane_coached")).picture_shape
    person = Examples(np.zeros((1, *shape), np.uint8), None, np.ones((1, 5)), *[np.ones(1)] * 2)
    proof = proofs.prove(base_file("lane_coached"), (road_map, [NOMINAL]), person, 20, id)
    assert (proof.drives, proof.succeeded, proof.steered, proof.foretold) == (20, 18, 41, 30)
    assert (proof.low, proof.high) == pytest.approx((0.699, 0.972), abs=5e-4)
    assert proof.sentence.startswith("90 % of 20 two-lap drives in its twin (95 %: 70% to 97%)")
    assert proof.fails == "most on the bend in the south-west (2 of 2)"
    never = proofs.prove(base_file("lane_coached"), None, person, 20, id)
    assert (never.drives, never.succeeded, never.low, never.high) == (0, 0, 0.0, 1.0)
    assert (never.steered, never.foretold) == (41, 30)


def test_only_the_twin_is_seen_through_a_translator() -> None:
    seen: list[int] = []

    def darkened(pictures: np.ndarray) -> np.ndarray:
        seen.append(len(pictures))
        return pictures // 2

    network, contract = load_base(base_file("lane_coached"))
    nobody = Examples(np.zeros((0, *contract.picture_shape), np.uint8), None, *[np.zeros(0)] * 3)
    config = TeachConfig(steps=6, robots=2, batch=4, painted=1)
    teach(network, contract, (load_map("loop"), [NOMINAL]), nobody, config, 0, darkened)
    assert sum(seen) == 2 * 7, "what two robots saw of the twin, first and after each step"


def test_a_cyclegan_between_twin_and_recording_goes_on_where_it_was_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(translation, "FRAMES", 8)
    (tmp_path / "twin.yaml").write_text("ground: {brightness: 0.9}")
    image, told = load_base(base_file("lane_coached"))[1].image, Console(quiet=True)
    drive = recorded(tmp_path, "a", 12)
    translator = twin_to_real([drive], image, tmp_path, 2, 0, told)
    assert translator.contract.direction == "sim-to-real"
    pictures = np.full((2, *image.shape), 90, np.uint8)
    first = translator(pictures)
    again = twin_to_real([drive], image, tmp_path, 2, 0, told)
    np.testing.assert_array_equal(again(pictures), first)
    with pytest.raises(ConfigError, match="expected one of these recordings"):
        twin_to_real([recorded(tmp_path, "b", 12)], image, tmp_path, 2, 0, told)


@pytest.fixture(scope="module")
def unmapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A person drives where no map is: to the bright side, in bends of two seconds."""
    rng, samples = np.random.default_rng(0), []
    for k in range(300):
        turn = (1.0, -1.0)[k // 20 % 2]
        shade = np.linspace(90.0 + 70.0 * turn, 90.0 - 70.0 * turn, 160)[None, :, None]
        image = np.clip(shade + rng.normal(0.0, 4.0, (120, 160, 3)), 0, 255).astype(np.uint8)
        samples.append(Sample(1.7e9 + 0.1 * k, png(image), Stick(turn, 0.6).wheels, "person"))
    return write_drive(tmp_path_factory.mktemp("unmapped"), "own", "daisy", samples)


@pytest.mark.slow
def test_without_a_map_it_learns_to_steer_as_the_person_did(unmapped: Path, tmp_path: Path) -> None:
    torch.manual_seed(0)
    assert teach_command((unmapped,), out=tmp_path / "taught", steps=60) == 0
    contract = OnnxPolicy(tmp_path / "taught" / "model.onnx").contract
    proof = contract.proof
    assert proof is not None
    assert (proof.drives, proof.succeeded, proof.low) == (0, 0, 0.0)
    assert proof.foretold > 0.9 * proof.steered > 75
    assert contract.unproven == ""
    with pytest.raises(ConfigError, match="expected no policy here yet"):
        teach_command((unmapped,), out=tmp_path / "taught", steps=60)
    assert proof.sentence == (
        f"never driven; steers as the person did in {proof.foretold} of {proof.steered} "
        "held-out moments"
    )
    base = str(tmp_path / "taught" / "model.onnx")
    assert teach_command((unmapped,), base, tmp_path / "again", steps=60) == 0


@pytest.mark.parametrize("given", [{"base": "nav_ppo"}, {"base": "nav_sight"}, {"cyclegan": 2}])
def test_without_a_map_there_is_no_way_and_no_twin(
    given: dict[str, Any], unmapped: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match="base lane_sight, no --cyclegan"):
        teach_command((unmapped,), out=tmp_path, **given)
    with pytest.raises(ConfigError, match="drives on a map, got drives without one"):
        fit_command((unmapped,), tmp_path / "twin.yaml")


@pytest.mark.parametrize(
    ("before", "after", "status"), [(100, 99, 1), (99, 95, 1), (96, 96, 0), (95, 99, 0)]
)
def test_a_base_that_drives_better_in_the_twin_is_to_be_kept_even_by_luck(
    before: int,
    after: int,
    status: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """On a floor where 95 of 100 succeeded in its twin, and all by its base, 14 of 20 did."""
    fitted = [drive(["MANUAL"] * 50, [LEFT] * 50)], [np.zeros((50, 3))], load_map("loop")
    (tmp_path / "twin.yaml").write_text("ground: {brightness: 0.9}")
    left = iter((before, after))

    def prove(*_: object) -> Proof:
        value, low, high = share(good := next(left), 100)
        return Proof(100, good, low, high, 50, 50, f"{value:.0%}")

    monkeypatch.setattr("trainer.twin.cli._fit", lambda *_: fitted)
    monkeypatch.setattr("trainer.twin.teach.teach", lambda *_: None)
    monkeypatch.setattr("trainer.twin.proof.prove", prove)
    assert teach_command((tmp_path / "a.mcap",), out=tmp_path) == status
    assert ("drives worse than lane_sight: keep that" in capsys.readouterr().out) == bool(status)


def test_a_navigator_is_not_taught_without_a_map_whatever_it_was_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = drive(["MANUAL"] * 50, [LEFT] * 50)
    told = tuple(replace(turn, path=(0.0,) * 10) for turn in one.turns)
    fitted = [one._replace(map_name="", turns=told)], [None], None
    monkeypatch.setattr("trainer.twin.cli._fit", lambda *_: fitted)
    with pytest.raises(ConfigError, match="base lane_sight"):
        teach_command((tmp_path / "a.mcap",), "nav_sight", tmp_path)


def test_a_proof_says_where_most_drives_fail_and_when() -> None:
    road_map, rng = load_map("loop"), np.random.default_rng(0)
    size, rides = road_map.tile_size_m, []
    bend = next(t for t in road_map.road_tiles if t.kind != "straight" and t.row == 0)
    corner = np.array(((bend.column + 0.5) * size, (road_map.rows - 0.4) * size, 0.0))
    for success in np.arange(40) % 4 > 0:
        exposure = rng.uniform(0.9, 1.1) if success else 0.5
        look = replace(NOMINAL, sensor=replace(NOMINAL.sensor, exposure=exposure))
        rides.append((bool(success), Ride(poses=[corner], look=look)))
    said = where_failed(road_map, rides)
    assert said.startswith("most on the bend in the north")
    assert said.endswith("(10 of 10), in the dark")
    assert where_failed(road_map, rides[1:4]) == ""  # nobody failed


def failures(group: str, leaf: str, failing: float, usual: float, count: int) -> str:
    """What is said where so many fail, all of them in looks of their own, and as many do not."""
    rides = []
    for k in range(2 * count):
        value = (usual if k % 2 else failing) * (1.0 + 0.001 * k)
        part = replace(getattr(NOMINAL, group), **{leaf: value})
        rides.append(
            (bool(k % 2), Ride(poses=[np.zeros(3)], look=replace(NOMINAL, **{group: part})))
        )
    return where_failed(load_map("loop"), rides)


@pytest.mark.parametrize(
    ("group", "leaf", "failing", "usual", "words"),
    [
        ("sensor", "exposure", 0.5, 1.0, "in the dark"),
        ("sensor", "exposure", 1.5, 1.0, "in bright light"),
        ("sensor", "noise", 9.0, 3.0, "with noisy pictures"),
        ("ground", "shadows", 0.5, 0.1, "in deep shadows"),
        ("ground", "wear", 0.5, 0.1, "on worn lines"),
        ("ground", "patchiness", 0.5, 0.1, "on a patchy floor"),
        ("light", "gloss", 0.5, 0.1, "on a glossy floor"),
    ],
)
def test_a_look_is_blamed_that_failures_have_more_of_and_only_if_luck_is_no_reason(
    group: str, leaf: str, failing: float, usual: float, words: str
) -> None:
    place = "most on the bend in the south-west"
    assert failures(group, leaf, failing, usual, 10) == f"{place} (10 of 10), {words}"
    assert failures(group, leaf, failing, usual, 4) == f"{place} (4 of 4)"  # 1 of 70 by luck
    if leaf != "exposure":
        assert failures(group, leaf, usual, failing, 10) == f"{place} (10 of 10)"


@pytest.mark.parametrize(
    ("x", "y", "where"),
    [(0.5, 1.5, "straight in the west"), (1.5, 0.5, "straight in the south-west"),
     (4.5, 0.5, "bend in the south-east"), (2.5, 2.5, "straight in the north"),
     (4.5, 1.5, "straight in the east")],
)  # fmt: skip
def test_a_place_is_told_by_thirds_of_the_map(x: float, y: float, where: str) -> None:
    tiles = [["curve_left/W", *["straight/W"] * 3, "curve_left/N"],
             ["straight/S", *["grass"] * 3, "straight/N"],
             ["curve_left/S", *["straight/E"] * 3, "curve_left/E"]]  # fmt: skip
    ring = read_map({"tile_size": 0.585, "tiles": tiles}, "ring")
    there = Ride(poses=[np.array((0.585 * x, 0.585 * y, 0.0))], look=NOMINAL)
    assert where_failed(ring, [(False, there)]) == f"most on the {where} (1 of 1)"


def test_one_failure_tells_a_place_and_no_look() -> None:
    road_map = load_map("loop")
    one = [(k > 0, Ride(poses=[np.zeros(3)], look=NOMINAL)) for k in range(20)]
    assert where_failed(road_map, one) == "most on the bend in the south-west (1 of 1)"


def test_floors_of_other_options_are_not_taken_for_these(tmp_path: Path) -> None:
    nothing = ["--floors", "--record-only"]  # named none: none is driven
    own = tmp_path / "inputs.json"
    own.write_text(json.dumps({"base": "lane_ppo"}))
    assert judge_teach_loop.main([str(tmp_path), "--base", "lane_dueling", *nothing]) == 2
    assert json.loads(own.read_text()) == {"base": "lane_ppo"}
