"""Pictures that stay on a device: what is learned from their numbers is learned from them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from stable_baselines3.common.vec_env import VecEnv

import robot
from robot.errors import ConfigError
from sim_pybullet.rendering.torch_camera import TorchCamera
from tests.sim_pybullet.rendering.test_torch_camera import DEVICES
from tests.thorough import count
from tests.trainer.toy import build_model, make_toy, toy_config
from trainer.commands import export_command
from trainer.config import RunConfig
from trainer.envs import SeenOtherwise, draws_on_gpu, image_changed, make_env
from trainer.learners.policies import build_policy
from trainer.learners.world import PictureStore, learning_world
from trainer.options import TrainOptions
from trainer.run import RunFolder
from trainer.training.checkpoint import load_policy
from trainer.training.train import train

SIGHT = str(Path(robot.__file__).parent / "models" / "sight.onnx")


class Drawn(SeenOtherwise):
    """The toy's pictures as if drawn on a device of torch."""

    device = "cpu"

    def __init__(self, env: VecEnv) -> None:
        super().__init__(env, lambda seen, _: image_changed(seen, torch.from_numpy))


def make_drawn(config: RunConfig, robots: int, seed: int) -> VecEnv:
    toy = make_toy(config, robots, seed)
    judges = robots == config.evaluation.episodes // config.evaluation.rounds
    return toy if judges else Drawn(toy)


def make_on_torch(config: RunConfig, robots: int, seed: int) -> VecEnv:
    """The real world, drawn by torch."""
    return make_env(config, robots, seed, TorchCamera(config.image, robots, device="cpu"))


@given(st.lists(st.integers(1, 7), min_size=1, max_size=20), st.sampled_from(DEVICES))
def test_the_newest_pictures_are_there_by_number(sizes: list[int], device: str) -> None:
    rng, store = np.random.default_rng(0), PictureStore(16, (2, 3, 6), device)
    kept: dict[int, np.ndarray] = {}
    for size in sizes:
        pictures = rng.integers(0, 256, (size, 2, 3, 6), dtype=np.uint8)
        numbers = store.put(torch.from_numpy(pictures).to(device))
        assert numbers.shape == (size,)
        kept |= dict(zip(numbers.tolist(), pictures, strict=True))
    wanted = torch.tensor(sorted(kept), device=device)
    np.testing.assert_array_equal(
        store.take(wanted.float()).cpu().numpy(), [kept[k] for k in sorted(kept)]
    )
    assert len(kept) == min(16, sum(sizes)), "no number twice before all were used"
    single = store.put(torch.full((2, 3, 6), 7, dtype=torch.uint8, device=device))
    assert single.shape == ()
    assert (store.take(torch.tensor(single)[None]).cpu().numpy() == 7).all()


@pytest.mark.parametrize("algorithm", ["ppo", "dueling", "dagger", "a2c", "ddqn"][: count(2, 5)])
def test_who_learns_from_numbers_learns_the_same_to_the_bit(algorithm: str, tmp_path: Path) -> None:
    def run(name: str, make: Any) -> tuple[list[float], dict[str, torch.Tensor]]:
        folder, config = RunFolder(tmp_path / name), toy_config(algorithm, 600)
        train(config, folder, make, Console(quiet=True))
        policy = build_policy(config)
        load_policy(folder.path / "best.pt", policy)
        return [episode.reward for episode in folder.episodes()], policy.state_dict()

    (rewards, weights), (same, there) = run("arrays", make_toy), run("tensors", make_drawn)
    assert rewards == same
    assert len(rewards) > 20
    assert all(torch.equal(weights[name], there[name]) for name in weights)
    assert (tmp_path / "tensors" / "model.onnx").exists()


@pytest.mark.parametrize(("make", "kept"), [(make_toy, True), (make_drawn, False)])
def test_a_replay_buffer_of_numbers_ends_with_its_pictures(
    make: Any, kept: bool, tmp_path: Path
) -> None:
    """Who goes on after a kill takes up an old buffer only if it can still see what is in it."""
    config = toy_config("dueling", 400)

    def begun() -> Any:
        env = learning_world(config, make)
        return build_model(config, env, tmp_path)

    begun().learn(200)
    rows = int(begun().replay_buffer.rows[0])
    assert rows == (25 if kept else 0)


@pytest.mark.parametrize(
    ("task", "backbone"),
    [("traffic", None), ("navigation", SIGHT), ("lane", None), ("lane", SIGHT)][: count(2, 4)],
    ids=["traffic", "navigation seen", "lane", "lane seen"][: count(2, 4)],
)
def test_a_world_drawn_by_torch_is_the_same_world(task: str, backbone: str | None) -> None:
    """Rewards and ends are equal; of pictures learners see the same but for rounding."""
    options = TrainOptions(task, "ppo", "debug", look="randomised", backbone=backbone)
    # of JPEG a grey level more or less makes another block
    config = replace(options.config(), without=("sensor.jpeg_quality",))
    worlds = [learning_world(config, make) for make in (make_env, make_on_torch)]
    kept = getattr(worlds[1], "pictures", None)
    assert (kept is None) == bool(backbone)
    rng, robots = np.random.default_rng(0), config.learn.robots
    seen = [world.reset() for world in worlds]
    for _ in range(12):
        images = [each["image"] if isinstance(each, dict) else each for each in seen]
        if kept is not None:
            assert np.issubdtype(images[1].dtype, np.integer)
            images[1] = kept.take(torch.from_numpy(images[1])).numpy()
        apart = np.abs(images[0].astype(float) - images[1])
        most = 0.02 * images[0].max() if backbone else 1.0
        assert (apart <= most).mean() > 0.96
        actions = rng.integers(0, 5, robots)
        stepped = [world.step(actions) for world in worlds]
        seen = [step[0] for step in stepped]
        np.testing.assert_array_equal(stepped[0][1], stepped[1][1])
        np.testing.assert_array_equal(stepped[0][2], stepped[1][2])
    for world in worlds:
        world.close()


def test_without_a_gpu_cuda_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is written; auto takes what there is."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    config = TrainOptions(device="cuda").config()
    with pytest.raises(ConfigError, match="finds no GPU here; got 'cuda'"):
        make_env(config, 1, 0)
    assert not draws_on_gpu(replace(config, device="auto"))
    assert not draws_on_gpu(replace(config, device="cpu"))


def test_a_run_of_a_gpu_is_exported_without_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    folder = RunFolder(tmp_path)
    config = replace(TrainOptions("lane", "dagger", "debug", steps=64).config(), device="auto")
    train(config, folder, make_env, Console(quiet=True))
    whole = folder.config.read_text()
    folder.config.write_text(whole.replace("device: auto", "device: cuda"))
    assert folder.config.read_text() != whole
    assert export_command(str(tmp_path)) == 0


def test_with_a_gpu_pictures_are_drawn_there_unless_arrays_are_wanted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    config = TrainOptions(device="auto").config()
    assert draws_on_gpu(config)
    assert draws_on_gpu(replace(config, device="cuda"))
    assert not draws_on_gpu(replace(config, device="cpu"))
    assert not draws_on_gpu(replace(config, relit=True))
    assert not draws_on_gpu(replace(config, translate="translator.onnx"))
    assert not draws_on_gpu(TrainOptions("track", "a3c", device="cuda").config())


def test_an_unknown_device_is_refused() -> None:
    with pytest.raises(ConfigError, match="device: unknown 'gpu'"):
        TrainOptions(device="gpu").config()
