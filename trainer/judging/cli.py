"""``judge``: a driver in a challenge of the AI Driving Olympics; imports nothing heavy."""

from pathlib import Path
from typing import Literal

from rich.console import Console

from robot.output import expect_writable

_RINGS = ("judging/rings",)
MAPS = {"lf": _RINGS, "lfp": _RINGS, "lfv": _RINGS, "lfvi": ("town",)}


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
    workers: int | None = None,
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
        workers: processes, else one for each core; the figures are the same.
        json: write the figures there.
        out: a folder for a page with films of the worst episodes.
    """
    from robot.navigation.road_map import load_map
    from robot.output import write_json
    from sim_pybullet.randomise import load_look_sampler
    from trainer.division import maps_named
    from trainer.judging.blocks import drive_blocks, kept_beside
    from trainer.judging.challenge import Contest, robots_of
    from trainer.judging.olympics import Episode, LaneFigures, Verdict, tell, write_worst

    names = [model] if against is None else [model, against]
    maps, seeds = maps_named(map or MAPS[challenge]), range(seed, seed + episodes)
    shared = model, challenge, maps, look, poses, seconds
    contests = [Contest(n, *shared, films=not k and out is not None) for k, n in enumerate(names)]
    for contest in contests:
        contest.driver()
    expect_writable(json, inputs=[Path(name) for name in names if Path(name).is_file()])
    road_maps, console = [load_map(name) for name in maps], Console(soft_wrap=True)
    load_look_sampler(look)
    verdicts, worst = [], []
    with kept_beside(json or (out and out / "judge.html"), console) as folder:
        for contest in contests:
            group = robots_of(challenge)
            rows, films = drive_blocks(contest, seeds, folder, workers, console, group)
            found = [Episode(*row)._replace(figures=LaneFigures(*row[-1])) for row in rows]
            verdicts.append(Verdict(Path(contest.name).name, found))
            worst += films
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
