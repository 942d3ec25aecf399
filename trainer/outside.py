"""A policy from elsewhere becomes an ONNX file that the robot takes.

A stable-baselines3 zip (PPO, A2C, DQN, SAC, TD3 …) says what it sees and does by its spaces; a
torch module needs a contract beside it. A policy with continuous wheel speeds becomes one that
chooses the nearest of a table: the robot's policies choose.

Only for files that you trust: a stable-baselines3 zip can run any code when it is opened.
"""

import importlib
import itertools
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.save_util import load_from_zip_file
from torch import nn

from robot.command_line import one_line
from robot.contract import FIVE_ACTIONS, MAX_WHEEL_MPS, PATH_POINTS, ImageSpec, PolicyContract
from robot.errors import ConfigError, ContractError
from robot.inference.policy import OnnxPolicy
from robot.output import atomically
from robot.typed_config import load_yaml
from trainer.envs import parts_of
from trainer.export import NOISY_FRAMES, check_equal, export_network, noise_seen
from trainer.torch_file import reading

# For continuous policies: every pair of these, a stop among them.
_SPEEDS_MPS = tuple(MAX_WHEEL_MPS * share / 3.0 for share in range(4))
WHEEL_GRID = tuple(itertools.product(_SPEEDS_MPS, _SPEEDS_MPS))
EXAMPLE = "task: lane, algorithm: mine, image: {width_px: 160, height_px: 120, crop_top_px: 0}"


def export_outside(source: str, contract: Path | None, out: Path | None) -> tuple[Path, float]:
    """Write a policy from elsewhere as ONNX; the file, and how far its values are from torch's.

    ``source``: a stable-baselines3 zip, a TorchScript file, or MODULE:ATTRIBUTE, which is a torch
    module or makes one. ``contract``: YAML of a `robot.contract.PolicyContract`; a zip needs none.
    ConfigError: there is no such policy, or no contract. ContractError: the network does not do
    what the contract says.
    """
    path = Path(source)
    if out is None and not path.exists():
        raise ConfigError(f"{source}: expected --out FILE.onnx for a module, got none")
    out = out or path.with_suffix(".onnx")
    agreed = None if contract is None else load_yaml(PolicyContract, contract)
    if zipfile.is_zipfile(path) and "policy.pth" in zipfile.ZipFile(path).namelist():
        network, agreed = _from_stable_baselines3(path, agreed)
    elif agreed is None:
        told = f"FILE.yaml that says what the network sees and does, such as: {EXAMPLE}"
        raise ContractError(f"{source}: expected a stable-baselines3 zip, or --contract {told}")
    else:
        network = _from_torch(source)
    network.eval()
    seen = noise_seen(agreed, NOISY_FRAMES)
    _expect_values(network, seen, agreed, source)
    with atomically(out) as file:
        try:
            export_network(network, agreed, file)
            difference = check_equal(network, file, seen)
            OnnxPolicy(file)  # what the robot would refuse is refused here
        except ContractError as error:
            raise ContractError(str(error).replace(str(file), source)) from error
    return out, difference


def _from_torch(source: str) -> nn.Module:
    path, (module, _, attribute) = Path(source), source.partition(":")
    if path.exists():
        with reading(path, "a TorchScript file or a stable-baselines3 zip"):
            return torch.jit.load(str(path), map_location="cpu")
    if not attribute:
        raise ConfigError(f"{source}: expected a run folder, a file, or MODULE:ATTRIBUTE")
    sys.path.insert(0, "")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ConfigError(f"{source}: expected MODULE:ATTRIBUTE, got: {error}") from error
    finally:
        sys.path.remove("")
    network = found if isinstance(found, nn.Module) else found() if callable(found) else found
    if not isinstance(network, nn.Module):
        raise ConfigError(
            f"{source}: expected a torch.nn.Module, or what makes one, got {type(network).__name__}"
        )
    return network


def _from_stable_baselines3(
    path: Path, agreed: PolicyContract | None
) -> tuple[nn.Module, PolicyContract]:
    with reading(path, "a policy that stable-baselines3 saved"):
        data, weights, _ = cast(Any, load_from_zip_file(path, device="cpu"))
        kwargs = {k: v for k, v in data.get("policy_kwargs", {}).items() if k != "device"}
        make, seen, done = data["policy_class"], data["observation_space"], data["action_space"]
        if issubclass(make, ActorCriticPolicy):
            kwargs["use_sde"] = data.get("use_sde", False)
        policy = make(seen, done, lambda _: 0.0, **kwargs)
        policy.load_state_dict(weights["policy"])
    contract = agreed or _contract_of(path, seen, done)
    return _ChoosingNetwork(policy.cpu(), contract), replace(contract, run=path.stem)


