"""``Bench``: the town, and robot, localizer and monitor as processes of their own."""

import os
import re
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np

from robot.config import CameraConfig, RecordingConfig, RobotConfig
from robot.hat.config import HatConfig
from robot.link.keys import ALLOWED, BOUND_BY, PUBLIC, keygen
from robot.link.sockets import LinkConfig, OtherRobot
from robot.navigation.road_map import load_map
from robot.output import write_yaml
from robot.safety.governors import Rules
from sim_pybullet.look import NOMINAL, Look
from tools.loop.operator import Operator
from tools.loop.process import END_S, Process
from tools.loop.proxy import Proxy
from tools.loop.timekeeper import BenchError, Conductor, Timekeeper
from tools.loop.town import CAMERA_FPS, OVERHEAD_FPS, VirtualTown

START_S = 30.0  # until all have heard of each other
FRESH_S = 0.5  # an age of signs of life
LOOK_S = 0.2  # between two looks at the page of the second robot
PAUSE_S = 0.02  # real time for connections, while none is there yet
PROGRAMS = {
    "localizer": "localizer_node run --calibration {folder}/arena.yaml --fps {fps} "
    "--source socket:{overhead} --link {folder}/localizer.yaml",
    "robot": "robot drive --config {folder}/{name}.yaml",
    "monitor": "tools.monitor --port {port} --map {map} --link {folder}/{name}.yaml "
    "--drives {folder}/drives",
}
OF_SECOND = ("robot2", "monitor2")  # which a second robot needs


@dataclass(frozen=True)
class BenchOptions:
    """What is benched."""

    model: Path
    map: str = "arena"
    look: Look = NOMINAL
    seed: int = 0
    lockstep: bool = True
    robot_python: str = sys.executable
    record: bool = False  # the robot's drives
    recordings: Path | None = None  # where; else in the bench's folder
    sight: Path | None = None  # by which the robot knows where it is, too
    localizer: bool = True  # else it is never started
    page: tuple[str, ...] = ()  # options of the monitor
    among: bool = False  # with a second robot and room for a duck: each keeps its distance
    leader: Path | None = None  # the second's model where the first one's keeps its lane, by sight


