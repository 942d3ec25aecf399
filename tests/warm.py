"""``python -m tests.warm``: compile the cameras' loops once.

Processes of a test run that begin at the same time would each compile them.
"""

import numpy as np

from robot.contract import ImageSpec
from robot.navigation.road_map import load_map
from sim_pybullet.batch import BatchWorld
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.navigation import Navigation


def main() -> None:
    """numba keeps what it compiles beside the code."""
    task = Navigation([load_map("town")], 4)
    world = BatchWorld(task, load_look_sampler("randomised"), ImageSpec(80, 60, 20), pool_size=1)
    world.reset()
    world.step(np.zeros(4, dtype=int))
    world.close()


if __name__ == "__main__":
    main()
