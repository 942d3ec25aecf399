"""``python -m tests.trainer.judge_sight``: how right sight is, and how sure of it.

Asked about what experts see who drive on maps and in looks that it never saw.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot.command_line import OneLineParser, answer, whole
from robot.navigation.road_map import load_map
from robot.output import expect_writable, write_json
from robot.typed_config import to_plain
from robot.vision.sight import OnnxSight, Seen
from sim_pybullet.randomise import load_look_sampler
from sim_pybullet.tasks.navigation import Navigation
from sim_pybullet.tasks.traffic import Traffic
from sim_pybullet.traffic.scenario import load_scenario
from trainer.division import division, maps_named
from trainer.sight.augment import spoiled
from trainer.sight.cli import SHIPPED
from trainer.sight.pictures import (
    CROSSING,
    DRIVEN_M,
    FREE,
    IN_LANE_M,
    KIND,
    LINE,
    NEW,
    ROAD,
    ROBOTS,
    START_SPREAD,
    THING,
    Pictures,
    anywhere,
    drive,
)

SURE = 0.5  # a probability above it is a yes
NEAR_M = 0.4  # within which a red line must be found, and what is in the way
OUTLIER = 3.0  # standard deviations
_SPOILED = 2_000


@dataclass(frozen=True)
class Error:
    """Of one figure, in its own unit."""

    pictures: int
    rms: float
    median: float
    ratio: float  # rms of the error over its own standard deviation: 1 is honest
    outliers: float  # share of errors beyond three standard deviations


@dataclass(frozen=True)
class Judgement:
    """What is found in one look; shares are of the pictures asked about."""

    look: str
    pictures: int
    driven_m: float
    offset_m: Error
    heading_rad: Error
    curvature_pm: Error
    line_m: Error  # of lines that were found, 12 to 40 cm before the axle
    oncoming_offset_m: Error  # in the oncoming lane, of who stands and looks anywhere
    crossing_offset_m: Error  # in junctions
    crossing_heading_rad: Error
    line_found: float  # of the pictures with a line 12 to 40 cm before the axle
    lines_passed_by: int  # lines of which less than half of these pictures told
    lines: int
    invented_per_200_m: float  # lines told where none is within 1.2 m
    junction_right: float
    road_believed: float
    no_road_believed: float  # anywhere else, and in spoiled pictures
    way: Way


@dataclass(frozen=True)
class Way:
    """What is seen of others in the way, by experts among ducks and cars."""

    pictures: int
    driven_m: float
    free_m: Error  # of what was found within 40 cm of the nose
    found: float  # of the pictures with something there
    passed_by: int  # things of which less than half of these pictures told
    things: int
    invented_per_200_m: float  # told where nothing is within 65 cm


def judge(
    sight: OnnxSight, look: str, driven: Pictures, elsewhere: Pictures, met: Pictures
) -> Judgement:
    """Compare what is seen by experts that drive, from anywhere, and among others, with the map."""
    labels, seen = driven.labels, see(sight, driven.images)
    lane, crossing = (labels[:, CROSSING] == value for value in (0.0, 1.0))
    lane &= labels[:, 0] <= IN_LANE_M
    strayed = elsewhere.labels[:, 0] > IN_LANE_M
    told = seen.line > SURE
    near = (labels[:, LINE] == 1.0) & (labels[:, 3] <= NEAR_M)
    asked = labels[:, KIND] >= 0.0
    whole_m = float(labels[:, DRIVEN_M].sum())
    # A line farther than its question reaches is no invention.
    invented = told & ((labels[:, KIND] == 0.0) | (crossing & (labels[:, LINE] == 0.0)))
    lines, passed_by = _lines(near, told)
    offset, heading, curvature = (_error(seen, labels, k, lane) for k in range(3))
    aside, askew = (_error(seen, labels, k, crossing) for k in range(2))
    return Judgement(
        look=look,
        pictures=len(labels),
        driven_m=whole_m,
        offset_m=offset,
        heading_rad=heading,
        curvature_pm=curvature,
        line_m=_error(seen, labels, 3, near & told),
        oncoming_offset_m=_error(see(sight, elsewhere.images), elsewhere.labels, 0, strayed),
        crossing_offset_m=aside,
        crossing_heading_rad=askew,
        line_found=float(told[near].mean()),
        lines_passed_by=passed_by,
        lines=lines,
        invented_per_200_m=200.0 / whole_m * _runs(invented),
        junction_right=float((seen.junction.argmax(1) == labels[:, KIND])[asked].mean()),
        road_believed=float((seen.road > SURE)[labels[:, ROAD] == 1.0].mean()),
        no_road_believed=_believed(sight, driven, elsewhere),
        way=_way(sight, met),
    )


def _way(sight: OnnxSight, met: Pictures) -> Way:
    labels, seen = met.labels, see(sight, met.images)
    told, whole_m = seen.thing > SURE, float(labels[:, DRIVEN_M].sum())
    near = (labels[:, THING] == 1.0) & (labels[:, FREE] <= NEAR_M)
    things, passed_by = _lines(near, told)
    return Way(
        pictures=len(labels),
        driven_m=whole_m,
        free_m=_error(seen, labels, FREE, near & told),
        found=float(told[near].mean()),
        passed_by=passed_by,
        things=things,
        invented_per_200_m=200.0 / whole_m * _runs(told & (labels[:, THING] == 0.0)),
    )


def see(sight: OnnxSight, images: np.ndarray) -> Seen:
    """What is seen in many pictures."""
    parts = [sight(part) for part in np.array_split(images, max(1, len(images) // 512))]
    return Seen(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _error(seen: Seen, labels: np.ndarray, figure: int, where: np.ndarray) -> Error:
    known = where & np.isfinite(labels[:, figure]) & (labels[:, NEW] > 0.0)
    if not known.any():
        return Error(0, *[float("nan")] * 4)
    error = seen.figures[known, figure] - labels[known, figure]
    ratio = error / seen.deviations[known, figure]
    return Error(
        len(error),
        float(np.sqrt((error**2).mean())),
        float(np.median(np.abs(error))),
        float(np.sqrt((ratio**2).mean())),
        float((np.abs(ratio) > OUTLIER).mean()),
    )


def _lines(near: np.ndarray, told: np.ndarray) -> tuple[int, int]:
    """How many things robots came to, and how many they passed by without telling of them."""
    lines = passed_by = 0
    for there, tells in zip(near.reshape(-1, ROBOTS).T, told.reshape(-1, ROBOTS).T, strict=True):
        begins = np.flatnonzero(np.diff(there, prepend=False, append=False)).reshape(-1, 2)
        for begin, end in begins.tolist():
            lines += 1
            passed_by += tells[begin:end].mean() < 0.5
    return lines, int(passed_by)


def _runs(where: np.ndarray) -> int:
    """How often each robot begins to be where this holds."""
    return int((np.diff(where.reshape(-1, ROBOTS).astype(int), axis=0, prepend=0) > 0).sum())


def _believed(sight: OnnxSight, driven: Pictures, elsewhere: Pictures) -> float:
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(driven.images), min(_SPOILED, len(driven.images)), replace=False)
    spoilt = np.stack([spoiled(image, rng) for image in driven.images[np.sort(chosen)]])
    wrong = np.concatenate((spoilt, elsewhere.images[elsewhere.labels[:, ROAD] == 0.0]))
    return float((see(sight, wrong).road > SURE).mean())


def as_rows(judgements: list[Judgement]) -> list[tuple[str, ...]]:
    """For a table: a head, and a row for each look."""
    rows = [_row(each) for each in judgements]
    return [tuple(rows[0]), *(tuple(row.values()) for row in rows)]


def _row(each: Judgement) -> dict[str, str]:
    way, line, turned = each.way, each.line_m, each.heading_rad
    aside, askew = each.crossing_offset_m, each.crossing_heading_rad
    return {
        "look": each.look,
        "pictures": str(each.pictures),
        "offset rms (ratio, outliers)": f"{100 * each.offset_m.rms:.1f} cm {_of(each.offset_m)}",
        "heading": f"{np.degrees(turned.rms):.1f}° {_of(turned)}",
        "in the oncoming lane": f"{100 * each.oncoming_offset_m.rms:.1f} cm",
        "in junctions": f"{100 * aside.rms:.1f} cm, {np.degrees(askew.rms):.1f}°",
        "red line: error": f"{100 * line.rms:.1f} cm {_of(line)}",
        "found": f"{each.line_found:.1%}",
        "passed by": f"{each.lines_passed_by} of {each.lines}",
        "invented in 200 m": f"{each.invented_per_200_m:.1f}",
        "junction right": f"{each.junction_right:.1%}",
        "road believed": f"{each.road_believed:.1%}",
        "no road believed": f"{each.no_road_believed:.1%}",
        "free way: error": f"{100 * way.free_m.rms:.1f} cm {_of(way.free_m)}",
        "way found": f"{way.found:.1%}",
        "way passed by": f"{way.passed_by} of {way.things}",
        "way invented in 200 m": f"{way.invented_per_200_m:.1f}",
    }


def _of(error: Error) -> str:
    return f"({error.ratio:.2f}, {error.outliers:.1%})"


def judge_all(options: argparse.Namespace) -> None:
    """Drive in each look, judge, and tell; DuckpilotError for no such sight, look or map."""
    expect_writable(options.json, inputs=[options.model])
    sight, found = OnnxSight(options.model), []
    maps = [load_map(name) for name in maps_named(options.map) or division().maps.judging]
    for name in options.look:
        looks = load_look_sampler(name)
        driven = drive(
            Navigation(maps, ROBOTS, START_SPREAD), looks, options.seed, options.decisions
        )
        met = drive(
            Traffic(maps, ROBOTS, load_scenario("mixed")), looks, options.seed, options.decisions
        )
        elsewhere = anywhere(maps, looks, options.seed)
        found.append(judge(sight, name, driven, elsewhere, met))
    if options.json is not None:
        inputs = {"model": str(options.model), "maps": [m.name for m in maps]}
        inputs["seed"] = options.seed
        write_json(options.json, {"inputs": inputs, "looks": [to_plain(each) for each in found]})
    head, *rows = as_rows(found)
    for row in (head, ["---"] * len(head), *rows):
        print(f"| {' | '.join(row)} |")


def main(arguments: list[str] | None = None) -> int:
    """Exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_sight", description=__doc__)
    parser.add_argument("--model", type=Path, default=SHIPPED)
    parser.add_argument("--json", type=Path, help="write the figures")
    parser.add_argument("--look", nargs="+", default=("randomised", "reality"))
    parser.add_argument("--map", nargs="+", default=(), help="else all judging maps")
    parser.add_argument("--decisions", type=whole(1, 100_000), default=400, help="of 20 robots")
    parser.add_argument("--seed", type=whole(0, 2**31 - 1), default=1000)
    options = parser.parse_args(arguments)
    return answer("judge_sight", lambda: judge_all(options))


if __name__ == "__main__":
    sys.exit(main())
