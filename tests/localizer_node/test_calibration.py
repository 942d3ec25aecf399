from dataclasses import replace

import pytest

from localizer_node.calibration import (
    Board,
    Calibration,
    Colour,
    Marker,
)
from robot.errors import ConfigError, ContractError
from robot.lens import Hanging
from robot.output import write_yaml
from robot.typed_config import from_plain, load_yaml
from tests.localizer_node.rigs import LENSES, Rig


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens.model)
def test_a_file_gives_back_what_was_written(lens, tmp_path):
    robots = (Marker("a"), Marker("b", "tag", tag=7, board=Board(0.15, 0.15, 0.1)))
    written = replace(
        Rig(lens).calibration(robots),
        roi_px=((1.0, 2.0), (700.5, 3.0), (600.0, 700.0)),
        residual_mm=1.5,
    )
    write_yaml(tmp_path / "arena.yaml", written)
    assert load_yaml(Calibration, tmp_path / "arena.yaml") == written
    assert [p.name for p in tmp_path.iterdir()] == ["arena.yaml"]


def test_a_file_with_an_unknown_key_names_the_nearest(tmp_path):
    path = tmp_path / "arena.yaml"
    write_yaml(path, Rig().calibration())
    path.write_text(path.read_text().replace("hanging:", "hangin:"))
    with pytest.raises(ConfigError, match="did you mean 'hanging'"):
        load_yaml(Calibration, path)


@pytest.mark.parametrize(
    ("robots", "complaint"),
    [
        ((Marker("a"), Marker("b")), "cannot be told apart"),
        ((Marker("a"), Marker("a", front="magenta")), "cannot be told apart"),
        ((Marker("a", "tag", tag=3), Marker("b", "tag", tag=3)), "cannot be told apart"),
        ((Marker("a", "plain"), Marker("b", "tag")), "expected it alone"),
        ((Marker("a", front="gren"),), "did you mean 'green'"),
        ((Marker("a", front="blue"),), "cannot be told apart"),
        (tuple(Marker(f"r{k}", "tag", tag=k) for k in range(17)), "expected 0 to 16, got 17"),
        ((Marker("a", board=Board(height_m=3.0)),), "camera above the board"),
    ],
)
def test_robots_that_the_camera_could_confuse_are_refused(robots, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Rig().calibration(robots)


def test_impossible_parts_are_refused():
    with pytest.raises(ConfigError, match="did you mean 'two_colour'"):
        from_plain(Marker, {"kind": "two_color"})
    with pytest.raises(ConfigError, match="front_m < length_m"):
        Marker(board=Board(length_m=0.06, front_m=0.06))
    with pytest.raises(ConfigError, match="its white margin on it"):
        Marker(kind="tag", board=Board(0.1, 0.1, tag_m=0.09))
    with pytest.raises(ContractError, match="1 to 32 letters"):
        Marker("robot 1")
    for tag in (-1, 587):
        with pytest.raises(ConfigError, match="expected 0 to 586"):
            Marker(kind="tag", tag=tag)
    with pytest.raises(ConfigError, match="positive length_m"):
        Board(length_m=0.0)
    with pytest.raises(ConfigError, match="all at most 5 m"):
        Board(16.0, 14.0, 0.12, 6.0)
    with pytest.raises(ConfigError, match=r"height: expected 0\.1 to 20\.0, got 250"):
        replace(Rig().calibration(), hanging=Hanging((110.0, 132.0, 250.0)))
    with pytest.raises(ConfigError, match=r"hues 0\.\.360"):
        Colour("blue", 200.0, 400.0)
    for corners in (1, 2):
        with pytest.raises(ConfigError, match="at least 3 corners"):
            replace(Rig().calibration(), roi_px=((0.0, 0.0),) * corners)


def test_looking_up_a_colour_that_is_not_there():
    calibration = Rig().calibration()
    with pytest.raises(ConfigError, match="did you mean 'blue'"):
        calibration.colour("bleu")


def test_a_calibration_is_a_value():
    assert hash(Rig().calibration()) is not None
    assert isinstance(Rig().calibration(), Calibration)
    assert Rig().calibration().residual_mm is None