class Bench:
    """Use it in a ``with`` block: entering starts everything and logs in to the monitor."""

    def __init__(self, options: BenchOptions, folder: Path) -> None:
        self.options, self.folder = options, folder
        folder.mkdir(exist_ok=True)
        self.road_map = load_map(options.map)
        self.time: Timekeeper = (
            Conductor(folder, (*PROGRAMS, *OF_SECOND)) if options.lockstep else Timekeeper()
        )
        first = [name for name in PROGRAMS if options.localizer or name != "localizer"]
        self.programs = (*first, *(OF_SECOND if options.among else ()))
        scene = self.road_map, options.look, self.time, folder, options.seed
        self.town = VirtualTown(*scene, options.among)
        self.keys = keygen(folder / "keys")
        if options.among:
            self.keys.update(keygen_of_second(folder / "keys2", self.keys))
        self._page_ports = {"monitor": free_ports(1), "monitor2": free_ports(1)}
        self.link_configs, self.networks = connect(self.keys, self.time, options.seed)
        if options.among and not options.localizer:  # they hear each other
            links = self.link_configs
            for name, other in (("robot", "robot2"), ("robot2", "robot")):
                heard = OtherRobot(other, "127.0.0.1", links[other].base_port)
                links[name] = replace(links[name], robots=(heard,))
        self.processes: dict[str, Process] = {}
        self.recordings = options.recordings or folder / "recordings"
        self.operator: Operator
        self.second: Operator  # at the page of the second robot
        write_yaml(folder / "arena.yaml", self.town.calibration)
        self.use_model(options.model)

    def __enter__(self) -> "Bench":
        with ExitStack() as stack:
            stack.callback(self.close)
            if not self.options.lockstep:
                self.town.world.see()  # the first picture takes seconds, the next ones do not
                self.town.see_above()
                self.time.start()
            for name in self.programs:
                self.start(name)
            self.operator = self.log_in()
            if self.options.among:
                self.second = self.log_in("monitor2")
                self.time.every(LOOK_S, self.second.look)
            self.meet()
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def now_s(self) -> float:
        """The bench's time [s]."""
        return self.time.clock.now()

    @property
    def page_lives(self) -> bool:
        """Whether the monitor's page can be looked at."""
        monitor = self.processes["monitor"]
        return not (self.operator.closed or monitor.frozen or monitor.ending)

    def freeze(self, name: str, frozen: bool = True) -> None:
        """Stop a program where it is, or let it go on."""
        self.time.freeze(name, frozen)
        self.processes[name].child.send_signal(signal.SIGSTOP if frozen else signal.SIGCONT)
        self.processes[name].frozen = frozen
        cameras = {"robot": self.town.camera, "localizer": self.town.overhead}
        if name in cameras:  # nobody would read its pictures
            cameras[name].silent = frozen

    def end(self, name: str, how: str = "SIGKILL") -> None:
        """End a program by a signal; it may take its time."""
        self.processes[name].child.send_signal(signal.Signals[how])
        self.processes[name].ending = True

    def stop(self, name: str) -> None:
        """Kill a program, and wait for its end while time goes on."""
        self.end(name)
        self._wait_for_ends()

    def revive(self) -> None:
        """Let go on what is frozen, start again what has ended, and meet again."""
        for name, process in self.processes.items():
            if process.frozen:
                self.freeze(name, False)
        self._wait_for_ends()
        ended = [name for name, process in self.processes.items() if not process.alive]
        for name in ended:
            self.start(name)
        if "monitor" in ended:
            self.operator = self.log_in()
        if ended:
            self.meet()

    def start(self, name: str) -> Process:
        """Start a program, or start it again."""
        python = self.options.robot_python if name == "robot" else sys.executable
        command = [python, *self.time.prefix(name), *self._program(name)]
        typed = name == "robot" and self.options.leader is not None
        process = Process(name, command, self.folder / f"{name}.log", typed)
        self.processes[name] = process
        self.time.joined(name, lambda: process.alive)
        return process

    def type(self, word: str) -> None:
        """Type a word at the robot's terminal."""
        terminal = self.processes["robot"].child.stdin
        assert terminal is not None
        terminal.write(f"{word}\n".encode())
        self.time.poked("robot")

    def start_in_vain(self) -> None:
        """Kill the robot, start it again where it cannot work, and let it find out."""
        self.stop("robot")
        robot = self.start("robot")
        self.until(lambda: not robot.alive, START_S, "robot to give up", PAUSE_S)

    def log_in(self, name: str = "monitor") -> Operator:
        """Open a monitor's page with the token that it printed."""
        monitor, port = self.processes[name], self._page_ports[name]
        found: list[str] = []

        def printed() -> bool:
            found[:] = re.findall(r"\?token=(\S+)", monitor.said())
            with socket.socket() as probe:
                return bool(found) and not probe.connect_ex(("127.0.0.1", port))

        self.until(printed, START_S, "the monitor's page", PAUSE_S)
        return Operator(self.time, port, found[-1], name)

    def meet(self) -> None:
        """Until the robot is told where it is and the page shows it."""

        def met() -> bool:
            for process in self.processes.values():
                if not process.alive:
                    last = process.said().strip().rpartition("\n")[2]
                    raise BenchError(f"{process.name}: expected it to run, it ended: {last}")
            self.operator.look()
            heard = ("operator",) if self.options.sight else ("pose", "operator")
            ages_s = [self.operator.age_s(name) for name in heard]
            poseless = self.options.leader or not self.options.localizer
            knows = self.operator.robot.get("pose") or (poseless and self.operator.robot)
            return bool(knows) and max(ages_s) < FRESH_S

        self.until(met, START_S, "robot, localizer and monitor to hear each other", PAUSE_S)

    def until(
        self, holds: Callable[[], bool], patience_s: float, what: str, pause_s: float = 0.0
    ) -> None:
        """Let time go on until something holds; BenchError: not within ``patience_s`` [s]."""
        deadline_s = self.now_s + patience_s
        while not holds():
            if self.now_s > deadline_s:
                said = {each.name: each.said()[-200:] for each in self.processes.values()}
                raise BenchError(f"expected {what}, waited in vain; the programs said {said}")
            self.time.run_until(self.now_s + 0.05)
            time.sleep(pause_s)

    def close(self) -> None:
        """End all processes."""
        for process in self.processes.values():
            process.end()
        for network in self.networks.values():
            network.close()
        self.time.end()
        self.town.close()

    def _wait_for_ends(self) -> None:
        ending = [process for process in self.processes.values() if process.ending]
        names = ", ".join(process.name for process in ending)
        self.until(lambda: not any(p.alive for p in ending), END_S, f"{names} to end", PAUSE_S)

    def _program(self, name: str) -> list[str]:
        places = {"folder": self.folder, "overhead": self.town.overhead.path, "fps": OVERHEAD_FPS}
        places |= {"port": self._page_ports.get(name, 0), "map": self.options.map, "name": name}
        words = [word.format(**places) for word in PROGRAMS[name.rstrip("2")].split()]
        return [*words, *self.options.page] if name == "monitor" else words

    def use_model(self, model: Path) -> None:
        """The policy that the robot is started with from now on."""
        recording = RecordingConfig(str(self.recordings), 0.0) if self.options.record else None
        sight = str(self.options.sight.resolve()) if self.options.sight else ""
        leader, among = self.options.leader, self.options.among
        company = among and not self.options.localizer
        robots = {
            robot.marker.robot: RobotConfig(
                str((leader or model if robot is self.town.second else model).resolve()),
                name=robot.marker.robot,
                map="" if leader and robot is self.town else self.options.map,
                sight="" if leader and robot is not self.town else sight,
                camera=CameraConfig("socket", path=str(robot.camera.path), fps=CAMERA_FPS),
                hat=HatConfig(socket=str(robot.bus_server.path)),
                rules=Rules(company, among, company),
                link=self.link_configs[robot.marker.robot],
                recording=recording if robot is self.town else None,
            )
            for robot in filter(None, (self.town, self.town.second))
        }
        for name, config in {**self.link_configs, **robots}.items():
            write_yaml(self.folder / f"{name}.yaml", config)


