"""One update of each learner, against what the papers say of it."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.utils import parameters_to_vector

from tests.trainer.toy import BrightColumn, ToyVecEnv, build_model, make_toy, toy_config
from trainer.algorithms.ddqn import DoubleDQN, QConfig
from trainer.config import RunConfig


def with_learn(algorithm: str, **changes: Any) -> RunConfig:
    config = toy_config(algorithm, 10_000)
    return replace(config, learn=replace(config.learn, **changes))


def q_model(folder: Path, **changes: Any) -> DoubleDQN:
    config = with_learn("ddqn", **changes)
    assert isinstance(config.learn, QConfig)
    model = build_model(config, make_toy(config, 8, 0), folder)
    assert isinstance(model, DoubleDQN)
    return model


def test_the_target_network_follows_by_its_share_each_step_of_all_robots(tmp_path: Path) -> None:
    """With an online network that stands still, 1 - (1 - tau)^k of the way is done in k steps."""
    model = q_model(tmp_path, learning_rate=0.0, target_tau=0.05, warm_up=0)
    online = parameters_to_vector(model.q_net.parameters())
    with torch.no_grad():
        for parameter in model.q_net_target.parameters():
            parameter.zero_()
    model.learn(8 * 10)
    target = parameters_to_vector(model.q_net_target.parameters())
    torch.testing.assert_close(target, (1.0 - 0.95**10) * online)


def test_a_step_of_dqn_goes_no_farther_than_its_gradient_may(tmp_path: Path) -> None:
    model = q_model(tmp_path, max_grad_norm=1e-3)
    model.learn(300)
    gradients = [p.grad for p in model.q_net.parameters() if p.grad is not None]
    assert 0.0 < torch.cat([g.flatten() for g in gradients]).norm() <= 1.001e-3


@pytest.mark.parametrize("algorithm", ["ppo", "a2c", "ddqn", "dagger"])
def test_the_limit_of_gradients_and_the_discount_reach_the_learner(
    algorithm: str, tmp_path: Path
) -> None:
    config = with_learn(algorithm, max_grad_norm=0.123)
    model: Any = build_model(config, make_toy(config, 8, 0), tmp_path)
    assert model.max_grad_norm == 0.123
    assert model.gamma == (0.99 if algorithm == "dagger" else 0.5)


def of(model: Any, names: str) -> list[Any]:
    return [getattr(model, name) for name in names.split()]


def test_the_settings_of_a_run_reach_its_learner(tmp_path: Path) -> None:
    def model(algorithm: str, **learn: Any) -> Any:
        config = replace(with_learn(algorithm, learning_rate=0.003, **learn), rate_left=0.5)
        return build_model(config, make_toy(config, 8, 0), tmp_path / algorithm)

    several = {"gamma": 0.91, "batch": 33, "gradient_steps": 2, "buffer": 808, "warm_up": 17}
    q = model("dueling", **several, n_step=2, epsilon_final=0.07, epsilon_steps=2_500)
    assert of(q, "gamma batch_size gradient_steps learning_starts") == [0.91, 33, 2, 17]
    assert (q.buffer_size, q.train_freq.frequency, q.replay_buffer.n_steps) == (808, 1, 2)
    assert of(q, "exploration_final_eps exploration_fraction") == [0.07, 0.25]
    assert model("ddqn", epsilon_steps=99_999).exploration_fraction == 1.0

    several = {"gamma": 0.91, "gae_lambda": 0.83, "value": 0.7, "entropy": 0.03}
    ppo = model("ppo", **several, rollout=16, minibatch=64, epochs=5, clip=0.11)
    assert of(ppo, "gamma gae_lambda vf_coef ent_coef") == [0.91, 0.83, 0.7, 0.03]
    assert of(ppo, "n_steps batch_size n_epochs") == [16, 64, 5]
    assert ppo.clip_range(1.0) == 0.11
    a2c = model("a2c", **several, a2c_rollout=7)
    assert of(a2c, "gamma gae_lambda vf_coef ent_coef") == [0.91, 0.83, 0.7, 0.03]
    assert (a2c.n_steps, type(a2c.policy.optimizer).__name__) == (7, "Adam")

    own = {"rms_decay": 0.7, "rms_epsilon": 0.2, "normalised": True}
    a3c = model("a3c", gamma=0.91, value=0.7, entropy=0.03, a3c_rollout=6, workers=3, **own)
    assert of(a3c, "gamma gae_lambda vf_coef ent_coef") == [0.91, 1.0, 0.7, 0.03]
    assert (a3c.n_steps, a3c.normalize_advantage, len(a3c.optimiser.shared.steps)) == (6, True, 3)
    assert of(a3c.optimiser, "_decay _epsilon") == [0.7, 0.2]

    several = {"batch": 33, "gradient_steps": 3, "buffer": 808, "warm_up": 17, "dagger_every": 6}
    several |= {"expert_steps": 77, "random_share": 0.04, "untold_share": 0.2}
    dagger = model("dagger", **several)
    assert of(dagger, "batch_size gradient_steps learning_starts") == [33, 3, 17]
    buffer = dagger.replay_buffer
    assert (dagger.buffer_size, dagger.train_freq.frequency, buffer.n_steps) == (808, 6, 1)
    assert of(dagger, "expert_steps random_share untold_share") == [77, 0.04, 0.2]

    rates = pytest.approx([0.003, 0.00225, 0.0015])
    for learner, epsilon in ((q, 1e-8), (ppo, 1e-5), (a2c, 1e-5), (dagger, 1e-8)):
        assert [learner.lr_schedule(left) for left in (1.0, 0.5, 0.0)] == rates
        assert learner.policy.optimizer.defaults["eps"] == epsilon


def test_the_expert_drives_less_and_less_and_chance_its_share(tmp_path: Path) -> None:
    """Of 2,000 robots; what is stored is always the expert's choice."""
    robots = 2_000
    config = with_learn("dagger", expert_steps=400, random_share=0.25, robots=robots)
    model: Any = build_model(config, make_toy(config, robots, 0), tmp_path)
    model._setup_learn(10_000, None)
    expert = model.env.expert_actions()
    learner = model.predict(model._last_obs, deterministic=True)[0]
    assert (learner != expert).mean() > 0.5
    for done, share in ((0, 1.0), (100, 0.75), (400, 0.0), (9_000, 0.0)):
        model.num_timesteps = done
        taken, stored = model._sample_action(0, None, robots)
        np.testing.assert_array_equal(stored, expert)
        differ = expert != learner
        wanted = 0.75 * share + 0.25 / 5.0
        assert (taken == expert)[differ].mean() == pytest.approx(wanted, abs=0.04)


