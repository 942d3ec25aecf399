"""``Scenario``: who else is on the road, by the names of duckietown-world's scenario files."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from robot.errors import ConfigError, nearest
from robot.typed_config import from_plain, read_yaml

SCENARIOS_FOLDER = Path(__file__).parents[1] / "scenarios"
Range = tuple[float, float]
# Of duckietown-world's files, and nothing to us: maps are chosen elsewhere, trees bar no road.
_NOT_OURS = "map_name dist_tol_m tree_density tree_min_dist pc_robot_protocol npc_robot_protocol"


@dataclass(frozen=True)
class Scenario:
    """Robots and ducks of one world; everything random about them is drawn anew per episode.

    Names down to ``duckie_y_bounds`` are duckietown-world's; the rest says how they behave. Ranges
    are drawn from evenly.
    """

    robots_pcs: tuple[str, ...] = ("ego",)  # ours
    robots_npcs: tuple[str, ...] = ()  # driven by the simulator
    robots_parked: tuple[str, ...] = ()  # stand in a lane
    min_dist: float = 0.5  # between robots at the start [m]
    theta_tol_deg: float = 10.0  # robots begin askew by at most so much,
    delta_y_m: float = 0.03  # and so far from the middle of the lane
    only_straight: bool = True  # and on straight tiles
    nduckies: int = 0
    duckie_min_dist_from_other_duckie: float = 0.3
    duckie_min_dist_from_robot: float = 0.4
    duckie_y_bounds: Range = (-0.2, -0.17)  # of one that stands: left of the lane's middle [m]
    walking: int = 0  # so many of the ducks cross the road and come back
    duckie_speed_mps: Range = (0.05, 0.15)
    duckie_wait_s: Range = (3.0, 20.0)  # before each crossing
    npc_speed_mps: Range = (0.1, 0.2)
    npc_headway_s: Range = (1.0, 2.0)  # temper: to whatever is ahead
    npc_obeying: float = 1.0  # share that stop at junctions, for red lights and who has the way
    npc_mistakes_per_min: float = 0.0  # of each: for a second it looks at nothing

    def __post_init__(self) -> None:
        counts_fit = len(self.robots_pcs) > 0 and 0 <= self.walking <= self.nduckies
        ranges = [getattr(self, f.name) for f in fields(self) if f.type == Range]
        sizes = [f.name for f in fields(self) if f.type in (int, float, Range)]
        below = any(np.min(getattr(self, n)) < 0.0 for n in sizes if n != "duckie_y_bounds")
        if not counts_fit or below or any(low > high for low, high in ranges):
            raise ConfigError(
                "scenario: expected at least one of robots_pcs, no more walking than nduckies, "
                f"ranges from low to high, and only duckie_y_bounds below 0, got {self}"
            )


def load_scenario(source: str | Path) -> Scenario:
    """A file, or the name of a shipped scenario; ConfigError for others or what cannot be read."""
    shipped = {path.stem: path for path in SCENARIOS_FOLDER.glob("*.yaml")}
    path = shipped.get(str(source), Path(source))
    if not path.is_file():
        told = nearest(str(source), shipped)
        raise ConfigError(f"{source}: expected a scenario file or a shipped scenario; {told}")
    plain = read_yaml(path)
    for name in _NOT_OURS.split() if isinstance(plain, dict) else ():
        plain.pop(name, None)
    return from_plain(Scenario, plain, where=str(path))
