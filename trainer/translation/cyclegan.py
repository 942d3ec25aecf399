"""One step of CycleGAN (Zhu et al. 2017), and what it remembers between steps."""

from __future__ import annotations

import copy
import itertools
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from trainer.translation.config import TranslationConfig
from trainer.translation.losses import adversarial, structure
from trainer.translation.networks import PatchCritic, build_generator

AVERAGED_STEPS = 200  # over which the weights that are kept are averaged


class Batch(NamedTuple):
    """Unpaired pictures (N, 3, H, W) in [-1, 1]; of the simulated ones the paint (N, 4, H, W)."""

    sim: torch.Tensor
    real: torch.Tensor
    paint: torch.Tensor


class ImagePool:
    """Earlier translations that a critic sees again, lest it forgets them."""

    def __init__(self, size: int, rng: np.random.Generator) -> None:
        self._size, self._rng = size, rng
        self.pictures: list[torch.Tensor] = []

    def exchanged(self, made: torch.Tensor) -> torch.Tensor:
        """The translations, half of them exchanged for earlier ones."""
        given = []
        for picture in made.detach():
            if len(self.pictures) < self._size:
                self.pictures.append(picture)
            elif self._rng.random() < 0.5:
                k = int(self._rng.integers(self._size))
                self.pictures[k], picture = picture, self.pictures[k]
            given.append(picture)
        return torch.stack(given)


class CycleGan:
    """Two generators, two critics, their optimisers and pools.

    ``kept_to_real`` and ``kept_to_sim`` are the generators to use: running means of the weights.
    Generators and critics chase each other; a mean stands still (Yazici et al. 2019).
    """

    def __init__(self, config: TranslationConfig, device: torch.device) -> None:
        torch.manual_seed(config.seed)
        self.config, self.device = config, device
        self.to_real = build_generator(config).to(device)
        self.to_sim = build_generator(config).to(device)
        self.kept_to_real, self.kept_to_sim = (
            copy.deepcopy(generator).requires_grad_(False)
            for generator in (self.to_real, self.to_sim)
        )
        critics = [PatchCritic(config.critic_width, config.critic_layers) for _ in range(2)]
        self.real_critic, self.sim_critic = (critic.to(device) for critic in critics)
        self.generators = self._adam(self.to_real, self.to_sim)
        self.critics = self._adam(self.real_critic, self.sim_critic)
        self.rng = np.random.default_rng(config.seed)
        self.real_pool = ImagePool(config.pool, self.rng)
        self.sim_pool = ImagePool(config.pool, self.rng)
        self.steps = 0

    def step(self, batch: Batch) -> dict[str, float]:
        """One update of all four networks; the losses by name, unweighted."""
        self._set_rate()
        made_real, made_sim, losses = self._generate(batch)
        losses["critic_real"] = self._judge(self.real_critic, batch.real, made_real, self.real_pool)
        losses["critic_sim"] = self._judge(self.sim_critic, batch.sim, made_sim, self.sim_pool)
        self._apply(self.critics, losses["critic_real"] + losses["critic_sim"])
        self.steps += 1
        self._average()
        return {name: float(loss.detach()) for name, loss in losses.items()}

    def state(self) -> dict[str, Any]:
        """Everything that the next step depends on."""
        return {
            "networks": [network.state_dict() for network in self._networks()],
            "optimisers": [self.generators.state_dict(), self.critics.state_dict()],
            "pools": [self.real_pool.pictures, self.sim_pool.pictures],
            "rng": self.rng.bit_generator.state,
            "steps": self.steps,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what ``state`` gave."""
        for network, weights in zip(self._networks(), state["networks"], strict=True):
            network.load_state_dict(weights)
        for optimiser, saved in zip(
            (self.generators, self.critics), state["optimisers"], strict=True
        ):
            optimiser.load_state_dict(saved)
        self.real_pool.pictures, self.sim_pool.pictures = state["pools"]
        self.rng.bit_generator.state = state["rng"]
        self.steps = state["steps"]

    def _generate(self, batch: Batch) -> tuple[torch.Tensor, torch.Tensor, dict[str, torch.Tensor]]:
        config = self.config
        for parameter in self._critic_parameters():
            parameter.requires_grad_(False)
        made_real, made_sim = self.to_real(batch.sim), self.to_sim(batch.real)
        losses = {
            "fool_real": adversarial(self.real_critic(made_real), True),
            "fool_sim": adversarial(self.sim_critic(made_sim), True),
            "cycle": functional.l1_loss(self.to_sim(made_real), batch.sim)
            + functional.l1_loss(self.to_real(made_sim), batch.real),
            "structure": structure(made_real, batch.paint),
        }
        total = losses["fool_real"] + losses["fool_sim"] + config.cycle * losses["cycle"]
        if config.identity:
            losses["identity"] = self._identity(batch)
            total = total + config.identity * losses["identity"]
        if config.structure:
            total = total + config.structure * losses["structure"]
        self._apply(self.generators, total)
        for parameter in self._critic_parameters():
            parameter.requires_grad_(True)
        return made_real.detach(), made_sim.detach(), losses

    def _identity(self, batch: Batch) -> torch.Tensor:
        """Both directions in turns, each counted twice: the same on average for half the work."""
        if self.steps % 2:
            return 2.0 * functional.l1_loss(self.to_real(batch.real), batch.real)
        return 2.0 * functional.l1_loss(self.to_sim(batch.sim), batch.sim)

    def _judge(
        self, critic: nn.Module, real: torch.Tensor, made: torch.Tensor, pool: ImagePool
    ) -> torch.Tensor:
        earlier = pool.exchanged(made)
        return 0.5 * (adversarial(critic(real), True) + adversarial(critic(earlier), False))

    @torch.no_grad()
    def _average(self) -> None:
        share = 1.0 / min(self.steps, AVERAGED_STEPS)
        pairs = ((self.kept_to_real, self.to_real), (self.kept_to_sim, self.to_sim))
        for kept, newest in pairs:
            torch._foreach_lerp_(list(kept.parameters()), list(newest.parameters()), share)

    def _set_rate(self) -> None:
        config = self.config
        begin = config.decay_from * config.steps
        left = 1.0 - max(0.0, self.steps - begin) / max(1.0, config.steps - begin)
        for optimiser in (self.generators, self.critics):
            for group in optimiser.param_groups:
                group["lr"] = config.learning_rate * left

    def _apply(self, optimiser: torch.optim.Optimizer, loss: torch.Tensor) -> None:
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()

    def _adam(self, *networks: nn.Module) -> torch.optim.Adam:
        parameters = itertools.chain(*(network.parameters() for network in networks))
        return torch.optim.Adam(
            parameters, self.config.learning_rate, betas=(0.5, 0.999), fused=True
        )

    def _networks(self) -> tuple[nn.Module, ...]:
        critics = (self.real_critic, self.sim_critic)
        return (self.to_real, self.to_sim, *critics, self.kept_to_real, self.kept_to_sim)

    def _critic_parameters(self) -> itertools.chain[nn.Parameter]:
        return itertools.chain(self.real_critic.parameters(), self.sim_critic.parameters())
