"""The parts of the bench, one by one."""

from __future__ import annotations

import errno
import itertools
import math
import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.client import ClientProtocol
from websockets.protocol import State
from websockets.uri import parse_uri

from robot.camera.source import SocketStream
from robot.computer.clock import MonotonicClock
from robot.contract import Stick
from robot.errors import ContractError, HardwareError, PlanError
from robot.geometry import Pose, WheelSpeeds
from robot.hat.bus import SocketBus
from robot.hat.config import HatConfig
from robot.hat.thread import real_motors
from robot.inference.policy import OnnxPolicy
from robot.link.messages import Telemetry
from robot.link.sockets import Publisher, Subscriber
from robot.navigation.path import Path as LanePath
from robot.navigation.road_map import load_map
from sim_pybullet.overhead import OVERHEAD_LENS
from sim_pybullet.virtual.hat import VirtualHat
from sim_pybullet.virtual.i2c import BusFault, VirtualI2cBus
from tests.sim_pybullet.lane_pose import lane_pose
from tests.tools.pursuit import write_pursuit
from tools.loop import in_step
from tools.loop.bench import Bench, free_ports
from tools.loop.devices import BusServer, Listener, PictureServer
from tools.loop.drive import aim, whim
from tools.loop.missions import Driver, MissionRecord, distance_m
from tools.loop.operator import Operator
from tools.loop.process import Process
from tools.loop.proxy import Proxy
from tools.loop.shared_time import SharedTime
from tools.loop.town import _over


@contextmanager
def served(server: Listener) -> Iterator[None]:
    """The hardware answers in a thread, as in real time."""
    ending = threading.Event()

    def run() -> None:
        while not ending.is_set():
            server.serve()
            time.sleep(0.001)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()
        server.close()


def test_a_bus_behind_a_socket_is_the_bus_with_its_errors(tmp_path: Path) -> None:
    bus = VirtualI2cBus()
    VirtualHat(bus, MonotonicClock())
    transactions = []
    server = BusServer(tmp_path / "i2c", bus, lambda: transactions.append(1))
    with served(server), closing(SocketBus(str(server.path))) as there:
        assert there.read(0x6F, 0x00, 1) == bus.read(0x6F, 0x00, 1)
        there.write(0x6F, b"\xfd\x10")
        with pytest.raises(OSError, match="I/O error") as nobody:
            there.write(0x33, b"\x00\x00")
        assert nobody.value.errno == errno.EREMOTEIO
        bus.inject(BusFault.STUCK)
        with pytest.raises(OSError, match="timed out"):
            there.read(0x6F, 0x00, 1)
    assert len(transactions) == 4


def test_the_motors_of_a_configuration_are_found_behind_a_socket(tmp_path: Path) -> None:
    bus = VirtualI2cBus()
    hat = VirtualHat(bus, MonotonicClock())
    server = BusServer(tmp_path / "i2c", bus, lambda: None)
    with served(server), real_motors(HatConfig(socket=str(server.path))) as motors:
        assert not hat.chip.asleep
        assert motors.healthy
        second = real_motors(HatConfig(socket=str(server.path)))
        with pytest.raises(HardwareError, match="the only program that drives, another"):
            second.__enter__()
        assert motors.healthy, "and it drives on"
    nobody = real_motors(HatConfig(socket=str(tmp_path / "none")))
    with pytest.raises(HardwareError, match="expected a virtual I2C bus"):
        nobody.__enter__()


def test_a_camera_behind_a_socket_answers_at_its_own_moments(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8)
    server = PictureServer(tmp_path / "camera", lambda: picture, lambda: None)
    stream = SocketStream(str(server.path), (160, 120))
    got: list[np.ndarray] = []
    thread = threading.Thread(target=lambda: got.append(stream.grab()))
    thread.start()
    while thread.is_alive():
        server.moment()
        time.sleep(0.001)
    assert np.array_equal(got[0], picture)
    stream.close()
    server.close()


@pytest.mark.parametrize("fault", ["size", "garbage"])
def test_a_picture_of_another_kind_is_refused(tmp_path: Path, fault: str) -> None:
    rows = 60 if fault == "size" else 120
    server = PictureServer(
        tmp_path / "camera", lambda: np.zeros((rows, 160, 3), np.uint8), lambda: None
    )
    if fault == "garbage":
        server.magic = b"RGB9"
    stream = SocketStream(str(server.path), (160, 120))
    refused: list[str] = []

    def grab() -> None:
        with pytest.raises(ContractError if fault == "size" else HardwareError) as error:
            stream.grab()
        refused.append(str(error.value))

    thread = threading.Thread(target=grab)
    thread.start()
    while thread.is_alive():
        server.moment()
        time.sleep(0.001)
    stream.close()
    server.close()
    assert "expected 160 x 120 px" in refused[0]


