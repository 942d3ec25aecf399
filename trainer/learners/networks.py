"""The networks of the Duckiebot paper (Figures 7 and 15) as stable-baselines3 policies.

Three convolutions, large kernels and strides first and no pooling, then three fully connected
layers; actor and critic share the convolutions and the first of them. Pictures enter as the
environment gives them, (N, H, W, 3) with values 0..255: the transposition and the scaling
happen in here, so that an exported policy takes raw frames.
"""

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, create_mlp
from stable_baselines3.dqn.policies import DQNPolicy, QNetwork
from torch import nn

from robot.contract import PATH_POINTS, ActionTable
from robot.errors import ContractError
from trainer.config import NetConfig
from trainer.envs import parts_of
from trainer.learners.backbone import Backbone, centred, fresh, read_backbone
from trainer.learners.world import TRUE_PATH, PictureStore

KERNELS_AND_STRIDES = ((8, 4), (4, 2), (3, 1), (2, 1))  # of as many convolutions as there are

_SMALL = 0.01  # of the critic's last weights at first, as stable-baselines3 has it for the actor's
_MOST_ACTIONS = 9  # outputs of a last layer, whose weights begin smaller


class DrivingFeatures(BaseFeaturesExtractor):
    """Convolutions and first fully connected layer; with a path, both branches concatenated.

    Takes a picture (N, H, W, 3 F) of F stacked frames, or a dict of ``image`` and ``path`` (N, P)
    in [-1, 1]. In place of the picture it takes what its backbone saw there, (N, F width), or the
    number that ``pictures`` gave it.
    """

    def __init__(
        self, observation_space: spaces.Space, net: NetConfig, pictures: PictureStore | None = None
    ) -> None:
        shapes = {name: part.shape for name, part in parts_of(observation_space).items()}
        image = pictures.shape if pictures else shapes.get("image", ())
        path_points = sum(shapes.get("path", ()))
        if len(image) not in (1, 3) or (image[2:] and image[2] % 3):
            raise ContractError(f"expected a picture (H, W, 3), got {observation_space}")
        super().__init__(observation_space, net.image_fc + net.path_fc[1] * bool(path_points))
        self._pictures = pictures
        self._centred = net.centred
        if net.backbone:
            backbone = read_backbone(Path(net.backbone))
            self.convolutions: nn.Sequential = backbone
            flat = backbone.width * image[2] // 3 if image[1:] else image[0]
        else:
            sizes = itertools.pairwise((image[2], *net.channels))
            each = zip(sizes, KERNELS_AND_STRIDES, strict=False)
            pairs = ((nn.Conv2d(*size, *how), nn.ReLU()) for size, how in each)
            self.convolutions = nn.Sequential(*itertools.chain.from_iterable(pairs))
            with torch.no_grad():
                flat = self.convolutions(torch.zeros(1, image[2], *image[:2])).numel()
        self.image_fc = nn.Sequential(nn.Linear(flat, net.image_fc), nn.ReLU())
        self.path_fc = None
        if path_points:
            self.path_fc = nn.Sequential(*create_mlp(path_points, -1, list(net.path_fc)))
        self.apply(_orthogonal)

    def forward(self, observation: torch.Tensor | dict[str, torch.Tensor]) -> torch.Tensor:
        """(N, features)."""
        parts = parts_of(observation)
        seen: torch.Tensor = parts["image"]
        if self._pictures is not None and seen.ndim < 3:
            seen = self._pictures.take(seen.flatten())
        if not isinstance(self.convolutions, Backbone):
            pixels = centred(seen) if self._centred else fresh(seen).div_(255.0)
            seen = self.convolutions(pixels).flatten(1)
        elif seen.ndim > 2:
            seen = self.convolutions(seen)
        features = self.image_fc(seen)
        if self.path_fc is None:
            return features
        return torch.cat((features, self.path_fc(parts["path"])), 1)


class DuelingQNetwork(QNetwork):
    """Q = V + A - mean(A), a fully connected layer for each stream (Wang et al. 2016, eq. 9)."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        advantage = self.q_net
        hidden = nn.Sequential(*create_mlp(self.features_dim, -1, self.net_arch))
        self.q_net = _Dueling(nn.Sequential(hidden, nn.Linear(self.net_arch[-1], 1)), advantage)


class _Dueling(nn.Sequential):
    def forward(self, features: torch.Tensor) -> torch.Tensor:
        value, advantage = self[0](features), self[1](features)
        return value + advantage - advantage.mean(dim=1, keepdim=True)


class Hedge(nn.Module):
    """The last layer of who imitates: how near each action's turn is to what the expert may do.

    Logits (N, actions) -> values, minus the expected square of the difference to the expert's turn
    (right less left wheel) in dm/s. Who is torn between left and right so goes straight on, where
    the likeliest choice would be one of both.
    """

    def __init__(self, actions: ActionTable) -> None:
        super().__init__()
        turns = torch.tensor([10.0 * (right - left) for left, right in actions])
        self.costs = nn.Buffer(-(turns[:, None] - turns).square())

    def forward(self, logits: torch.Tensor) -> torch.Tensor:
        """See the class."""
        return logits.softmax(1) @ self.costs


class QPolicy(DQNPolicy):
    """Online and target network; orthogonal weights."""

    network: type[QNetwork] = QNetwork
    true_path: float  # weight of the auxiliary task, see `trainer.learners.world.with_true_path`

    def __init__(self, *args: Any, true_path: float = 0.0, **kwargs: Any) -> None:
        self.true_path = true_path
        super().__init__(*args, **kwargs)

    def make_q_net(self) -> QNetwork:
        """A fresh network with a feature extractor of its own."""
        arguments = self._update_features_extractor(self.net_args, features_extractor=None)
        network = self.network(**arguments)
        network.q_net.apply(_orthogonal)
        if self.true_path:
            network.path_head = nn.Linear(self.net_arch[-1], PATH_POINTS)
        return network.to(self.device)

    def values_and_path_loss(self, observation: Any) -> tuple[torch.Tensor, torch.Tensor]:
        """What actions are worth (N, actions), and the weighted loss of the auxiliary task."""
        network = self.q_net
        features = network.extract_features(observation, network.features_extractor)
        values = network.q_net(features)
        if not self.true_path:
            return values, values.new_zeros(())
        head = network.q_net
        chooser = cast(nn.Sequential, head[1]) if isinstance(head, _Dueling) else head
        fused = chooser[:-1](features)
        error = cast(nn.Linear, network.path_head)(fused) - observation[TRUE_PATH]
        return values, self.true_path * error.square().mean()


class ImitatingPolicy(QPolicy):
    """As `QPolicy`, of who imitates an expert; `Hedge` chooses among ``hedged`` actions."""

    def __init__(self, *args: Any, hedged: ActionTable = (), **kwargs: Any) -> None:
        self._hedged = hedged
        super().__init__(*args, **kwargs)

    def make_q_net(self) -> QNetwork:
        """See `QPolicy`."""
        network = super().make_q_net()
        if self._hedged:
            network.q_net.append(Hedge(self._hedged).to(self.device))
        return network

    def logits(self, observation: Any) -> torch.Tensor:
        """(N, actions) of the expert's choice."""
        network = self.q_net
        features = network.extract_features(observation, network.features_extractor)
        return unhedged(network.q_net)(features)


