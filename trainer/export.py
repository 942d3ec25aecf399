"""From torch to an ONNX file that a Jetson Nano loads: opset 17, IR 9, the contract inside."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnx
import torch
from onnxruntime import InferenceSession
from onnxruntime.quantization import QuantType, quantize_static
from onnxruntime.quantization.shape_inference import quant_pre_process
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from robot.contract import PolicyContract
from robot.errors import ConfigError, ContractError
from robot.inference.policy import OnnxTranslator, TranslatorContract
from robot.output import write_json
from robot.vision.sight import SightContract
from sim_pybullet.tasks.spec import find_task
from trainer.config import RunConfig
from trainer.envs import parts_of
from trainer.learners.networks import GreedyNetwork
from trainer.learners.policies import build_policy
from trainer.run import RunFolder, atomically
from trainer.training.checkpoint import load_policy, read_state

OPSET = 17
IR_VERSION = 9  # onnxruntime 1.19, the last for Python 3.8, loads up to opset 21 and IR 10
TOLERANCE = 1e-4  # of a value
GREY_TOLERANCE = 1  # of a translator's pixels, by which rounding may go the other way
CHECKED_FRAMES, NOISY_FRAMES, CALIBRATED_AT_ONCE = 1_000, 64, 32
RANDOM_SHARE = 0.2  # of the actions while observations are collected, so that recoveries are seen


@dataclass(frozen=True)
class Exported:
    """What an export was checked with."""

    frames: int  # observations from the environment; none of them calibrated the INT8 version
    largest_difference: float  # between torch and ONNX, in values
    int8_same_choice: float  # share of the frames where INT8 and FP32 choose alike


def export_run(folder: RunFolder, config: RunConfig, env: VecEnv) -> Exported:
    """Write ``model.onnx``, ``model_int8.onnx`` and ``export.json`` of a run's kept policy.

    ConfigError if there is none yet, ContractError if torch and ONNX disagree on some frame.
    """
    network = export_weights(folder, config, folder.best, folder.onnx)
    rng = np.random.default_rng(config.seed)
    calibration = collect_observations(network, env, CHECKED_FRAMES, rng)
    quantise(folder.onnx, calibration, folder.onnx_int8)
    checked = collect_observations(network, env, CHECKED_FRAMES, rng)  # of other episodes
    difference = check_equal(network, folder.onnx, checked)
    choices = [run_onnx(path, checked).argmax(1) for path in (folder.onnx, folder.onnx_int8)]
    exported = Exported(CHECKED_FRAMES, difference, float((choices[0] == choices[1]).mean()))
    write_json(folder.exported, exported)
    return exported


def export_weights(folder: RunFolder, config: RunConfig, weights: Path, out: Path) -> GreedyNetwork:
    """Write the policy of a run's ``best.pt`` or ``checkpoint.pt``, checked on frames of noise.

    ConfigError if there is none of that run, ContractError as above.
    """
    if not weights.exists():
        raise ConfigError(f"{folder.path}: expected a policy that an evaluation kept, found none")
    policy, spec = build_policy(config), find_task(config.task)
    load_policy(weights, policy)
    best = read_state(folder.checkpoint).best if folder.checkpoint.exists() else None
    contract = PolicyContract(
        task=config.task,
        algorithm=config.algorithm,
        image=config.image,
        path_points=spec.path_points,
        commands=config.commands,
        actions=spec.actions,
        frames=spec.kind.frames,
        run=folder.path.resolve().name,
        trained_steps=best.step if best else 0,
        score=best.success_rate if best else None,
    )
    network = GreedyNetwork(policy)
    export_network(network, contract, out)
    check_equal(network, out, noise_seen(contract, NOISY_FRAMES))
    return network


def export_network(network: nn.Module, contract: PolicyContract, path: Path) -> None:
    """Write a policy: ``image`` uint8 (N, H, W, 3) [, ``path``] -> ``values``."""
    inputs = {"image": torch.zeros((2, *contract.picture_shape), dtype=torch.uint8)}
    if contract.told:
        inputs["path"] = torch.zeros(2, contract.told)
    with atomically(path) as temporary:
        write_onnx(network, inputs, "values", contract, temporary)


def write_onnx(
    network: nn.Module,
    inputs: Mapping[str, torch.Tensor],
    output: str,
    contract: PolicyContract | SightContract | TranslatorContract,
    path: Path,
    size: Sequence[int] = (),
) -> None:
    """Write a network of batches, with its contract in the file's metadata.

    ``inputs`` are examples by name, in the network's order; ``size`` is that of the output's axes
    after the first, where tracing leaves them open. torch's older exporter is used on purpose: the
    newer one needs onnxscript and cannot write opset 17.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tracer's, of sizes that are fixed here
        torch.onnx.export(
            network.cpu().eval(),
            tuple(inputs.values()),
            str(path),
            dynamo=False,
            opset_version=OPSET,
            input_names=list(inputs),
            output_names=[output],
            dynamic_axes={name: {0: "n"} for name in (*inputs, output)},
        )
    model = onnx.load(str(path))
    model.ir_version = IR_VERSION
    onnx.helper.set_model_props(model, {contract.METADATA_KEY: contract.to_json()})
    axes = model.graph.output[0].type.tensor_type.shape.dim[1:]
    for axis, length in zip(axes, size, strict=False):
        axis.dim_value = length
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def export_translator(network: nn.Module, contract: TranslatorContract, path: Path) -> None:
    """Write a network (N, H, W, 3) uint8 -> the same; ContractError if torch differs."""
    pictures = np.random.default_rng(0).integers(0, 256, (3, *contract.image.shape), dtype=np.uint8)
    example = {"image": torch.from_numpy(pictures)}
    with atomically(path) as temporary:
        write_onnx(network, example, "translation", contract, temporary, contract.image.shape)
        check_translator(network, OnnxTranslator(temporary), pictures)


