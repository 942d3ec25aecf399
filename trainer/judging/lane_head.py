"""A second output for a trained policy: where in its lane the robot stands.

The policy's convolutions stay as they are; a linear layer on top of them (ridge regression: a
hidden layer learned some thousand frames by heart) reads offset and heading, learned from simulated
pictures, whose poses are known. It says how much of the lane's geometry a policy
sees, and gives people a number to look at beside its choices. It is a file of its own, so that the
policy's file keeps its contract.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper, numpy_helper
from tqdm import tqdm

from robot.contract import ImageSpec
from robot.inference.network_file import Tensor, open_network
from robot.inference.policy_file import read_contract
from robot.inference.preprocess import preprocess_batch
from robot.navigation.road_map import RoadMap
from sim_pybullet.lane_pose import lane_pose
from sim_pybullet.pool import LookPool, Looks
from trainer.judging.explain import convolution_outputs
from trainer.run import atomically
from trainer.translation.collect import snapshots

REMEDY = "make it again with python -m trainer experiment real-photographs"
_RIDGE = 0.4  # of the number of frames
_LARGEST = 4.0  # standard deviations of a feature: photographs show what no simulator does
_AT_ONCE = 256


class LanePoseHead:
    """Opens what `teach_lane_pose` wrote.

    Raises:
        ContractError: not such a file.
    """

    def __init__(self, path: Path, image: ImageSpec) -> None:
        inputs = [Tensor("image", "tensor(uint8)", (None, *image.shape))]
        outputs = [Tensor("lane_pose", "tensor(float)", (None, 2))]
        self._session = open_network(path, inputs, outputs, 1, REMEDY)

    def __call__(self, images: np.ndarray) -> np.ndarray:
        """(N, H, W, 3) uint8 -> (N, 2): offset [m] and heading [rad], positive to the left."""
        return np.asarray(self._session.run(["lane_pose"], {"image": images})[0])


def lane_samples(
    road_maps: Sequence[RoadMap], looks: Looks, count: int, image: ImageSpec, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pictures (N, H, W, 3) uint8 and lane poses (N, 2) [m, rad]; N is a little below ``count``.

    Robots on junctions are left out (there, a place belongs to several lanes), and so are those
    that head against their lane.
    """
    rng = np.random.default_rng(seed)
    pool = LookPool(road_maps, looks, rng, max(2, 48 // len(road_maps)))
    images, poses = [], []
    for _ in tqdm(range(0, count, _AT_ONCE), unit="batch", dynamic_ncols=True, leave=False):
        seen = snapshots(road_maps, pool, _AT_ONCE, rng)
        pictures = preprocess_batch(seen.frames, image)
        for picture, pose, chosen in zip(pictures, seen.poses, seen.road_maps, strict=True):
            here = lane_pose(road_maps[chosen], *pose.tolist())
            if here is None or here.dot_dir < 0.5:
                continue
            tile = road_maps[chosen].tiles[here.lane.tile_row][here.lane.tile_column]
            if "way" not in tile.kind:
                images.append(picture)
                poses.append((here.distance_m, here.angle_rad))
    return np.stack(images), np.array(poses, np.float32)


def teach_lane_pose(policy: Path, images: np.ndarray, poses: np.ndarray, out: Path) -> LanePoseHead:
    """Learn offset and heading from what a policy's convolutions make of its pictures.

    Args:
        policy: an ONNX policy; stays as it is.
        images: (N, H, W, 3) uint8, as the policy sees them.
        poses: (N, 2) offset [m] and heading [rad].
        out: ONNX file to write: image -> lane_pose (N, 2).

    Raises:
        ContractError: not a policy of ours.
    """
    contract = read_contract(policy)
    trunk = _trunk(policy)
    seen = _features(trunk, images)
    mean, deviation = seen.mean(0), seen.std(0) + 1e-3
    even = ((seen - mean) / deviation).clip(-_LARGEST, _LARGEST).astype(np.float64)
    middle = poses.mean(0)
    ridge = _RIDGE * len(even) * np.eye(even.shape[1])
    weights = np.linalg.solve(even.T @ even + ridge, even.T @ (poses - middle))
    values = {
        "pose_mean": mean,
        "pose_deviation": deviation,
        "pose_lowest": np.array(-_LARGEST),
        "pose_highest": np.array(_LARGEST),
        "pose_weights": weights,
        "pose_middle": middle,
    }
    _append(trunk, values)
    with atomically(out) as temporary:
        onnx.save(trunk, str(temporary))
    return LanePoseHead(out, contract.image)


def _trunk(policy: Path) -> onnx.ModelProto:
    """From the picture to the last convolution's rectified output, flat."""
    model = onnx.load(policy)
    last = convolution_outputs(model.graph)[-1]
    model.graph.output.append(onnx.ValueInfoProto(name=last))
    needed = {last}
    kept = []
    for node in reversed(model.graph.node):
        if needed & set(node.output):
            kept.append(node)
            needed |= set(node.input)
    flat = helper.make_node("Flatten", [last], ["pose_features"], axis=1)
    graph = helper.make_graph(
        [*reversed(kept), flat],
        "lane_pose",
        [each for each in model.graph.input if each.name == "image"],
        [helper.make_tensor_value_info("pose_features", TensorProto.FLOAT, ["N", None])],
        [each for each in model.graph.initializer if each.name in needed],
    )
    trunk = helper.make_model(graph, opset_imports=model.opset_import)
    trunk.ir_version = model.ir_version
    return trunk


def _features(trunk: onnx.ModelProto, images: np.ndarray) -> np.ndarray:
    session = onnxruntime.InferenceSession(
        trunk.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    parts = np.array_split(images, max(1, len(images) // _AT_ONCE))
    return np.concatenate([session.run(None, {"image": part})[0] for part in parts])


def _append(trunk: onnx.ModelProto, weights: dict[str, np.ndarray]) -> None:
    for name, values in weights.items():
        tensor = numpy_helper.from_array(np.asarray(values, np.float32), name)
        trunk.graph.initializer.append(tensor)
    nodes = (
        ("Sub", ["pose_features", "pose_mean"], "pose_centred"),
        ("Div", ["pose_centred", "pose_deviation"], "pose_even"),
        ("Clip", ["pose_even", "pose_lowest", "pose_highest"], "pose_cut"),
        ("Gemm", ["pose_cut", "pose_weights", "pose_middle"], "lane_pose"),
    )
    for kind, given, made in nodes:
        trunk.graph.node.append(helper.make_node(kind, given, [made]))
    del trunk.graph.output[:]
    output = helper.make_tensor_value_info("lane_pose", TensorProto.FLOAT, ["N", 2])
    trunk.graph.output.append(output)
    onnx.checker.check_model(trunk)
