"""Where frames are taken, how they are drawn from, cut, weighed, labelled and put on a sheet."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from robot.contract import ImageSpec
from robot.errors import ContractError, MapError
from robot.navigation.road_map import load_map, read_map
from sim_pybullet.scenery.objects import lane_poses
from trainer.export import check_translator
from trainer.transfer import parser, pictures
from trainer.transfer.cli import ParseOptions, Source, Sources, ThroughOptions
from trainer.transfer.cyclegan import _shifted
from trainer.transfer.labelled import VOID, Labelled, Photograph, Shape, draw, ends
from trainer.transfer.parser import Parser, class_weights, draw_batch
from trainer.transfer.pictures import Pictures, draw_sheet, load_paint, pictures_in, spread


def test_robots_are_a_little_beside_their_lane_and_a_tenth_of_them_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All on one place that heads north: beside it is east and west."""
    count = 20_000
    there = np.tile((1.0, 2.0, math.pi / 2.0), (count, 1))
    monkeypatch.setattr(pictures, "lane_poses", lambda *_: there.copy())
    poses = pictures.positions(load_map("loop"), count, np.random.default_rng(0))
    np.testing.assert_allclose(poses[:, 1], 2.0)
    assert poses[:, 0].mean() == pytest.approx(1.0, abs=1e-3)
    assert poses[:, 0].std() == pytest.approx(0.04, rel=0.03)
    turned = (poses[:, 2] - math.pi / 2.0 + math.pi) % (2.0 * math.pi) - math.pi
    lost = np.abs(turned) > 1.25  # five standard deviations
    assert lost.mean() == pytest.approx(0.1 * (1.0 - 1.25 / math.pi), abs=0.006)
    near = turned[np.abs(turned) < 0.5]
    assert near.std() == pytest.approx(0.215, abs=0.01), "of 0.25, cut at 0.5"
    assert abs(near.mean()) < 0.01


def test_robots_are_on_all_lanes_and_all_along_them() -> None:
    town = load_map("town")
    found = lane_poses(town, 4_000, np.random.default_rng(0))
    index = town.lane_index
    nearest = [index.near(x, y) for x, y, _ in found[:1_000]]
    assert max(float(near.distance_m.min()) for near in nearest) < 1e-3
    for (_, _, heading), near in zip(found, nearest, strict=False):
        on = near.distance_m < 1e-3
        assert np.cos(near.heading_rad[on] - heading).max() == pytest.approx(1.0, abs=1e-4)
    begun = [near.t[int(near.distance_m.argmin())] for near in nearest]
    assert np.histogram(begun, 4, (0.0, 1.0))[0].min() > 180
    with pytest.raises(MapError, match="expected a map with roads"):
        lane_poses(read_map({"tiles": [["grass"]], "tile_size": 0.5}, "m"), 1, None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("maps", "size"), [(("loop",), 48), (("loop", "town", "arena"), 16)])
def test_forty_eight_painted_worlds_are_shared_among_the_maps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, maps: tuple[str, ...], size: int
) -> None:
    made: list[int] = []
    batches: list[int] = []

    def snapshots(places: Any, pool: Any, count: int, rng: Any) -> tuple[np.ndarray, np.ndarray]:
        batches.append(count)
        frames = np.zeros((count, 120, 160, 3), np.uint8)
        frames[..., 0] = 200
        return frames, np.full((count, 120, 160), 3, np.uint8)

    monkeypatch.setattr(pictures, "LookPool", lambda *given: made.append(given[3]))
    monkeypatch.setattr(pictures, "snapshots", snapshots)
    out = tmp_path / "out"
    pictures.collect(out, Source(maps, 70, "nominal", seed=3))
    assert (made, batches) == ([size], [32, 32, 6])
    for part in ("image", "label"):
        names = sorted(path.name for path in (out / part).iterdir())
        assert names == [f"{k:06d}.png" for k in range(70)]
    picture = cv2.imread(str(out / "image" / "000069.png"))
    assert picture is not None
    assert picture[0, 0].tolist() == [0, 0, 200], "red is red in the file"


def test_every_folder_is_drawn_from_as_often() -> None:
    folder = np.repeat([0, 1, 2], [90, 9, 1])
    pictures = Pictures(np.zeros((100, 1, 1, 3), np.uint8), folder, ())
    drawn = pictures.draw(6_000, np.random.default_rng(0))
    assert np.bincount(folder[drawn], minlength=3) == pytest.approx([2000] * 3, abs=150)
    assert len(np.unique(drawn)) == 100


