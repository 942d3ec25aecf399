"""A demonstration robot in a thread, for tests that need somebody to monitor."""

import threading
import time

from robot.link.sockets import LinkConfig
from robot.navigation.road_map import load_map
from tests.tools.demo_robot import DemoRobot


class RobotThread:
    """Drives the loop map until closed; its links belong to its thread."""

    def __init__(self, configs: dict[str, LinkConfig]) -> None:
        self._configs = configs
        self._closing = threading.Event()
        self._ready = threading.Event()
        self.robot: DemoRobot
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(10.0)

    def __enter__(self) -> "RobotThread":
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        self.robot = DemoRobot(load_map("loop"), self._configs)
        self._ready.set()
        while not self._closing.is_set():
            self.robot.turn()
            time.sleep(0.1)
        self.robot.close()
