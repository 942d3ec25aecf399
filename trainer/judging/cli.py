"""``judge``: a driver in a challenge of the AI Driving Olympics; imports nothing heavy."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from robot.errors import expect_between


@dataclass(frozen=True)
class JudgeOptions:
    """Who drives, where, and how often."""

    # A policy, .onnx, under the rules of the road; or expert, who knows the truth; or stand, who
    # never moves.
    model: str
    # lf, lane following; lfp, among ducks; lfv, among cars; lfvi, eight robots of ours with
    # junctions.
    challenge: Literal["lf", "lfp", "lfv", "lfvi"] = "lf"
    # Another driver, on the same episodes; bare is the policy without rules.
    against: str | None = None
    episodes: int = 100  # How many.
    seed: int = 1000  # Of the first episode; the next ones have the next seeds.
    look: str = "nominal"  # A YAML file with a look or a distribution of looks, or a shipped name.
    # Map files, or shipped names or folders; else the rings kept for judging, with junctions town.
    map: tuple[str, ...] = ()
    # What the rules of the road know of everybody: the truth of now; what a localizer over the
    # arena tells, late and 3 cm off; or what sight sees of the way ahead.
    poses: Literal["true", "arena", "sight"] = "true"
    seconds: float = 60.0  # How long an episode is; the Olympics' are a minute.

    def __post_init__(self) -> None:
        expect_between("seconds", self.seconds, 0.1, 1e6)


def judge_command(
    options: Annotated[JudgeOptions, tyro.conf.arg(name="")],
    workers: int | None = None,
    json: Path | None = None,
    out: Path | None = None,
) -> int:
    """Drive a challenge of the AI Driving Olympics, and tell its measures.

    Args:
        workers: processes, else one for each core; the figures are the same.
        json: write the figures there.
        out: a folder for a page with films of the worst episodes.
    """
    from robot.navigation.road_map import load_map
    from robot.output import write_json
    from sim_pybullet.randomise import load_look_sampler
    from sim_pybullet.traffic.scenario import load_scenario
    from trainer.division import maps_named, refuse_like_named
    from trainer.judging.blocks import drive_blocks, kept_beside
    from trainer.judging.challenge import Contest
    from trainer.judging.olympics import Episode, LaneFigures, Verdict, tell, write_worst

    challenge, seeds = options.challenge, range(options.seed, options.seed + options.episodes)
    names = [name for name in (options.model, options.against) if name is not None]
    maps = maps_named(options.map or ("town" if challenge == "lfvi" else "judging/rings",))
    asked = replace(options, map=maps, against=None, episodes=0, seed=0)
    contests = [Contest(n, asked, films=not k and out is not None) for k, n in enumerate(names)]
    for contest in contests:
        contest.driver()
    road_maps, console = [load_map(name) for name in maps], Console(soft_wrap=True)
    load_look_sampler(options.look)
    refuse_like_named(road_maps)
    verdicts, worst = [], []
    with kept_beside(json or (out and out / "judge.html"), console) as folder:
        for contest in contests:
            name, group = Path(contest.name).name, len(load_scenario(challenge).robots_pcs)
            how = f"{challenge} {name}", seeds, folder, workers, console, group
            rows, films = drive_blocks(contest, *how)
            found = [Episode(*row)._replace(figures=LaneFigures(*row[-1])) for row in rows]
            verdicts.append(Verdict(name, found))
            worst += films
        tell(console, challenge, verdicts)
        if json is not None:
            told: dict[str, Any] = {**vars(options), "maps": [each.name for each in road_maps]}
            told |= verdicts[0].plain()
            del told["map"]
            if len(verdicts) > 1:
                told["against"] = verdicts[0].against(verdicts[1])
            write_json(json, told)
        if out is not None:
            console.print(str(write_worst(out, worst, verdicts[0], challenge)), markup=False)
    return 0