def test_photographs_move_by_a_twentieth_of_their_width_at_most() -> None:
    """A picture that tells where its pixels come from."""
    rows, columns = np.mgrid[0:40, 0:80]
    picture = np.stack((rows, columns, rows), axis=-1).astype(np.uint8)
    rng, moves = np.random.default_rng(0), set()
    for _ in range(800):
        seen = _shifted(picture, rng)
        down, right = int(seen[20, 40, 0]) - 20, int(seen[20, 40, 1]) - 40
        moves.add((down, right))
        np.testing.assert_array_equal(seen[..., 0], np.clip(rows + down, 0, 39))
        np.testing.assert_array_equal(seen[..., 1], np.clip(columns + right, 0, 79))
    assert {down for down, _ in moves} == {right for _, right in moves} == set(range(-4, 5))
    small = {int(_shifted(picture[:, :9], rng)[20, 4, 1]) for _ in range(60)}
    assert small == {3, 4, 5}, "by one pixel at least"


def test_rare_classes_weigh_more_by_a_root_and_not_without_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def source(counts: dict[int, int]) -> Labelled:
        values = np.repeat(list(counts), list(counts.values())).astype(np.uint8)
        return Labelled(np.array(["a"]), np.zeros((1, 1, len(values), 3)), values[None, None])

    one, other = source({0: 80, 1: 16, 2: 4, VOID: 900}), source({0: 8, 1: 2, 3: 10})
    shares = np.array([0.8 + 0.4, 0.16 + 0.1, 0.04, 0.5])
    expected = (np.median(shares) / shares) ** 0.25
    weights = class_weights([one, other], 6)
    assert weights.dtype == np.float32
    assert weights == pytest.approx([*expected, 1.0, 1.0])
    rare = source({0: 100_000, 1: 100_000, 2: 1})
    assert class_weights([rare], 6)[2] == pytest.approx(3.16)
    monkeypatch.setattr(parser, "MOST_WEIGHT", 1.05)
    assert class_weights([one, other], 6).max() == pytest.approx(1.05)


def test_frames_are_cut_to_six_tenths_and_more_and_mirrored_half_of_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(parser, "relit", lambda frame, _: frame)
    rows, columns = np.mgrid[0:60, 0:100].astype(np.float32)
    frame = np.stack((rows, columns, 0 * rows), axis=-1).astype(np.uint8)
    one, two = (
        Labelled(
            np.array(["a"] * many),
            np.repeat(frame[None], many, 0),
            np.full((many, 60, 100), label, np.uint8),
        )
        for many, label in ((1, 1), (9, 2))
    )
    frames, truth = draw_batch([one, two], 400, np.random.default_rng(0))
    assert frames.shape == (400, 60, 100, 3)
    heights = np.ptp(frames[..., 0].astype(int), axis=(1, 2)) + 1
    widths = np.ptp(frames[..., 1].astype(int), axis=(1, 2)) + 1
    assert heights.min() in (35, 36, 37)
    assert heights.max() == 60
    assert widths / heights == pytest.approx(100.0 / 60.0, rel=0.05)
    mirrored = frames[:, 30, 99, 1] < frames[:, 30, 0, 1]
    assert 160 < mirrored.sum() < 240
    assert 160 < (truth[:, 0, 0] == 1).sum() < 240, "as often from each source"
    tops = frames[:, 0, :, 0].min(1)
    assert tops.min() == 0
    assert tops.max() > 15


def test_a_parser_sees_what_it_was_taught_with() -> None:
    assert Parser(ParseOptions(size=(8, 12))).image == ImageSpec(12, 8)
    assert parser.LEARNING_RATE == 2e-3


def test_a_polygon_has_its_middles_of_pixels_and_a_line_its_width() -> None:
    box = Shape("road", ((2.0, 1.0), (6.0, 1.0), (6.0, 3.0), (2.0, 3.0)))
    drawn = draw(Photograph("a", False, (box,)), (10, 5), (5, 10))
    assert drawn.dtype == np.uint8
    rows, columns = np.nonzero(drawn)
    assert (rows.min(), columns.min()) == (1, 2)
    assert 2 <= rows.max() <= 3
    assert 5 <= columns.max() <= 6
    assert set(drawn[drawn > 0].tolist()) == {1}
    void = Shape("void", ((0.0, 2.5), (10.0, 2.5)), width=1.0)
    drawn = draw(Photograph("a", False, (void,)), (10, 5), (50, 100))
    assert (drawn == VOID).sum(0).max() == pytest.approx(10, abs=1)
    assert 19 <= np.nonzero(drawn[:, 50])[0].min() <= 21
    thin = Shape("red_line", ((0.0, 20.0), (100.0, 20.0)), width=1.0)
    drawn = draw(Photograph("a", False, (thin,)), (100, 50), (5, 10))
    assert (drawn == 4).sum(0).max() == 1, "a pixel at least"