class DuelingPolicy(QPolicy):
    """As `QPolicy`, with two streams."""

    network = DuelingQNetwork


class DrivingActorCritic(ActorCriticPolicy):
    """Actor and critic, with the auxiliary task of `with_true_path` where it has a weight.

    Values begin near 0, as the actor's logits do. Else the first thing that is learned is to take
    away the values of a fresh network: all that actor and critic share shrinks, and now and then
    the first convolution is dead before that is over.
    """

    true_path: float  # that weight, as a multiple of the weight of the entropy

    def __init__(self, *args: Any, true_path: float = 0.0, **kwargs: Any) -> None:
        self.true_path = true_path
        self.losses: list[torch.Tensor] = []  # entropy and path loss of each batch
        super().__init__(*args, **kwargs)

    def _build(self, lr_schedule: Callable[[float], float]) -> None:
        super()._build(lr_schedule)
        with torch.no_grad():
            self.value_net.weight.mul_(_SMALL)

    def _build_mlp_extractor(self) -> None:
        super()._build_mlp_extractor()
        if self.true_path:
            self.path_head = nn.Linear(self.mlp_extractor.latent_dim_pi, PATH_POINTS)

    def evaluate_actions(
        self, obs: Any, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """As of stable-baselines3; it maximises the entropy, so the auxiliary loss comes off it."""
        latent, latent_value = self.mlp_extractor(self.extract_features(obs))
        chosen = self._get_action_dist_from_latent(latent)
        entropy = chosen.entropy()
        if self.true_path and entropy is not None:
            error = (self.path_head(latent) - obs[TRUE_PATH]).square().mean(dim=1)
            self.losses.append(torch.stack((entropy.mean(), error.mean())).detach())
            entropy = entropy - self.true_path * error
        return self.value_net(latent_value), chosen.log_prob(actions), entropy


class GreedyNetwork(nn.Module):
    """What drives: observation -> values (N, actions), of which the largest is chosen.

    Q values of a `QPolicy`, logits of an actor. This is the part that is exported.
    """

    def __init__(self, policy: BasePolicy) -> None:
        super().__init__()
        if isinstance(policy, DQNPolicy):
            self.features, self.head = policy.q_net.features_extractor, policy.q_net.q_net
        else:
            assert isinstance(policy, ActorCriticPolicy)
            actor = policy.mlp_extractor.policy_net
            self.features = policy.pi_features_extractor
            self.head = nn.Sequential(actor, policy.action_net)

    def forward(self, image: torch.Tensor, path: torch.Tensor | None = None) -> torch.Tensor:
        """image (N, H, W, 3) uint8 or float 0..255, path (N, P) -> (N, actions)."""
        return self.head(self.features(image if path is None else {"image": image, "path": path}))

    @torch.no_grad()
    def actions(self, observation: np.ndarray | dict[str, np.ndarray]) -> np.ndarray:
        """The greedy choices (N,) int64 for a batch as the environment gives it."""
        return self(**self._tensors(observation)).argmax(dim=1).cpu().numpy()

    def logits(self, observation: np.ndarray | dict[str, np.ndarray]) -> torch.Tensor:
        """(N, actions) of what was learned, without a `Hedge`."""
        return unhedged(self.head)(self.features(self._tensors(observation)))

    def _tensors(self, observation: np.ndarray | dict[str, np.ndarray]) -> dict[str, torch.Tensor]:
        device = next(self.parameters()).device
        parts = parts_of(observation).items()
        return {name: torch.from_numpy(part).to(device) for name, part in parts}


def unhedged(head: nn.Sequential) -> nn.Sequential:
    """What gives the logits of a head that `Hedge` may end."""
    return cast(nn.Sequential, head[:-1]) if isinstance(head[-1], Hedge) else head


def _orthogonal(module: nn.Module) -> None:
    last = isinstance(module, nn.Linear) and module.out_features <= _MOST_ACTIONS
    BasePolicy.init_weights(module, gain=1.0 if last else np.sqrt(2.0))
