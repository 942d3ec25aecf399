"""``judge``: a driver in a challenge of the AI Driving Olympics; imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from robot.errors import ConfigError
from robot.output import expect_writable

if TYPE_CHECKING:
    from trainer.judging.drivers import Driver

_RINGS = ("judging/rings",)
MAPS = {"lf": _RINGS, "lfp": _RINGS, "lfv": _RINGS, "lfvi": ("town",)}
BARE = "bare"


def judge_command(
    model: str,
    challenge: Literal["lf", "lfp", "lfv", "lfvi"] = "lf",
    against: str | None = None,
    episodes: int = 100,
    seed: int = 1000,
    look: str = "nominal",
    map: tuple[str, ...] = (),
    poses: Literal["true", "arena", "sight"] = "true",
    seconds: float = 60.0,
    json: Path | None = None,
    out: Path | None = None,
) -> int:
    """Drive a challenge of the AI Driving Olympics, and tell its measures.

    Args:
        model: a policy, .onnx, under the rules of the road; or expert, who knows the truth; or
            stand, who never moves.
        challenge: lf, lane following; lfp, among ducks; lfv, among cars; lfvi, eight robots of ours
            with junctions.
        against: another driver, on the same episodes; bare is the policy without rules.
        episodes: how many.
        seed: of the first episode; the next ones have the next seeds.
        look: a YAML file with a look or a distribution of looks, or a shipped name.
        map: map files, or shipped names or folders; else the rings kept for judging, with
            junctions town.
        poses: what the rules of the road know of everybody: the truth of now; what a localizer
            over the arena tells, late and 3 cm off; or what sight sees of the way ahead.
        seconds: how long an episode is; the Olympics' are a minute.
        json: write the figures there.
        out: a folder for a page with films of the worst episodes.
    """
    from robot.navigation.road_map import load_map
    from robot.output import write_json
    from sim_pybullet.randomise import load_look_sampler
    from trainer.division import maps_named
    from trainer.judging.challenge import drive, robots_of
    from trainer.judging.films import Worst
    from trainer.judging.olympics import Verdict, tell, write_worst

    names = [model] if against is None else [model, against]
    drivers = [_driver(name, model, poses, challenge) for name in names]
    expect_writable(json, inputs=[Path(name) for name in names if Path(name).is_file()])
    road_maps = [load_map(name) for name in maps_named(map or MAPS[challenge])]
    looks, seeds = load_look_sampler(look), range(seed, seed + episodes)
    console, worst, films = Console(soft_wrap=True), Worst(), out is not None
    verdicts: list[Verdict] = []
    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), console=console) as bar:
        for name, driver in zip(names, drivers, strict=True):
            title, total = f"{challenge} {Path(name).name}", episodes * robots_of(challenge)
            row, found = bar.add_task(title, total=total), []
            for episode, film in drive(driver, challenge, road_maps, looks, seeds, seconds, films):
                bar.advance(row)
                found.append(episode)
                if not verdicts:
                    title = f"Episode {episode.seed} on {episode.map} - {episode.end}"
                    worst.add(episode.badness, f"{title} - {episode.tiles:.1f} tiles", film)
            verdicts.append(Verdict(Path(name).name, sorted(found)))
    tell(console, challenge, verdicts)
    if json is not None:
        asked = {"challenge": challenge, "episodes": episodes, "seed": seed, "look": look}
        driven = {"poses": poses, "seconds": seconds, "maps": [m.name for m in road_maps]}
        told = {**asked, **driven, **verdicts[0].plain()}
        if len(verdicts) > 1:
            told["against"] = verdicts[0].against(verdicts[1])
        write_json(json, told)
    if out is not None:
        console.print(str(write_worst(out, worst, verdicts[0], challenge)), markup=False)
    return 0


def _driver(name: str, model: str, poses: str, challenge: str) -> Driver:
    from robot.vision.sight import OnnxSight
    from trainer.judging.drivers import Driver, Expert, Pilot
    from trainer.judging.evaluate import open_policy
    from trainer.judging.governed import Governed
    from trainer.judging.sighted import Sighted
    from trainer.sight.cli import SHIPPED

    if poses == "sight" and challenge == "lfvi":
        raise ConfigError(
            "poses: expected true or arena, got sight, which does not tell who comes from the sides"
        )
    if name in ("expert", "stand"):
        return Expert() if name == "expert" else Driver()
    bare = name == BARE and name != model
    path = Path(model if bare else name)
    if not path.exists():
        raise ConfigError(f"{path}: expected a policy, .onnx, expert or stand; there is no file")
    policy = open_policy(path)
    if poses == "sight" and not bare:
        return Sighted(policy, OnnxSight(SHIPPED))
    return Pilot(policy) if bare else Governed(policy, poses)
