"""How large a policy is."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import nn

from trainer.config import RunConfig
from trainer.learners.networks import GreedyNetwork, observation_shapes
from trainer.learners.policies import build_policy, observation_space


@dataclass(frozen=True)
class Summary:
    """Of one policy."""

    image: tuple[int, int, int]  # (H, W, 3)
    parameters: int  # trained: for Q networks without the target's copy, else actor and critic
    driving: int  # of them, those that the exported policy holds
    macs: int  # multiply-accumulates of one decision


def summarise(config: RunConfig) -> Summary:
    """Build the policy and count."""
    policy = build_policy(config)
    network = GreedyNetwork(policy)
    image, points = observation_shapes(observation_space(config))
    trained = [p for name, p in policy.named_parameters() if "target" not in name]
    return Summary(
        image,
        sum(p.numel() for p in trained),
        sum(p.numel() for p in network.parameters()),
        _count_macs(network, image, points),
    )


def _count_macs(network: GreedyNetwork, image: tuple[int, int, int], path_points: int) -> int:
    counts: list[int] = []

    def count(module: nn.Module, inputs: object, output: torch.Tensor) -> None:
        del inputs
        weight = module.weight
        assert isinstance(weight, torch.Tensor)
        positions = output[0, 0].numel() if isinstance(module, nn.Conv2d) else 1
        counts.append(weight.numel() * positions)

    layers = [m for m in network.modules() if isinstance(m, (nn.Conv2d, nn.Linear))]
    hooks = [layer.register_forward_hook(count) for layer in layers]
    with torch.no_grad():
        path = torch.zeros(1, path_points) if path_points else None
        network(torch.zeros((1, *image), dtype=torch.uint8), path)
    for hook in hooks:
        hook.remove()
    return sum(counts)