@torch.no_grad()
def check_translator(network: nn.Module, exported: OnnxTranslator, pictures: np.ndarray) -> None:
    """ContractError unless torch and ONNX make the same of pictures, to a grey level."""
    ours = network(torch.from_numpy(pictures)).numpy().astype(int)
    theirs = np.concatenate([exported(part) for part in (pictures[:1], pictures[1:])])
    expect_alike(exported.path, ours, theirs, GREY_TOLERANCE)


def collect_observations(
    network: GreedyNetwork, env: VecEnv, count: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """``count`` observations from driving with some random actions: {input name: (count, ...)}."""
    observation = env.reset()
    batches = []
    for _ in range(-(-count // env.num_envs)):
        batches.append({n: np.array(part) for n, part in parts_of(observation).items()})
        chosen = network.actions(observation)  # type: ignore[arg-type]
        drawn = rng.integers(int(env.action_space.n), size=env.num_envs)  # type: ignore[attr-defined]
        observation, *_ = env.step(np.where(rng.random(env.num_envs) < RANDOM_SHARE, drawn, chosen))
    return {name: np.concatenate([b[name] for b in batches])[:count] for name in batches[0]}


def noise_seen(contract: PolicyContract, count: int) -> dict[str, np.ndarray]:
    """Observations to compare by; of noise, which shows every difference."""
    rng = np.random.default_rng(0)
    shape = (count, *contract.picture_shape)
    seen: dict[str, np.ndarray] = {"image": rng.integers(0, 256, shape, dtype=np.uint8)}
    if contract.told:
        seen["path"] = rng.uniform(-1.0, 1.0, (count, contract.told)).astype(np.float32)
    return seen


def run_onnx(path: Path, observations: dict[str, np.ndarray]) -> np.ndarray:
    """Values (N, actions) of an exported policy."""
    session = InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return np.asarray(session.run(["values"], observations)[0])


def check_equal(network: nn.Module, path: Path, observations: dict[str, np.ndarray]) -> float:
    """The largest difference between torch and ONNX; ContractError if it is beyond `TOLERANCE`."""
    with torch.no_grad():
        seen = [observations[name] for name in ("image", "path") if name in observations]
        ours = network(*map(torch.from_numpy, seen))
    return expect_alike(path, ours.numpy(), run_onnx(path, observations), TOLERANCE)


def expect_alike(path: Path, ours: np.ndarray, theirs: np.ndarray, tolerance: float) -> float:
    """How far answers of torch and ONNX differ at most; ContractError if that is too much."""
    difference = float(np.abs(ours - theirs).max())
    if not difference <= tolerance:
        raise ContractError(
            f"{path}: expected torch and ONNX to agree within {tolerance:g}, they differ by "
            f"{difference:.2g}"
        )
    return difference


def quantise(path: Path, calibration: dict[str, np.ndarray], out: Path) -> None:
    """Write an INT8 version (quantise-dequantise nodes), calibrated on these observations.

    Only the convolutions and the layer after them are quantised: that is where the work is, while
    in the last layers it would cost several percent of the choices.
    """
    starts = range(0, len(calibration["image"]), CALIBRATED_AT_ONCE)
    batches = ({n: p[k : k + CALIBRATED_AT_ONCE] for n, p in calibration.items()} for k in starts)
    reader = SimpleNamespace(get_next=lambda: next(batches, None))
    with atomically(out) as temporary:
        file = str(temporary)
        quant_pre_process(str(path), file, skip_optimization=True, skip_symbolic_shape=True)
        nodes = onnx.load(file).graph.node
        flat = {name for node in nodes if node.op_type == "Flatten" for name in node.output}
        heavy = [n.name for n in nodes if n.op_type == "Conv" or flat.intersection(n.input)]
        types = {"activation_type": QuantType.QUInt8, "weight_type": QuantType.QInt8}
        how = {"per_channel": True, "nodes_to_quantize": heavy, **types}
        quantize_static(file, file, reader, **how)
        model = onnx.load(file)
        model.ir_version = IR_VERSION
        onnx.save(model, file)
