"""What moving code must not change: figures, curves and pictures recorded bit for bit.

``python -m tests.golden record`` writes ``tests/golden/golden.json`` and ``check`` compares with
it; names of cases after that choose some. Another processor may round otherwise: record where you
change, then change, then check. A case is a command as a person types it, and what it left behind
without times and paths. Not part of `make test`.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
GOLDEN = HERE / "golden.json"
ALONE = ("--seed", "3", "--workers", "1")
TIMED = {"seconds", "cpu_seconds", "cpu_s", "wall_s", "versions", "commit", "command"}
TIMED |= {"model", "model_sha256"}  # the model is compared itself


def digest(value: object) -> str:
    """A short name for a value, of arrays by their bytes."""
    given = value.tobytes() if isinstance(value, np.ndarray) else json.dumps(value, sort_keys=True)
    return hashlib.sha256(given if isinstance(given, bytes) else given.encode()).hexdigest()[:16]


def without_times(value: Any) -> Any:
    """A JSON value without what differs between two runs of the same program."""
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in TIMED}
    return [without_times(each) for each in value] if isinstance(value, list) else value


def command(*words: str) -> None:
    """Run a command of ours from the repository's folder, in one thread."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, env=env, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: status {done.returncode}\n{done.stderr[-2000:]}")


def evaluation(model: str, *options: str) -> Callable[[Path], object]:
    """A shipped policy's figures over four episodes."""

    def case(folder: Path) -> object:
        out = folder / "figures.json"
        words = ("--model", f"robot/models/{model}.onnx", "--episodes", "4", "--seed", "1000")
        command("-m", "trainer", "evaluate", *words, *options, "--json", str(out))
        return without_times(json.loads(out.read_text()))

    return case


def training(task: str, algorithm: str, *options: str) -> Callable[[Path], object]:
    """The first 2,000 decisions of a training: its curve, and the weights at the end."""

    def case(folder: Path) -> object:
        out = folder / "run"
        words = ("--task", task, "--algo", algorithm, "--preset", "fast", "--steps", "2000")
        command("-m", "trainer", "train", *words, *options, *ALONE, "--out", str(out))
        with (out / "progress.csv").open() as file:
            read = csv.DictReader(file)
            rows = [[value for key, value in row.items() if "second" not in key] for row in read]
        config = yaml.safe_load((out / "config.yaml").read_text())
        weights = (out / "model.onnx").read_bytes()
        return {"rows": digest(rows), "count": len(rows), "config": config, "onnx": len(weights)}

    return case


def pictures(_: Path) -> object:
    """Four robots' pictures along 20 steps, by the ray camera's batch and by one environment."""
    import gymnasium

    import sim_pybullet  # noqa: F401  registers the environments

    found = {}
    for name in ("duckpilot/LaneKeepingRandomised-v0", "duckpilot/NavigationArenaPose-v0"):
        env = gymnasium.make(name)
        seen, _ = env.reset(seed=5)
        drawn = [_bytes(seen)]
        for step in range(20):
            seen, reward, *_ = env.step(step % int(env.action_space.n))  # type: ignore[attr-defined]
            drawn.append([_bytes(seen), round(float(reward), 9)])
        found[name] = digest(drawn)
    return found


def golden_drive(_: Path) -> object:
    """The recorded drive decides again as it did."""
    command("-m", "tools.replay", "tests/data/golden_drive.mcap")
    return "again"


def _bytes(seen: Any) -> object:
    if isinstance(seen, dict):
        return {key: digest(np.asarray(value)) for key, value in sorted(seen.items())}
    return digest(np.asarray(seen))


CASES: dict[str, Callable[[Path], object]] = {
    "lane_dueling": evaluation("lane_dueling"),
    "lane_dueling_rings": evaluation(
        "lane_dueling", "--map", "judging/rings/zed", "--lane", "both", "--look", "randomised"
    ),
    "lane_ppo": evaluation("lane_ppo"),
    "nav_dueling": evaluation("nav_dueling", "--look", "randomised", "--pose-error", "arena"),
    "nav_ppo": evaluation("nav_ppo", "--map", "town", "--look", "reality"),
    "track_a3c": evaluation("track_a3c"),
    "train_lane_dueling": training("lane", "dueling"),
    "train_lane_a2c": training("lane", "a2c"),
    "train_lane_dagger": training("lane", "dagger"),
    "train_nav_ppo": training("navigation", "ppo", "--look", "randomised"),
    "train_nav_ddqn": training("navigation", "ddqn"),
    "train_track_ppo": training("track", "ppo"),
    "pictures": pictures,
    "drive": golden_drive,
}


def found(names: Iterable[str]) -> dict[str, object]:
    """What the cases give today."""
    result: dict[str, object] = {}
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            result[name] = CASES[name](Path(folder))
        print(f"{name} {digest(result[name])}", flush=True)
    return result


def main() -> int:
    """Record or check; status 1 where something differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.add_argument("what", choices=("record", "check"))
    parser.add_argument("case", nargs="*", choices=[[], *CASES], default=[])
    args = parser.parse_args()
    now = found(args.case or CASES)
    before = json.loads(GOLDEN.read_text()) if GOLDEN.exists() else {}
    if args.what == "record":
        GOLDEN.write_text(json.dumps({**before, **now}, indent=1, sort_keys=True) + "\n")
        return 0
    differ = [name for name in now if json.loads(json.dumps(now[name])) != before.get(name)]
    print(f"changed: {', '.join(differ)}" if differ else f"{len(now)} of {len(now)} as before")
    return 1 if differ else 0


if __name__ == "__main__":
    raise SystemExit(main())
