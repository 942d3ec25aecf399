"""How often `trainer.judging.yellow_line` tells the right side of the line, over simulated frames.

    python -m tools.yellow_line --frames 10000 --json runs/yellow_line.json

Poses are drawn evenly along a ring of road, to both sides of its yellow line, headings within 30
degrees of the line's. Left out are frames with no line found (their share is stated, and how many
of them show any of it) and those whose judged point lies within 1 cm of the line.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

from robot.command_line import SEED, OneLineParser, answer
from robot.errors import ConfigError
from robot.output import expect_writable, write_json


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = OneLineParser(
        prog="python -m tools.yellow_line", description=__doc__.splitlines()[0] if __doc__ else None
    )
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--map", default="loop")
    parser.add_argument("--look", type=Path, help="YAML file of a Look; nominal by default")
    parser.add_argument("--seed", type=SEED, default=0)
    parser.add_argument("--json", type=Path, help="file to write")
    options = parser.parse_args(arguments)

    def work() -> None:
        from sim_pybullet.look import NOMINAL, load_look
        from tools.yellow_truth import measure

        if options.frames < 1:
            raise ConfigError(f"--frames: expected 1 or more, got {options.frames}")
        expect_writable(options.json, inputs=[options.look])
        look = load_look(options.look) if options.look else NOMINAL
        result = measure(options.map, look, options.frames, options.seed)
        inputs = {key: str(value) for key, value in vars(options).items() if value is not None}
        figures = {"schema": 1, "inputs": inputs, **asdict(result)}
        print(json.dumps(figures, indent=2))
        if options.json:
            write_json(options.json, figures)

    return answer("tools.yellow_line", work)


if __name__ == "__main__":
    sys.exit(main())
