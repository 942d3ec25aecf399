"""What one small network sees in a picture: lane, red line, junction, what is in the way.

Each figure comes with its own standard deviation (Nix and Weigend, Estimating the mean and variance
of the target probability distribution, ICNN 1994). Frames and signs are those of
`robot.navigation.lane_view`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Callable, NamedTuple, Optional, Tuple, Union

import numpy as np

from robot.camera.source import Frame
from robot.contract import ImageSpec, InFile
from robot.errors import ContractError
from robot.inference.network_file import FLOATS, Network, Tensor
from robot.inference.preprocess import preprocess
from robot.navigation.lane_view import KINDS

FIGURES = ("offset_m", "heading_rad", "curvature_pm", "line_m", "free_m")
DEVIATIONS = tuple(f"sd_{name}" for name in FIGURES)
JUNCTIONS = tuple(f"junction_{kind}" for kind in KINDS)
COLUMNS = (*FIGURES, *DEVIATIONS, "line", "road", "thing", *JUNCTIONS)
LANE_M = 0.17  # to the left of the middle of a lane; the oncoming one's is at 0.23
REMEDY = "make one with duckpilot train-sight"


class Seen(NamedTuple):
    """What N pictures show; probabilities lie in [0, 1]."""

    figures: np.ndarray  # (N, 5), as `FIGURES`
    deviations: np.ndarray  # (N, 5) their standard deviations
    line: np.ndarray  # (N,) probability that a red line lies 12 to 45 cm before the axle
    road: np.ndarray  # (N,) probability that the robot looks along its lane, or the oncoming one
    junction: np.ndarray  # (N, 5) probability of each of `robot.navigation.lane_view.KINDS` ahead
    thing: np.ndarray  # (N,) probability of something on the own lane within 50 cm of the nose

    @property
    def in_lane(self) -> np.ndarray:
        """(N,) whether it rather stands in its lane: who was turned round sees the oncoming one."""
        return np.asarray((self.road > 0.5) & (self.figures[:, 0] <= LANE_M))


@dataclass(frozen=True)
class SightContract(InFile):
    """ONNX input: ``image`` uint8 (N, H, W, 3) RGB. Output: ``seen`` float32 (N, columns)."""

    image: ImageSpec
    columns: Tuple[str, ...] = COLUMNS
    run: str = ""
    trained_steps: int = 0
    schema: int = 1

    METADATA_KEY = "duckpilot-sight"


class OnnxSight(Network[SightContract]):
    """The network from its ONNX file; ContractError as of `Network`, or it sees something else."""

    def __init__(self, path: Union[str, Path]) -> None:
        super().__init__(path, SightContract, REMEDY)
        if self.contract.columns != COLUMNS:
            told = f"{', '.join(self.contract.columns)}; {REMEDY}"
            raise ContractError(f"{path}: expected the columns {', '.join(COLUMNS)}, got {told}")
        self.expect(self.contract.image.shape, Tensor("seen", FLOATS, (None, len(COLUMNS))))

    def __call__(self, pictures: np.ndarray) -> Seen:
        """What pictures (N, H, W, 3) of ``preprocess`` show; ContractError: other ones, or NaN."""
        rows = self.answer(pictures)
        if not np.isfinite(rows).all():
            raise ContractError(f"{self.path}: expected finite figures, got others; {REMEDY}")
        return as_seen(rows)


def as_seen(rows: np.ndarray) -> Seen:
    """A network's answer (N, 18), as `COLUMNS`."""
    told, count = np.asarray(rows, float), len(FIGURES)
    rest = 2 * count
    line, road, thing = told[:, rest : rest + 3].T
    return Seen(told[:, :count], told[:, count:rest], line, road, told[:, rest + 3 :], thing)


class Glimpse:
    """How a robot looks around: asks ``sight`` once about each picture of a camera's ``read``."""

    def __init__(self, sight: OnnxSight, newest: Callable[[], Optional[Frame]]) -> None:
        self.sight, self._newest = sight, newest
        self._seen: Optional[int] = None  # number of the newest frame that was looked at

    def look(self) -> Optional[Tuple[Seen, float]]:
        """What a new picture shows, and when that came [s]; None while there is none."""
        frame = self._newest()
        if frame is None or frame.sequence == self._seen:
            return None
        self._seen = frame.sequence
        return self.sight(preprocess(frame.image, self.sight.contract.image)[None]), frame.time_s