def connect(
    keys: dict[str, Path], time: Timekeeper, seed: int
) -> tuple[dict[str, LinkConfig], dict[str, Proxy]]:
    """Each program's links, through the networks ``poses`` (localizer to robot) and ``monitor``.

    Those of a second robot end with a 2.
    """
    ports = {name: free_ports(len(BOUND_BY)) for name in keys}
    configs = {name: LinkConfig(str(keys[name]), base_port=ports[name]) for name in keys}
    rng, now = np.random.default_rng(seed), time.clock.now
    networks = {}
    for of in ("", "2") if "robot2" in keys else ("",):
        robot, monitor, localizer = ports[f"robot{of}"], ports[f"monitor{of}"], ports["localizer"]
        to_monitor = {monitor: localizer}
        to_monitor |= {monitor + i: robot + i for i in range(1, len(BOUND_BY))}
        networks[f"poses{of}"] = Proxy({robot: localizer}, now, rng)
        networks[f"monitor{of}"] = Proxy(to_monitor, now, rng)
    return configs, networks


def keygen_of_second(folder: Path, first: dict[str, Path]) -> dict[str, Path]:
    """Keys for a second robot and its monitor, whom the localizer and ``first`` let in."""
    made = keygen(folder, ("robot", "monitor"))
    for role, its in made.items():
        shutil.copy(first["localizer"] / PUBLIC, its / ALLOWED / "localizer.key")
        shutil.copy(its / PUBLIC, first["localizer"] / ALLOWED / f"{role}2.key")
    shutil.copy(first["robot"] / PUBLIC, made["robot"] / ALLOWED / "robot.key")
    shutil.copy(made["robot"] / PUBLIC, first["robot"] / ALLOWED / "robot2.key")
    return {f"{role}2": its for role, its in made.items()}


_PORTS, _asked = range(10_000, 32_000, 8), count()  # a computer gives connections higher ones


def free_ports(number: int) -> int:
    """The first of ``number`` free ports in a row, 8 at most; OSError when none are found."""
    for _ in range(100):
        base = _PORTS[(97 * os.getpid() + next(_asked)) % len(_PORTS)]
        with ExitStack() as stack, suppress(OSError):
            for offset in range(number):
                stack.enter_context(socket.socket()).bind(("127.0.0.1", base + offset))
            return base
    raise OSError(f"expected {number} free ports in a row, found none")
