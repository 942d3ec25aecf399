"""A task of one's own in one file: keep right, 3 cm beside the middle of the lane.

    python examples/own_task.py train --task keep_right --algo ppo --out runs/keep_right
    python examples/own_task.py evaluate --model runs/keep_right/model.onnx --episodes 20
    python examples/own_task.py export runs/keep_right
    python examples/own_task.py report runs/keep_right

The file registers its task and is the trainer's command line besides. It changes the reward; a task
may as well choose its paths (`Task._mission`), its ends (`step`), its vehicle, and whether its
policies are shown a path. See `sim_pybullet/tasks/`, where the project's own lie.
"""

import sys

import numpy as np

from sim_pybullet.tasks.following import following_terms
from sim_pybullet.tasks.lane_keeping import LaneKeeping
from sim_pybullet.tasks.spec import TaskSpec, TaskStep, register
from trainer.cli import main

RIGHT_M = 0.03  # of the middle of the lane


class KeepRight(LaneKeeping):
    """Lane keeping whose best place is beside the middle."""

    def step(self, poses: np.ndarray, collided: np.ndarray) -> TaskStep:
        """Reward and end of the decision that led to poses (N, 3): as of lane keeping, shifted."""
        judged = super().step(poses, collided)
        beside = self.course._replace(offset_m=self.course.offset_m + RIGHT_M)
        return judged._replace(terms=following_terms(beside, self.half_lane_m))


KEEP_RIGHT = register(
    TaskSpec(
        name="keep_right",
        title="Keep right",
        purpose="Keeps right in its lane, by its picture alone.",
        kind=KeepRight,
        map="loop",
        presets={"fast": {"steps": 20_000, "evaluation": {"episodes": 10}}},
        environments={"KeepRight-v0": {}},
    )
)

if __name__ == "__main__":
    sys.exit(main())