def test_ports_are_free_apart_and_none_that_a_connection_may_take_by_itself() -> None:
    """A page's was taken so, between its choice and its start."""
    given = [free_ports(5) for _ in range(50)]
    assert len(set(given)) == 50
    assert min(abs(a - b) for a, b in pairwise(sorted(given))) >= 5
    assert min(given) >= 1_024
    assert max(given) + 5 <= 32_768
    for base in given[:3]:
        for port in range(base, base + 5):
            socket.create_server(("127.0.0.1", port)).close()


def test_ports_that_somebody_has_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.loop.bench._asked", count(7))
    first = free_ports(3)
    monkeypatch.setattr("tools.loop.bench._asked", count(7))
    with socket.create_server(("127.0.0.1", first + 2)):
        assert free_ports(3) != first, "as one of them is taken"


def test_a_network_delays_keeps_the_order_and_can_be_cut() -> None:
    near, far = free_ports(1), free_ports(1)
    with socket.create_server(("127.0.0.1", far)) as listener:
        proxy = Proxy({near: far}, time.monotonic, np.random.default_rng(0))
        with closing(proxy), socket.create_connection(("127.0.0.1", near)) as one:
            other = listener.accept()[0]
            with other:
                proxy.delay_s = 0.1
                began_s = time.monotonic()
                one.sendall(b"first")
                proxy.delay_s = 0.0
                other.settimeout(5.0)
                assert other.recv(5, socket.MSG_WAITALL) == b"first"
                assert time.monotonic() - began_s < 5.0
                proxy.cut = True
                assert other.recv(1) == b"", "hung up"


@pytest.mark.parametrize("name", ["arena", "town", "loop"])
def test_the_overhead_camera_sees_the_whole_road(name: str) -> None:
    road_map = load_map(name)
    hanging = _over(road_map.width_m, road_map.height_m)
    points_m = np.concatenate([lane.control_points_m[[0, 3]] for lane in road_map.lanes])
    rays = np.column_stack((points_m, np.zeros(len(points_m)))) - hanging.position_m
    pixels = OVERHEAD_LENS.project(rays @ hanging.rotation)
    assert (pixels > 20).all()
    assert (pixels < np.array([1280, 720]) - 20).all()


def test_moments_and_counts_are_shared(tmp_path: Path) -> None:
    one = SharedTime(tmp_path / "time", create=True)
    other = SharedTime(tmp_path / "time")
    one.set("now", 12.5)
    one.add("pose")
    one.add("pose")
    assert (other.get("now"), other.get("pose"), other.get("ack")) == (12.5, 2.0, 0.0)


def test_pure_pursuit_turns_to_where_the_path_goes(tmp_path: Path) -> None:
    policy = OnnxPolicy(write_pursuit(tmp_path / "pursuit.onnx"))
    picture = np.full((1, *policy.contract.image.shape), 77, np.uint8)
    angles = np.array([0.9, 0.25, 0.0, -0.25, -0.9], np.float32)
    paths = [np.full((1, 10), angle, np.float32) for angle in angles]
    chosen = [int(policy.values(picture, path).argmax()) for path in paths]
    assert chosen == [0, 1, 2, 3, 4]


@settings(max_examples=20)
@given(st.floats(0.0, 2.6), st.floats(0.0, 3.1))
def test_a_start_is_put_on_the_nearest_lane_or_refused(x_m: float, y_m: float) -> None:
    road_map = load_map("arena")
    bench = SimpleNamespace(road_map=road_map)
    driver = Driver(cast(Bench, bench), np.random.default_rng(0))
    if not road_map.on_road(x_m, y_m):
        with pytest.raises(PlanError, match="expected the start on the road"):
            driver.on_lane(x_m, y_m)
        return
    pose = driver.on_lane(x_m, y_m)
    found = lane_pose(road_map, *pose)
    assert found is not None
    assert abs(found.distance_m) < 1e-3
    assert abs(found.angle_rad) < 0.01


def watching(now_s: float) -> tuple[Driver, Any]:
    """Who sends a robot on missions, and a bench whose turns take a tenth of a second."""
    bench: Any = SimpleNamespace(road_map=load_map("arena"), now_s=now_s)
    bench.town = SimpleNamespace(pose=Pose(0.0, 0.0, 0.0), moved_s=now_s)
    bench.operator = SimpleNamespace(mission={}, robot={}, state="FAULT", reason="frozen")

    def turn() -> None:
        bench.now_s += 0.1

    bench.operator.turn = turn
    return Driver(bench, np.random.default_rng(0)), bench