def _contract_of(path: Path, seen: spaces.Space, done: spaces.Space) -> PolicyContract:
    """What the spaces of a policy say, as the project's environments make them."""
    parts = parts_of(seen)
    image, guide = parts.pop("image", None), parts.pop("path", None)
    if parts or not isinstance(image, spaces.Box) or len(image.shape) != 3:
        raise ContractError(
            f"{path}: expected to see a picture (H, W, 3), or a Dict of image (H, W, 3) and path "
            f"({PATH_POINTS},), got {seen}; train on the environments of duckpilot"
        )
    first, *rest = image.shape  # stable-baselines3 puts the colours of pictures first, by itself
    height, width, channels = (*rest, first) if first < min(rest) else image.shape
    whole = width * 3 // 4
    if width % 4 or height > whole or channels % 3:
        told = f"{path}: expected pictures (H, W, 3) of a 4:3 frame less its top rows, got "
        raise ContractError(f"{told}{image.shape}; tell with --contract how they are made")
    choices = int(done.n) if isinstance(done, spaces.Discrete) else 0
    if choices and choices != len(FIVE_ACTIONS):
        told = f"{path}: expected {len(FIVE_ACTIONS)} actions, got {choices}; tell with --contract "
        raise ContractError(f"{told}which wheel speeds they are")
    return PolicyContract(
        task="lane" if guide is None else "navigation",
        algorithm="stable-baselines3",
        image=ImageSpec(width, whole, whole - height),
        path_points=0 if guide is None else int(np.prod(guide.shape or ())),
        actions=FIVE_ACTIONS if choices else WHEEL_GRID,
        frames=channels // 3,
    )


class _ChoosingNetwork(nn.Module):
    """A policy of stable-baselines3 as the robot's: picture [and path] -> values of the actions."""

    def __init__(self, policy: Any, contract: PolicyContract) -> None:
        super().__init__()
        self.policy = policy
        seen, done = policy.observation_space, policy.action_space
        self.transposed = parts_of(seen)["image"].shape != contract.picture_shape
        self.alone = not isinstance(seen, spaces.Dict)
        self.table: torch.Tensor | None = None
        if isinstance(done, spaces.Box):
            if done.shape != (2,) or not (done.low == -1.0).all() or not (done.high == 1.0).all():
                told = "actions: expected Discrete, or Box(-1, 1, (2,)), the left and right wheel "
                raise ContractError(f"{told}speed as shares of {MAX_WHEEL_MPS:.3f} m/s, got {done}")
            self.table = torch.tensor(contract.actions, dtype=torch.float32)

    def forward(self, image: torch.Tensor, path: torch.Tensor | None = None) -> torch.Tensor:
        """(N, actions): what a Q network or an actor says, or how near an action is."""
        picture = image.permute(0, 3, 1, 2) if self.transposed else image
        seen: Any = picture if self.alone else {"image": picture, "path": path}
        policy = self.policy
        if self.table is not None:
            wheels = MAX_WHEEL_MPS * policy._predict(seen, deterministic=True).clamp(-1.0, 1.0)
            return -(wheels[:, None] - self.table[None]).square().sum(dim=2)
        if hasattr(policy, "q_net"):
            return policy.q_net(seen)
        return policy.get_distribution(seen).distribution.logits


def _expect_values(
    network: nn.Module, seen: dict[str, np.ndarray], contract: PolicyContract, source: str
) -> None:
    asked = (f"{n} (N, {str(p.shape[1:])[1:-1].rstrip(',')}) {p.dtype}" for n, p in seen.items())
    values = f"values (N, {len(contract.actions)}), N = {NOISY_FRAMES}"
    expected = f"expected a network that takes {' and '.join(asked)} and gives {values}"
    try:
        with torch.no_grad():
            given = network(*(torch.from_numpy(part) for part in seen.values()))
    except (RuntimeError, TypeError, ValueError, KeyError) as error:
        told = one_line(str(error))[-200:]
        raise ContractError(f"{source}: {expected}, it ends with: {told}") from error
    got = tuple(given.shape) if isinstance(given, torch.Tensor) else type(given).__name__
    if got != (NOISY_FRAMES, len(contract.actions)):
        raise ContractError(f"{source}: {expected}, got {got}")
