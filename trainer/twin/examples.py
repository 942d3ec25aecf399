"""What a person did in a recording, as pictures with an action for each."""

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from robot.contract import DRIVE, ActionTable, PolicyContract
from robot.errors import PlanError
from robot.geometry import Pose, WheelSpeeds
from robot.inference.policy import AT_REST
from robot.inference.preprocess import preprocess
from robot.navigation.path import Path, path_input
from robot.navigation.planner import LaneGraph, plan_path
from robot.recording.topics import Turn
from sim_pybullet.motors import EXPERT_AHEAD_M, pursuit
from trainer.twin.recorded import Recorded

HELD_OUT = 0.3  # of each drive, its last part
MOVES_MPS = 0.05
CLEAR_PM = 2.5  # curvature from which on somebody steers, not only drives on
TAKEOVER_S, TAKEOVER_WEIGHT = 3.0, 4.0  # after a person took the wheel from the policy
AHEAD_M, DETOUR = 0.6, 1.5  # beyond what a path input tells; how much longer the way may be


class Examples(NamedTuple):
    """Pictures, what the policy is told beside them, and what the person did."""

    images: np.ndarray  # (N, H, W, 3)
    paths: np.ndarray | None  # (N, told), see `robot.contract.PolicyContract`
    shares: np.ndarray  # (N, A) float32, of the policy's actions: right may lie between two
    weights: np.ndarray  # (N,)
    bends_pm: np.ndarray  # (N,) curvature that the person steered

    @property
    def observed(self) -> dict[str, np.ndarray]:
        """What a policy takes."""
        return {"image": self.images} | ({} if self.paths is None else {"path": self.paths})


def examples_of(
    drives: Sequence[Recorded],
    places: Sequence[np.ndarray | None],
    contract: PolicyContract,
    held_out: bool,
) -> Examples:
    """The moments that a person drove and the policy could have, of one part of each drive.

    ``places`` (F, 3), with a map: where the robot was at each drive's pictures. Right is what the
    expert would do from there on the way that was driven: a person weaves, and is late. Where they
    took over from the policy, or there is no map, they knew better: often between two actions.
    Of last commands none are told: people go on as they did, and who learned that would repeat it.
    """
    rows, bends_pm = [], _bends(contract.actions)
    for drive, poses in zip(drives, places, strict=True):
        last_s = (1.0 - HELD_OUT) * drive.times_s[-1]
        ways = ways_driven(drive) if drive.map_name else [None] * len(drive.turns)
        for k, taken_s in enumerate(_since_takeover(drive.turns)):
            way, steered_pm = ways[k], _bend(drive.turns[k].wheels)
            told = drive.turns[k].path if drive.turns[k].path is not None else way and way.told
            if taken_s is None or steered_pm is None or held_out != (drive.times_s[k] > last_s):
                continue
            if told is None and contract.path_points:
                continue
            corrected = taken_s < TAKEOVER_S
            right_pm = steered_pm
            if way is not None and poses is not None and not corrected:
                arc_m = way.path.project(*poses[k, :2].tolist()).arc_m + EXPERT_AHEAD_M
                best_pm = pursuit(way.path.batch, poses[k, None], np.array([arc_m]))
                right_pm = bends_pm[np.abs(bends_pm - best_pm).argmin()]
            weight = TAKEOVER_WEIGHT if corrected else 1.0
            way_told = (told or ())[: contract.path_points]
            beside = (*way_told, *AT_REST[: 2 * contract.commands])
            image = preprocess(drive.images[k], contract.image)
            rows.append((image, beside, right_pm, weight, steered_pm))
    images, paths, right, weights, steered = zip(*rows, strict=True) if rows else ((),) * 5
    return Examples(
        np.array(images, np.uint8).reshape(-1, *contract.image.shape),
        np.array(paths, np.float32).reshape(-1, contract.told) if contract.told else None,
        shares_of(np.array(right), contract.actions),
        np.array(weights),
        np.array(steered),
    )


class Way(NamedTuple):
    """The way that was driven next."""

    path: Path
    told: list[float]  # what a navigator would have been told of it


def ways_driven(drive: Recorded) -> list[Way | None]:
    """The way that was driven next, at each picture.

    A person who drives has no mission, so the lanes between the place where the robot believed to
    be and that where it came are asked of the map. None where no such way leads there.
    """
    told = drive.fused if len(drive.fused) else drive.overhead
    times_s, poses = told[:, 0], np.column_stack((told[:, 1:3], np.unwrap(told[:, 3])))
    gone_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
    graph, found = LaneGraph(drive.road_map), list[Way | None]()
    for time_s in drive.times_s:
        here = Pose(*(float(np.interp(time_s, times_s, part)) for part in poses.T))
        then = int(np.searchsorted(gone_m, np.interp(time_s, times_s, gone_m) + AHEAD_M))
        way = None
        if then < len(poses):
            with suppress(PlanError):
                path = plan_path(graph, here, (poses[then, 0], poses[then, 1]))
                if path.length_m < DETOUR * AHEAD_M:
                    way = Way(path, path_input(path, here).tolist())
        found.append(way)
    return found


def foretold(actions: np.ndarray, seen: Examples, contract: PolicyContract) -> tuple[int, int]:
    """In how many moments a policy steers to the person's side, of so many of clear steering."""
    ours, clear = _bends(contract.actions), np.abs(seen.bends_pm) > CLEAR_PM
    same = np.sign(ours[actions[clear]]) == np.sign(seen.bends_pm[clear])
    return int(same.sum()), int(clear.sum())


def shares_of(right_pm: np.ndarray, actions: ActionTable) -> np.ndarray:
    """(N, A) of the two actions beside each curvature (N,), so that their mean is it."""
    bends_pm = _bends(actions)
    order = np.argsort(bends_pm)
    each = [np.interp(right_pm, bends_pm[order], one) for one in np.eye(len(bends_pm))[:, order]]
    return np.array(each, np.float32).T


def _bends(actions: ActionTable) -> np.ndarray:
    return np.array([_bend(wheels) or 0.0 for wheels in actions])


def _bend(wheels: Sequence[float]) -> float | None:
    """Curvature [1/m] of rim speeds; None where they stand."""
    forward_mps, turn_radps = DRIVE.twist(WheelSpeeds(*wheels))
    return turn_radps / forward_mps if forward_mps >= MOVES_MPS else None


def _since_takeover(turns: Sequence[Turn]) -> list[float | None]:
    """For how long a person has driven [s], since they took over from the policy; None: nobody."""
    found: list[float | None] = []
    began_s, before = -np.inf, ""
    for turn in turns:
        if turn.state == "MANUAL" and before == "AUTO":
            began_s = turn.time_s
        found.append(turn.time_s - began_s if turn.state == "MANUAL" else None)
        before = turn.state or before  # people mark bad what made them take over
    return found
