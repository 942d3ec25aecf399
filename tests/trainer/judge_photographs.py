"""``python -m tests.trainer.judge_photographs FOLDER``: on photographs that a person annotated.

What policies choose there, and where lines are seen.

``trainer/sight/photographs.yaml`` holds file names, letters for actions and points of lines; the
photographs lie elsewhere; docs/photographs.md has the rule. Where a line lies on the floor depends
on lens and mounting, which nobody measured: the nominal ones are assumed (three calibrated robots
are within 3 % of them).
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from robot.command_line import OneLineParser, answer
from robot.contract import FIVE_ACTIONS, FRAME_HEIGHT_PX, FRAME_WIDTH_PX
from robot.inference.policy import SHIPPED_MODELS, OnnxPolicy, values_of
from robot.inference.preprocess import preprocess
from robot.lens import CameraRig
from robot.output import expect_writable, write_json
from robot.vision.sight import OnnxSight
from sim_pybullet.look import NOMINAL
from tests.trainer.judging.yellow_line import (
    DASHES,
    RANGE_M,
    Dash,
    YellowLine,
    detect_yellow_line,
    fit_line,
    floor_table,
)
from trainer.division import division
from trainer.sight.photographs import (
    WHITE_M,
    YELLOW_M,
    Polyline,
    annotations_of,
    dense,
    frames_of,
    on_floor,
)

SEERS = tuple(
    SHIPPED_MODELS / f"{name}.onnx"
    for name in (
        *("lane_sight", "lane_coached", "lane_dueling", "lane_ppo"),
        *("nav_sight", "nav_dueling", "nav_ppo", "sight"),
    )
)
_SPACING_M = 0.075  # a dash and a gap of Duckietown's yellow tape

# Lines between these distances may be found or not; the detector's range lies between them.
SURELY_NEAR_M, SURELY_FAR_M = 0.9 * RANGE_M, 1.1 * RANGE_M
TOO_CLOSE_M = 0.01  # to the line: no side can be told


class DrawnLine(NamedTuple):
    """A drawn line on the floor, robot frame."""

    nearest_m: float  # its point nearest to the axle
    line: YellowLine


def drawn_line(
    points: Polyline, size: tuple[int, int], rig: CameraRig, reference_m: float
) -> DrawnLine | None:
    """The line as the detector would have it, had it seen what the person drew.

    ``points`` are drawn through its middle, from near to far [px]; ``size``: width, height that
    they count in; ``rig``: the camera that is assumed; ``reference_m``: how far ahead of the axle
    the point lies that is judged. None where less than two points lie on the floor.
    """
    floor = on_floor(points, size, rig)
    if len(floor) < 2:
        return None
    points_m = dense(floor, _SPACING_M)
    near = points_m[np.hypot(*points_m.T) < RANGE_M][:DASHES]
    chosen = near if len(near) > 1 else floor[:2]
    step = chosen[1] - chosen[0]
    direction = math.atan(step[1] / step[0]) if step[0] else math.pi / 2
    dashes = tuple(Dash(float(x), float(y), direction, 0.05, 0.025, 9) for x, y in chosen)
    nearest_m = float(np.hypot(*floor.T).min())
    return DrawnLine(nearest_m, fit_line(dashes, reference_m))


def agrees(found: YellowLine, drawn: Sequence[DrawnLine]) -> bool | None:
    """Whether what was found of a line is what a person drew, on its side; None: nobody can say."""
    nearest_m = min((each.nearest_m for each in drawn), default=np.inf)
    if SURELY_NEAR_M <= nearest_m < SURELY_FAR_M:
        return None
    near = nearest_m < SURELY_NEAR_M
    if not (found.found and near):
        return found.found == near
    sides_m = [each.line.offset_m for each in drawn if each.nearest_m < SURELY_FAR_M]
    if min(abs(side_m) for side_m in sides_m) < TOO_CLOSE_M:
        return None
    return any((side_m > 0.0) == found.crossed for side_m in sides_m)


RIG = NOMINAL.rig()
REFERENCE_M = floor_table(RIG, FRAME_WIDTH_PX, FRAME_HEIGHT_PX).reference_m
AHEAD_M = 0.3  # where pursuit aims; of 12 to 35 cm the best on the sites to choose by, as is 4
BORDERS_PM = (4.0, 1.5, -1.5, -4.0)  # curvatures of arcs between which the five actions lie
WITHIN_M = 0.06  # half a lane's half: a line found there is found right
SITE_PICTURES = 10  # a smaller site is nobody's worst
_MEANINGS = {"s": "sensible", "a": "arguable", "w": "wrong"}


class Answer(NamedTuple):
    """What one that sees says of a picture; None of what it is not asked."""

    action: int | None = None
    doubt: float = 0.0  # the lower, the surer; compared among its own answers only
    yellow: YellowLine | None = None
    white: YellowLine | None = None


Seer = Callable[[np.ndarray], Answer]  # of frames (120, 160, 3) uint8 RGB


class Judged(NamedTuple):
    """One answer, judged; None where there is nothing to judge."""

    site: str
    letter: str | None  # s(ensible), a(rguable) or w(rong)
    doubt: float
    yellow_side: bool | None  # found on its side, or rightly not found
    yellow_near: bool | None  # found within `WITHIN_M` of where a person drew it
    white_near: bool | None


def pursuit(offset_m: float, heading_rad: float, bend_pm: float) -> int:
    """The action for the arc that leads to the middle of the lane, `AHEAD_M` ahead."""
    left_m = 0.5 * bend_pm * AHEAD_M**2 - offset_m
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    x, y = c * AHEAD_M + s * left_m, c * left_m - s * AHEAD_M
    return sum(2.0 * y / (x * x + y * y) < border_pm for border_pm in BORDERS_PM)


def seer_of(model: Path) -> Seer:
    """A policy, a navigator's with its path straight ahead; or sight, with pursuit of what it sees.

    ContractError if it is neither, or does not choose among the five actions.
    """
    if model.stem.startswith("sight"):
        sight = OnnxSight(model)
        return lambda frame: _seen_by(sight, frame)
    policy = OnnxPolicy(model, FIVE_ACTIONS)
    path = np.zeros(policy.contract.path_points, np.float32)

    def choose(frame: np.ndarray) -> Answer:
        values = np.asarray(values_of(policy, frame, path))
        second, best = np.sort(values)[-2:].tolist()
        return Answer(int(values.argmax()), second - best)

    return choose


def _seen_by(sight: OnnxSight, frame: np.ndarray) -> Answer:
    seen = sight(preprocess(frame, sight.contract.image)[None])
    offset_m, heading_rad, bend_pm, *_ = seen.figures[0].tolist()
    aside_m, turned_rad, *_ = seen.deviations[0].tolist()
    there_m = offset_m + REFERENCE_M * math.sin(heading_rad) - 0.5 * bend_pm * REFERENCE_M**2
    direction_rad, road = bend_pm * REFERENCE_M - heading_rad, bool(seen.road[0] > 0.5)
    yellow, white = (
        YellowLine(road, there_m - line_m, direction_rad) for line_m in (YELLOW_M, WHITE_M)
    )
    doubt = math.hypot(aside_m, AHEAD_M * turned_rad)
    return Answer(pursuit(offset_m, heading_rad, bend_pm), doubt, yellow, white)


def seers(models: Iterable[Path]) -> dict[str, Seer]:
    """These by name, the yellow-line detector, and two that look at nothing."""
    rng = np.random.default_rng(0)
    return {
        **{model.stem: seer_of(model) for model in models},
        "yellow-line detector": lambda frame: Answer(yellow=detect_yellow_line(frame, RIG)),
        "always straight": lambda _: Answer(2),
        "drawn by lot": lambda _: Answer(int(rng.integers(5)), rng.random()),
    }


def judge(see: Seer, photographs: Path, part: str) -> list[Judged]:
    """Ask about every photograph of the sites of one part; ConfigError if one is missing."""
    annotations, judged = annotations_of(photographs), []
    names = getattr(division().sites, part)
    for site in (each for each in annotations.sites if each.name in names):
        for drawn, frame in frames_of(site, photographs):
            answer = see(frame)
            lines = [
                [drawn_line(points, annotations.size, RIG, REFERENCE_M) for points in colour]
                for colour in (drawn.yellow, [drawn.white] if drawn.white else [])
            ]
            yellow, white = ([each for each in colour if each] for colour in lines)
            letter = None
            if drawn.actions and answer.action is not None:
                letter = drawn.actions[answer.action]
            judged.append(
                Judged(
                    site.name,
                    letter,
                    answer.doubt,
                    agrees(answer.yellow, yellow) if answer.yellow else None,
                    _near(answer.yellow, yellow),
                    _near(answer.white, white),
                )
            )
    return judged


def _near(found: YellowLine | None, drawn: Sequence[Any]) -> bool | None:
    """Whether a line lies where a person drew one near; None: not asked, or none is near."""
    there = [each.line.offset_m for each in drawn if each.nearest_m < SURELY_NEAR_M]
    if found is None or not there:
        return None
    return found.found and min(abs(found.offset_m - each) for each in there) < WITHIN_M


def figures(judged: Sequence[Judged]) -> dict[str, Any]:
    """Shares of the answers, of all sites and of each; the surest half is that of all."""
    chosen = [each for each in judged if each.letter is not None]
    names = dict.fromkeys(each.site for each in judged)
    sites = {name: _shares([each for each in judged if each.site == name]) for name in names}
    large = {name: own["wrong"] for name, own in sites.items() if own["chosen"] >= SITE_PICTURES}
    worst = max(large, key=lambda name: large[name], default=None)
    surest = sorted(chosen, key=lambda each: each.doubt)[: len(chosen) // 2]
    return {
        **_shares(judged),
        "worst_site": worst,
        "worst_wrong": large.get(worst or ""),
        "surest_half_wrong": _shares(surest)["wrong"],
        "sites": sites,
    }


def _shares(judged: Sequence[Judged]) -> dict[str, Any]:
    letters = Counter(each.letter for each in judged if each.letter is not None)
    count = letters.total()
    found: dict[str, Any] = {"pictures": len(judged), "chosen": count}
    for letter, word in _MEANINGS.items():
        found[word] = letters[letter] / count if count else None
    for name in ("yellow_side", "yellow_near", "white_near"):
        asked = [right for each in judged if (right := getattr(each, name)) is not None]
        found[name] = sum(asked) / len(asked) if asked else None
        found[f"{name}_asked"] = len(asked)
    return found


def as_rows(found: dict[str, dict[str, Any]]) -> list[tuple[str, ...]]:
    """A table: a head, and a row for each that was asked."""
    columns = ["sensible", "arguable", "wrong", "worst_wrong", "surest_half_wrong"]
    columns += ["yellow_side", "yellow_near", "white_near"]
    head = ["who", "pictures", *(name.replace("_", " ") for name in columns)]
    rows = [tuple(head), ("---",) * len(head)]
    for who, own in found.items():
        cells = ["" if own[name] is None else f"{own[name]:.0%}" for name in columns]
        cells[3] += f" ({own['worst_site']})" if own["worst_site"] else ""
        rows.append((who, str(own["chosen"] or own["pictures"]), *cells))
    return rows


def judge_all(options: argparse.Namespace) -> None:
    """Ask all, and tell; DuckpilotError for no such model, or a photograph that is missing."""
    expect_writable(options.json, inputs=options.models)
    found = {
        name: figures(judge(see, options.photographs, options.part))
        for name, see in seers(options.models).items()
    }
    if options.json is not None:
        inputs = {"photographs": str(options.photographs), "part": options.part}
        asked = {**inputs, "models": [str(model) for model in options.models]}
        write_json(options.json, {"inputs": asked, "judged": found})
    for row in as_rows(found):
        print(f"| {' | '.join(row)} |")


def main(arguments: list[str] | None = None) -> int:
    """Exit status 2 for wrong input."""
    parser = OneLineParser(prog="python -m tests.trainer.judge_photographs", description=__doc__)
    parser.add_argument("photographs", type=Path, help="the folder of the sites' folders")
    told = "policies, and sight by its name, .onnx; else the shipped ones"
    parser.add_argument("--models", type=Path, nargs="+", default=SEERS, help=told)
    parser.add_argument("--part", choices=("training", "judging"), default="judging")
    parser.add_argument("--json", type=Path, help="write the figures, site by site")
    options = parser.parse_args(arguments)
    return answer("judge_photographs", lambda: judge_all(options))


if __name__ == "__main__":
    sys.exit(main())