def test_a_share_is_learned_from_without_the_last_commands_but_with_the_path(
    tmp_path: Path,
) -> None:
    config = replace(with_learn("dagger", untold_share=0.4), commands=5)
    env = ToyVecEnv([lambda: BrightColumn(with_path=True)] * 8)
    model: Any = build_model(config, env, tmp_path)
    assert model.commands == 5
    model.learn(128)
    batch = model.replay_buffer.sample(2_000)
    model.replay_buffer.sample = lambda _: batch
    for commands, share in ((0, 0.0), (2, 0.4)):
        batch.observations["path"][:] = 1.0
        model.commands = commands
        model._update(2_000)
        seen = batch.observations["path"].numpy()
        assert (seen[:, :6] == 1.0).all(), "the path"
        told = seen[:, 6:]
        assert (told == told[:, :1]).all()
        assert (told[:, 0] == 0.0).mean() == pytest.approx(share, abs=0.04)


def test_dagger_descends_on_the_likelihood_of_the_experts_choices(tmp_path: Path) -> None:
    config = with_learn("dagger")
    model: Any = build_model(config, make_toy(config, 8, 0), tmp_path)
    model.learn(128)
    batch = model.replay_buffer.sample(64)
    model.replay_buffer.sample = lambda _: batch
    with torch.no_grad():
        logs = torch.log_softmax(model.policy.logits(batch.observations), 1)
    wanted = -logs.gather(1, batch.actions.long()).mean()
    assert model._update(64) == pytest.approx(float(wanted), rel=1e-5)
    assert model._update(64) < float(wanted)


def test_when_the_expert_drives_follows_from_the_seed(tmp_path: Path) -> None:
    drawn = []
    for k, seed in enumerate((1, 1, 2)):
        config = replace(with_learn("dagger"), seed=seed)
        model: Any = build_model(config, make_toy(config, 8, 0), tmp_path / str(k))
        drawn.append(model.rng.random())
    assert drawn[0] == drawn[1] != drawn[2]