def test_the_ends_of_sequences() -> None:
    names = [f"a_{k}" for k in range(8)] + [f"b_{k}" for k in range(3)] + ["c_0"]
    assert ends(names, 0.25).nonzero()[0].tolist() == [6, 7, 10]
    assert ends(names[::-1], 0.25).nonzero()[0].tolist() == [1, 4, 5]


def test_a_spread_is_even_and_has_both_ends() -> None:
    assert spread(10, 4).tolist() == [0, 3, 6, 9]
    assert spread(3, 3).tolist() == [0, 1, 2]


def test_a_sheet_has_titled_columns_of_doubled_pictures(tmp_path: Path) -> None:
    first, second = (np.full((2, 10, 30, 3), level, np.uint8) for level in (40, 90))
    draw_sheet(tmp_path / "s.png", {"input": first, "other": second})
    sheet = cv2.imread(str(tmp_path / "s.png"))
    assert sheet is not None
    assert sheet.shape == (16 + 2 * 24, 2 * 64, 3)
    assert (sheet[16:36, :60] == 40).all()
    assert (sheet[40:60, 64:124] == 90).all()
    assert (sheet[36:40] == 255).all()
    assert (sheet[16:, 60:64] == 255).all()
    assert (sheet[:16, :64] < 128).any(), "the title"
    assert (sheet[:16, 64:] < 128).any()


def test_pictures_lie_in_one_of_three_places(tmp_path: Path) -> None:
    def put(name: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.zeros((4, 4, 3), np.uint8))
        return path

    bare = put("bare/a.png")
    assert pictures_in(tmp_path / "bare") == [bare]
    camvid = put("camvid/images/image/b.png")
    put("camvid/c.png")
    assert pictures_in(tmp_path / "camvid") == [camvid]
    ours = put("camvid/image/d.png")
    assert pictures_in(tmp_path / "camvid") == [ours]


def test_paint_is_told_as_shares_by_class(tmp_path: Path) -> None:
    from sim_pybullet.scene import SemanticClass as Seen

    (tmp_path / "image").mkdir()
    (tmp_path / "label").mkdir()
    label = np.full((120, 160), Seen.SKY, np.uint8)
    label[40:60, 0:20], label[40:60, 20:40] = Seen.WHITE_LINE, Seen.YELLOW_LINE
    label[40:60, 40:60], label[40:60, 60:81] = Seen.RED_LINE, Seen.ROAD
    cv2.imwrite(str(tmp_path / "label" / "a.png"), label)
    pictures = Pictures(np.zeros((1, 1, 1, 3)), np.zeros(1), (tmp_path / "image" / "a.png",))
    paint = load_paint(pictures, ImageSpec(80, 60, 20))
    assert (paint.shape, paint.dtype) == ((1, 4, 40, 80), np.uint8)
    for k in range(4):
        row = paint[0, k, 5]
        assert (row[10 * k : 10 * k + 10] == 255).all()
        assert not row[: 10 * k].any()
    assert paint[0, 3, 5, 40] == pytest.approx(128, abs=1), "half of this pixel"
    assert not paint[0, :, 11].any()


def test_an_export_may_differ_by_one_level() -> None:
    pictures = np.full((3, 2, 2, 3), 100, np.uint8)

    def network(given: torch.Tensor) -> torch.Tensor:
        return given

    for off in (1, -1, 2):
        exported: Any = lambda given, off=off: given + np.int64(off)  # noqa: E731
        exported = _Named(exported)
        if abs(off) <= 1:
            check_translator(network, exported, pictures)  # type: ignore[arg-type]
        else:
            with pytest.raises(ContractError, match="within 1, they differ by 2"):
                check_translator(network, exported, pictures)  # type: ignore[arg-type]


class _Named:
    path = "x.onnx"

    def __init__(self, call: Any) -> None:
        self._call = call

    def __call__(self, pictures: np.ndarray) -> np.ndarray:
        return np.asarray(self._call(pictures.astype(int)))


def test_what_may_be_asked_of_trainings() -> None:
    options = ParseOptions()
    told = (options.labels, options.net, options.size, options.steps, options.batch, options.seed)
    assert told == ("road", "small", (120, 160), 2000, 8, 0)
    assert options.sources == Sources((), "", "")
    through = ThroughOptions("s", "r", "p.pt")
    told = (through.preset, through.net, through.steps, through.seed, through.task)
    assert told == ("fast", "small", 2000, 0, "lane")
    assert through.labels == "road"
