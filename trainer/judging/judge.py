"""What ``evaluate`` does."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from rich.console import Console
from rich.table import Table

from robot.errors import ConfigError
from robot.navigation.road_map import RoadMap
from robot.output import expect_writable, write_json
from robot.typed_config import read_json, to_plain
from robot.vision.sight import OnnxSight
from sim_pybullet.batch import DriveMetrics
from sim_pybullet.sensing.guidance_feed import PoseSources
from sim_pybullet.tasks.spec import find_task
from trainer.division import part_of, refuse_like_named
from trainer.judging.blocks import drive_blocks, kept_beside
from trainer.judging.evaluate import Drive, Evaluation, Ride, open_policy, ridden, summarise
from trainer.judging.films import Scene, films_of, keep_films
from trainer.options import EvaluateOptions


@dataclass(frozen=True)
class Missions:
    """An evaluation, see `trainer.judging.blocks.Order`; which episodes is told apart."""

    asked: EvaluateOptions  # filled in
    films: bool  # of those that failed or left their lane

    @property
    def files(self) -> list[str]:
        """See `trainer.judging.blocks.Order`."""
        asked = self.asked
        named = (asked.model, asked.translate, asked.sight, asked.look, *asked.map)
        return [name for name in named if name]

    def drive(self, seeds: Sequence[int]) -> Iterator[tuple[Drive, Scene | None]]:
        """See `trainer.judging.blocks.Order`."""
        asked, spec = self.asked, find_task(self.asked.task)
        looks = spec.looks(asked.look, asked.pose_error, asked.without)
        where = asked.task, list(map(spec.load, asked.map)), looks, seeds
        sources = PoseSources(asked.overhead, OnnxSight(asked.sight) if asked.sight else None)
        how = asked.zero, asked.lane, sources, self.films
        policy = open_policy(asked.model, asked.task, asked.translate)
        for drive, ride in ridden(policy, *where, *how):
            yield drive, _scene(drive, ride) if self.films else None


def judge(
    out: Path | None, options: EvaluateOptions, films: bool, workers: int | None, console: Console
) -> int:
    """Drive, write the figures to ``out``, if any, and say how it went; the exit status.

    ``films``: whether to film the worst beside ``out``; ``workers``: processes, else one a core.
    """
    expect_writable(out, inputs=[Path(options.model)])
    policy = open_policy(options.model, options.task, options.translate)
    asked = options.filled_in(policy.contract.task)
    places = list(map(find_task(asked.task).load, asked.map))
    refuse_like_named(places)
    parts = {place.name: part_of(place) for place in places if isinstance(place, RoadMap)}
    known = sha256(Path(asked.model).read_bytes()).hexdigest()
    order = Missions(replace(asked, episodes=0, seed=0), films)
    seeds = range(asked.seed, asked.seed + asked.episodes)
    title = f"{asked.task} {Path(asked.model).name}"
    with kept_beside(out, console) as folder:
        rows, worst = drive_blocks(order, title, seeds, folder, workers, console)
        drives = [Drive(*row)._replace(metrics=DriveMetrics(*row[2])) for row in rows]
        result = replace(summarise(asked, policy, drives, parts), model_sha256=known)
        if out is not None:
            write_json(out, {**to_plain(result), "inputs": asked.plain()})
            if films:
                keep_films(worst, *films_of(out))
    _tell(console, result)
    return 0


def answers(file: Path, options: EvaluateOptions) -> bool:
    """True: the JSON file answers what is asked; ConfigError if it answers something else."""
    found = read_json(file).get("inputs")
    found = {"lane": None, **found} if isinstance(found, dict) else {}  # once no choice
    task = found.get("task")
    if not task or found != options.filled_in(task).plain():
        raise ConfigError(
            f"{file}: expected the evaluation asked for, got another one; choose another --json"
        )
    return True


def _scene(drive: Drive, ride: Ride) -> Scene | None:
    """What failed, or left its lane."""
    failed = not drive.success
    if not failed and ride.farthest_m <= ride.half_lane_m:
        return None
    film = tuple(ride.frames) if failed else ride.farthest
    told = ride.end if failed else "out of its lane for a while"
    title = f"Episode {drive.seed} on {drive.map} - {told}"
    return (failed, ride.farthest_m, -drive.seed), title, film


def _tell(console: Console, result: Evaluation) -> None:
    asked = result.inputs
    console.print(
        f"{asked.model}: success {result.success_rate:.1%} of {result.episodes} (at least "
        f"{result.success_rate_low:.1%} with 95 % confidence), "
        f"{100 * result.mean_path_distance_m:.1f} cm from the path"
    )
    if len(result.by_map) > 1:
        columns = ("map", "lane", "kept for", "succeeded", "from the path")
        table = Table(*columns, title=f"look {asked.look}")
        for row in result.by_map:
            succeeded = f"{row.succeeded} of {row.episodes}"
            from_path = f"{100 * row.mean_path_distance_m:.1f} cm"
            table.add_row(row.map, row.lane or "-", row.part or "nothing", succeeded, from_path)
        console.print(table)
    if result.laps is not None:
        console.print(
            f"{result.laps:.2f} laps, {result.collisions} collisions, "
            f"{result.mean_speed_mps:.1f} m/s on average"
        )