@pytest.mark.parametrize(("phase", "missed_m", "true"), [
    *[("arrived", 0.149, True), ("arrived", 0.151, False), ("arrived", math.nan, False)],
    *[("stopped", 0.01, False), ("refused", 0.0, False)],
])  # fmt: skip
def test_a_mission_arrived_where_it_ends_within_15_cm(
    phase: str, missed_m: float, true: bool
) -> None:
    record = MissionRecord(Pose(0.0, 0.0, 0.0), (1.0, 0.0), 1.0, phase, missed_m=missed_m)
    assert record.arrived is true


def test_a_mission_is_a_metre_long_at_least() -> None:
    driver, bench = watching(0.0)
    for _ in range(40):
        bench.town.pose = driver.anywhere()
        assert driver._draw(None).length_m >= 1.0


def test_a_report_is_compared_with_where_the_robot_was_when_it_was_sent() -> None:
    driver, bench = watching(1.5)
    bench.operator.robot = {"pose": (0.32, 0.1, math.pi - 0.1), "t_sent_s": 1.1, "sequence": 7}
    turns = (1.0, -math.pi + 0.2), (1.5, math.pi - 0.2)  # across where headings begin again
    driver._truth = [(at_s, Pose(2.0 * (at_s - 1.0), 0.1, rad)) for at_s, rad in turns]
    record = MissionRecord(Pose(0.0, 0.0, 0.0), (1.0, 0.0), 1.0)
    for _ in range(2):  # the same report counts once
        driver._judge(record)
    (error,) = record.errors
    assert error == pytest.approx((0.12, -0.22))


def test_how_fast_a_robot_stopped_is_counted_from_its_report() -> None:
    driver, bench = watching(10.2)
    bench.operator.robot = {"t_sent_s": 10.0}
    stop = driver._standing()
    assert stop.latency_s == pytest.approx(0.2)
    assert (stop.fault, stop.state) == ("frozen", "FAULT")
    assert bench.now_s >= 10.7, "it has stood for half a second"


def test_the_distance_from_a_line() -> None:
    line = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 2.0)]
    for place, wanted_m in (((0.4, 0.3), 0.3), ((1.5, 1.0), 0.5), ((-0.3, 0.4), 0.5), ((1, 2), 0)):
        assert distance_m(line, Pose(*place, 0.0)) == pytest.approx(wanted_m)


def test_a_stick_and_its_wheels_are_the_same_thing() -> None:
    for wheels in ((0.3, 0.3), (0.0576, 0.3024), (-0.2, 0.1)):
        assert Stick.of(WheelSpeeds(*wheels)).wheels == pytest.approx(wheels)
    assert Stick(1.0, 0.6).wheels == pytest.approx((0.0576, 0.3024)), "hard left"
    assert Stick(0.0, 1.0).wheels == pytest.approx((0.3, 0.3)), "straight on"


def test_a_hand_knows_which_way_it_is_on_where_a_path_crosses_itself() -> None:
    corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, -1.0)]
    way = LanePath.from_beziers([np.linspace(a, b, 4) for a, b in itertools.pairwise(corners)])
    hint = 0
    for arc_m in np.arange(0.0, way.length_m, 0.05):
        at = way.pose_at(arc_m)
        beside = Pose(*at.to_world(np.array([0.0, 0.03])), at.heading_rad)
        steered = aim(way, beside, hint=hint)
        hint = steered.hint
        assert way.length_m - steered.left_m == pytest.approx(arc_m, abs=0.06)


def test_a_hand_steers_back_to_its_way_and_slower_in_bends() -> None:
    way = LanePath.from_beziers([np.linspace((0.0, 0.0), (2.0, 0.0), 4)])
    assert aim(way, Pose(0.5, 0.0, 0.0)).stick == pytest.approx((0.0, 1.0))
    right_of_it, left_of_it = (aim(way, Pose(0.5, y_m, 0.0)) for y_m in (-0.05, 0.05))
    assert right_of_it.stick.steer > 0.1
    assert left_of_it.stick.steer == pytest.approx(-right_of_it.stick.steer)
    assert right_of_it.stick.speed < 0.9
    assert right_of_it.left_m == pytest.approx(1.5)
    weaves = aim(way, Pose(0.5, 0.0, 0.0), whims=(0.5, 2.0)).stick
    assert weaves.speed == pytest.approx(0.4), "half of it, and slower in a bend"
    assert weaves.steer / weaves.speed == pytest.approx(2.0 / 8.0), "2 per metre of 8"


