"""What a run must remember to go on: network, optimiser, counters and the record so far."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy

from robot.typed_config import from_plain, to_plain
from trainer.torch_file import loaded, save_torch

REMEDY = (
    "; put a copy of it back, or delete it and train from the beginning: best.pt, if it lies "
    "there, still holds the best policy so far"
)
_COUNTERS = ("num_timesteps", "_n_updates", "_n_calls", "_episode_num", "learning_starts")


@dataclass(frozen=True)
class Evaluated:
    """The outcome of one evaluation during training."""

    step: int
    seconds: float  # of training until then
    success_rate: float
    mean_reward: float
    mean_steps: float  # decisions until the end of the episode
    cpu_seconds: float = float("nan")  # of training until then, all threads
    mean_distance_m: float | None = None  # from the path, where the world tells it

    @property
    def rank(self) -> tuple[float, float]:
        """Larger is better. Reward counts for each decision, since missions differ in length."""
        return (self.success_rate, self.mean_reward / max(self.mean_steps, 1.0))


@dataclass
class TrainState:
    """The record of a run, kept in its checkpoint."""

    seconds: float = 0.0  # wall clock of training, evaluations included
    evaluation_seconds: float = 0.0
    cpu_seconds: float = 0.0  # of all threads, and of A3C's workers
    evaluations: tuple[Evaluated, ...] = ()
    stopped_by: str = ""  # steps, seconds, solved or interrupted; empty while it runs

    @property
    def best(self) -> Evaluated | None:
        """The evaluation whose policy is kept; of equals the first."""
        return max(self.evaluations, key=lambda e: e.rank, default=None)


def save_checkpoint(path: Path, model: BaseAlgorithm, state: TrainState) -> None:
    """Atomically write everything but the replay buffer, which lies in files of its own."""
    save_torch(path, {**content_of(model), "state": to_plain(state)})


def content_of(model: BaseAlgorithm) -> dict[str, Any]:
    """What a model has learned: weights, the optimiser's statistics, counters."""
    return {
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "counters": {n: getattr(model, n) for n in _COUNTERS if hasattr(model, n)},
    }


def put_back(model: BaseAlgorithm, content: dict[str, Any]) -> None:
    """Make a model of the same shape what another one was."""
    model.policy.load_state_dict(content["policy"])
    model.policy.optimizer.load_state_dict(content["optimizer"])
    for name, value in content["counters"].items():
        setattr(model, name, value)


def read_state(path: Path, model: BaseAlgorithm | None = None) -> TrainState:
    """The record in a checkpoint; a freshly built model is put back where it was written."""
    with loaded(path, "the checkpoint of this run", remedy=REMEDY) as content:
        if model is not None:
            replay = getattr(model, "replay_buffer", None)
            warm_up = getattr(model, "learning_starts", 0)
            put_back(model, content)
            if replay is not None and not replay.size():  # thrown away when the run had ended
                cast(Any, model).learning_starts = warm_up + model.num_timesteps
        return from_plain(TrainState, content["state"], where=str(path))


def load_policy(path: Path, policy: BasePolicy) -> None:
    """Put the weights of ``best.pt`` or ``checkpoint.pt`` into a policy of the same shape."""
    with loaded(path, "a policy of this run", policy.device) as content:
        policy.load_state_dict(content.get("policy", content))
