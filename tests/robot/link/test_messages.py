"""Messages survive the wire, and nothing else gets in."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.errors import ContractError
from robot.link import messages as tm
from robot.link.messages import (
    FAR_M,
    KINDS,
    MAX_ROBOTS,
    Ack,
    Command,
    FrameMessage,
    InputAge,
    Mission,
    MissionStatus,
    PoseMessage,
    PosesMessage,
    Reading,
    Sighting,
    Telemetry,
    thin_path,
)

names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,31}", fullmatch=True)
metres = st.floats(-FAR_M, FAR_M)
angles = st.floats(-math.pi, math.pi)
times = st.floats(0, 1e9)
points = st.tuples(metres, metres)
counts = st.integers(0, 2**53)
stamps = {"session": names, "sequence": counts, "t_sent_s": times}
texts = st.text(st.characters(exclude_categories=("C", "Z")), max_size=30)
shares = st.floats(0, 1)

sightings = st.builds(
    Sighting,
    robot=names,
    x_m=metres,
    y_m=metres,
    heading_rad=st.none() | angles,
    confidence=shares,
)
poses = st.builds(
    PosesMessage,
    robots=st.lists(sightings, max_size=MAX_ROBOTS).map(tuple),
    t_capture_s=times,
    **stamps,
)
labels = st.text(st.characters(exclude_categories=("C", "Z")), max_size=6)
ages = st.builds(InputAge, labels, st.none() | st.floats(0, 1e5), st.floats(0, 10))
readings = st.builds(
    Reading, labels, st.floats(-1e6, 1e6), st.just("°C"), st.sampled_from(tm.LEVELS)
)
missions = st.builds(
    MissionStatus,
    id=names,
    destination=points,
    phase=st.sampled_from(tm.PHASES),
    progress=shares,
    remaining_m=st.floats(0, 100),
    offset_m=st.floats(-1, 1),
    reason=texts,
)
telemetries = st.builds(
    Telemetry,
    robot=names,
    state=st.sampled_from(tm.STATES),
    reason=texts,
    action=st.none() | st.integers(0, 4),
    values=st.lists(st.floats(-1e3, 1e3), max_size=5).map(tuple),
    pose=st.none() | st.tuples(metres, metres, angles),
    path=st.lists(points, max_size=400).map(lambda p: thin_path(np.array(p).reshape(-1, 2))),
    mission=st.none() | missions,
    inputs=st.lists(ages, max_size=tm.MAX_ENTRIES).map(tuple),
    health=st.lists(readings, max_size=tm.MAX_ENTRIES).map(tuple),
    fps=st.floats(0, 1000),
    lag_s=st.floats(0, 10),
    **stamps,
)
rims = st.floats(-1.0, 1.0).map(lambda speed: round(speed, 6))
commands = st.sampled_from(KINDS).flatmap(
    lambda kind: st.builds(
        Command,
        id=names,
        session=names,
        kind=st.just(kind),
        mission=st.builds(Mission, points, points if kind == "place" else st.none() | points)
        if kind in ("plan", "mission", "place")
        else st.none(),
        wheels=st.none() | st.tuples(rims, rims) if kind == "manual" else st.none(),
        robot_session=names,
        robot_time_s=times,
    )
)
acks = st.builds(Ack, names, st.booleans(), texts, names, times)
PARSERS = (PosesMessage, Telemetry, Command, Ack, FrameMessage)

POSE = PosesMessage((Sighting("duck", 1.0, 2.0, 0.5, 0.9),), 10.0, "abcd", 7, 10.1)


@given(poses | telemetries | commands | acks)
@settings(max_examples=150, deadline=None)
def test_every_message_fits_and_survives_the_wire(message: Any) -> None:
    data = message.to_bytes()
    assert len(data) <= 4096
    again = type(message).from_bytes(data)
    assert again.to_bytes() == data


@given(names, counts, times.map(lambda t_s: round(t_s, 6)), st.binary(max_size=300))
@settings(max_examples=50, deadline=None)
def test_a_frame_survives_the_wire(session: str, sequence: int, t_s: float, body: bytes) -> None:
    frame = FrameMessage(b"\xff\xd8" + body + b"\xff\xd9", t_s, session, sequence, t_s)
    assert FrameMessage.from_bytes(frame.to_bytes()) == frame


@pytest.mark.parametrize("kind", PARSERS)
@given(data=st.binary(max_size=200))
@settings(max_examples=60, deadline=None)
def test_garbage_raises_only_contract_errors(kind: Any, data: bytes) -> None:
    with pytest.raises(ContractError):
        kind.from_bytes(data)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@pytest.mark.parametrize("kind", [PosesMessage, Telemetry, Command, Ack])
@given(data=st.data())
@settings(max_examples=100, deadline=None)
def test_a_spoilt_message_is_read_or_refused_but_never_breaks(kind: Any, data: Any) -> None:
    """One field of a good message replaced by anything: equal kind out, or ContractError."""
    source = {PosesMessage: poses, Telemetry: telemetries, Command: commands, Ack: acks}[kind]
    plain = json.loads(data.draw(source).to_bytes())
    plain[data.draw(st.sampled_from(sorted(plain)))] = data.draw(json_values)
    try:
        again = kind.from_bytes(json.dumps(plain).encode())
    except ContractError:
        return
    assert len(again.to_bytes()) <= 4096


def spoilt(**changes: Any) -> bytes:
    """POSE with other values, of the message or of its robot."""
    plain = json.loads(POSE.to_bytes())
    for key, value in changes.items():
        (plain if key in plain else plain["robots"][0])[key] = value
    return json.dumps(plain).encode()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (spoilt(schema=2), "expected schema 1, got 2"),
        (spoilt(schema=True), "expected schema 1, got True"),
        (spoilt(message="ack"), "expected message 'pose'"),
        (spoilt(xm=1.0), "did you mean 'x_m'"),
        (spoilt(x_m=float("nan")), "got nan"),
        (spoilt(x_m=10**400), "expected float, got 1000"),
        (spoilt(x_m=2000.0), r"\[-1000, 1000\]"),
        (spoilt(y_m=True), "expected float"),
        (spoilt(heading_rad=4.0), "heading_rad"),
        (spoilt(confidence=1.5), "confidence"),
        (spoilt(sequence=-1), "sequence"),
        (spoilt(sequence=1.5), "expected int"),
        (spoilt(robot="../duck"), "letters"),
        (spoilt(robot="d" * 5000), "at most 4096 bytes"),
        (POSE.to_bytes().replace(b'"x_m"', b'"y_m"'), "key twice"),
        (b"[" * 4000, "expected JSON"),
        (b"\xff\xfe", "expected JSON"),
        (b"[]", "expected an object"),
        (b"{}", "expected schema"),
        (spoilt(x_m=1.0).replace(b"1.0", b"1e999"), "expected float, got inf"),
    ],
)
def test_the_refusal_says_what_was_wrong(data: bytes, says: str) -> None:
    with pytest.raises(ContractError, match=says):
        PosesMessage.from_bytes(data)


def test_a_frame_that_is_no_jpeg_or_too_large_is_refused() -> None:
    with pytest.raises(ContractError, match="JPEG"):
        FrameMessage(b"GIF89a", 0.0)
    with pytest.raises(ContractError, match="at most 65536 bytes"):
        FrameMessage(b"\xff\xd8" + bytes(49152) + b"\xff\xd9", 0.0).to_bytes()
    good = FrameMessage(b"\xff\xd8\xff\xd9", 0.0).to_bytes()
    with pytest.raises(ContractError, match="expected bytes"):
        FrameMessage.from_bytes(good.replace(b'"jpeg":"', b'"jpeg":"*'))


def test_each_robot_has_its_own_pose_with_the_stamp_of_all() -> None:
    both = (Sighting("duck", 1.0, 2.0, 0.5, 0.9), Sighting("drake", 3.0, 4.0, None, 0.8))
    poses = PosesMessage(both, 10.0, "s", 7, 10.02)
    assert poses.of("drake") == PoseMessage("drake", 3.0, 4.0, None, 0.8, 10.0, "s", 7, 10.02)
    assert poses.of("duck") == poses.every[0]
    assert poses.of("rover") is None


def test_half_a_character_is_no_text() -> None:
    data = Ack("i", False, "x").to_bytes().replace(b'"x"', b'"\\ud800"')
    with pytest.raises(ContractError, match="of printable text"):
        Ack.from_bytes(data)


@pytest.mark.parametrize("jpeg", [b"\xff\xd8 cut off", b"beheaded \xff\xd9"])
def test_half_a_picture_is_none(jpeg: bytes) -> None:
    with pytest.raises(ContractError, match="expected JPEG bytes"):
        FrameMessage(jpeg, 1.0)


def test_a_mission_comes_with_a_mission_command_only() -> None:
    with pytest.raises(ContractError, match="mission"):
        Command("1", "s", "mission")
    with pytest.raises(ContractError, match="mission"):
        Command("1", "s", "arm", Mission((0.0, 0.0)))
    with pytest.raises(ContractError, match="wheels"):
        Command("1", "s", "stop", wheels=(0.1, 0.1))


def test_a_thinned_path_keeps_both_ends_and_its_bends() -> None:
    turn = np.linspace(0.0, math.pi / 2, 50)
    bend = 0.2 * np.stack((np.sin(turn), 1.0 - np.cos(turn)), axis=1)
    straight = np.stack((np.linspace(-9.0, 0.0, 500), np.zeros(500)), axis=1)
    thin = np.array(thin_path(np.concatenate((straight, bend[1:]))))
    assert len(thin) <= tm.MAX_PATH_POINTS
    assert tuple(thin[0]) == (-9.0, 0.0)
    assert tuple(thin[-1]) == (0.2, 0.2)
    middles = (thin[1:] + thin[:-1]) / 2
    in_bend = middles[middles[:, 0] > 0.0]
    assert np.abs(np.hypot(in_bend[:, 0], in_bend[:, 1] - 0.2) - 0.2).max() < 0.01
    spiral = [
        (round(0.01 * k * math.cos(k), 3), round(0.01 * k * math.sin(k), 3)) for k in range(97)
    ]
    assert thin_path(np.array(spiral[:96])) == tuple(spiral[:96]), "so many travel as they are"
    assert len(thin_path(np.array(spiral))) <= 96
    assert thin_path(np.zeros((0, 2))) == ()
    assert len(thin_path(np.zeros((500, 2)))) >= 1