def test_a_twins_driver_stands_then_brakes_stops_and_weaves_to_both_sides() -> None:
    times_s = np.arange(0.0, 60.0, 0.1)
    wishes = np.array([whim(t, np.array((0.3, 1.0, 2.0, 4.0))) for t in times_s])
    assert not wishes[times_s < 2.0, 0].any()
    drives = wishes[times_s >= 2.0]
    assert set(drives[:, 0]) == {0.0, 0.57, 0.8, 1.0}
    assert drives[:, 0].mean() > 0.7
    assert drives[:, 1].min() == pytest.approx(-2.2)
    assert drives[:, 1].max() == pytest.approx(2.2)
    assert abs(drives[:, 1].mean()) < 0.3


def test_a_bench_that_ignores_hang_ups_starts_programs_that_do_not(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup leaves it
    try:
        program = Process("sleep", ["sleep", "60"], tmp_path / "log")
        program.child.send_signal(signal.SIGHUP)
        assert program.child.wait(10.0) == -signal.SIGHUP
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.fixture
def ear(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Reads commands of a shared time; of those ``on_the_way`` one comes at each later look."""
    ear = SimpleNamespace(shared=SharedTime(tmp_path / "time", create=True), on_the_way=[])
    there: list[bytes] = []

    class Kind:
        from_bytes = staticmethod(bytes)

    def pause(_: float) -> None:
        there.extend(filter(None, (ear.on_the_way.pop(0),) if ear.on_the_way else ()))

    def read(*_: object) -> list[bytes]:
        found, there[:] = [Kind.from_bytes(data) for data in there], []
        return found

    monkeypatch.setattr(in_step, "_pause", pause)
    monkeypatch.setattr(in_step, "_real", itertools.count().__next__)  # each look lasts a second
    serve = in_step._patient(read, Kind, "command", ear.shared)
    ear.serve, ear.there = lambda: serve(None, None), there
    return ear


def test_on_a_busy_machine_a_message_is_waited_for_as_many_looks(ear: SimpleNamespace) -> None:
    ear.shared.add("command")
    ear.on_the_way = [b""] * 250 + [b"arm"]
    assert ear.serve() == [b"arm"]


def test_after_what_came_late_or_from_a_stranger_the_next_message_is_waited_for(
    ear: SimpleNamespace,
) -> None:
    ear.shared.add("command")
    assert ear.serve() == [], "lost, for all that it knows"
    ear.there += [b"late", b"a stranger's"]
    assert ear.serve() == [b"late", b"a stranger's"]
    ear.shared.add("command")
    ear.on_the_way = [b"", b"stop"]
    assert ear.serve() == [b"stop"]


def test_nobody_waits_where_the_network_may_lose_messages(ear: SimpleNamespace) -> None:
    ear.shared.add("command")
    ear.shared.set("lossy", 1.0)
    ear.on_the_way = [b"", b"arm"]
    assert ear.serve() == []


def test_a_link_is_deaf_by_both_clocks_for_a_slow_machine_is_no_silence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real_s, again = [5000.0], list[str]()
    for of, name in ((Subscriber, "__init__"), (Subscriber, "receive"), (Publisher, "send")):
        monkeypatch.setattr(of, name, getattr(of, name))  # as it is afterwards
    monkeypatch.setattr(in_step, "_real", lambda: real_s[0])
    monkeypatch.setattr("robot.link.sockets.receive_now", lambda _: None)
    in_step._watch_streams(shared := SharedTime(tmp_path / "time", create=True))
    keys = SimpleNamespace(role="monitor")
    link = SimpleNamespace(
        keys=keys, connect=lambda *_: None, reconnect=lambda _, stream: again.append(stream)
    )
    subscriber = Subscriber(cast(Any, link), Telemetry)
    for now_s, lasts_s in ((0.0, 60.0), (1.9, 1.0), (2.1, 0.5), (2.2, 1.0)):
        shared.set("now", now_s)
        subscriber.receive()
        assert again == []
        real_s[0] += lasts_s
    subscriber.receive()
    assert again == ["telemetry"]


def test_a_page_that_its_monitor_closed_can_still_be_looked_at() -> None:
    page = object.__new__(Operator)
    page.closed, page.watching, page._unseen = False, True, 0
    page._time, page._name = cast(Any, SimpleNamespace(poked=lambda _: None)), "monitor"
    page._protocol = ClientProtocol(parse_uri("ws://127.0.0.1/ws"))
    page._protocol.state = State.OPEN
    with socket.create_server(("127.0.0.1", 0)) as listener:
        page._socket = socket.create_connection(listener.getsockname())
        listener.accept()[0].close()
        with page._socket:
            for _ in range(3):
                page.look()
    assert page.closed
