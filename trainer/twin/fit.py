"""From recordings to a twin: a distribution of Looks that a robot like this one is drawn from."""

import base64
from collections.abc import Sequence
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from scipy.optimize import least_squares

from robot.errors import ConfigError
from robot.geometry import uncompose, wrap_angle
from robot.output import write_text
from robot.recording.drive_file import png
from robot.typed_config import read_yaml
from sim_pybullet.look import NOMINAL, Look, look_from_plain
from sim_pybullet.painting.ground import paint_ground
from sim_pybullet.randomise import LOOKS_DIR, look_sampler
from sim_pybullet.scene import Scene
from sim_pybullet.sensing.sensor import apply_sensor
from trainer.report.page import write_page
from trainer.twin import camera as seen
from trainer.twin import motion as moved
from trainer.twin.colours import Colours, fit_colours, seen_from
from trainer.twin.eye import NAMES, WIDTH, cover_scene
from trainer.twin.recorded import Recorded

KEY_PICTURES, TRACKED = 120, 400
SHOWN = 6  # of the key pictures, on the page
EYE_PIECE_S = 3.0  # of driving, for which the wheels are trusted between poses that the eye told
IN_PIECE, LEAST_TRACKED = 13, 40  # pictures of each piece, and of each drive
LEAST_TOLD = 30  # of these pictures must tell something
NEAR_S = 0.5  # of a told pose: farther away the way is the wheels' alone
LEAST_OBEYED = 0.6  # correlation
LEAST_EXPLAINED = 0.32  # of the key pictures, else the camera is not known
BEGIN_S = 150.0  # of driving, by whose told poses the motors are first known,
ALIKE = 6.0  # so many times less surely than if these did not err alike for seconds
LATE_S = 0.04  # pictures are usually: where they were taken is looked for from there on
_FAIR = 0.7  # of that, a picture must be explained to tell a pose
_FLOOR = np.diag(np.array((3e-3, 3e-3, 8e-3)) ** 2)  # by which seen poses err at least
# How wrong a value may be beyond what its own residuals say, by virtual robots of known looks.
LEAST_SD = {
    **{"height_m": 1.5e-3, "pitch_rad": 5e-3, "roll_rad": 5e-3, "focal_scale": 0.012},
    **{"distortion_scale": 0.05, "centre_right_px": 0.8, "centre_down_px": 0.6},
    **{"forward_m": 4e-3, "left_m": 3e-3, "yaw_rad": 6e-3, "gain": 4e-3, "trim": 1.5e-3},
    **{"turn_gain": 6e-3, "forward_lag_s": 0.02, "turn_lag_s": 0.015},
    **{"delay_s": 0.008, "camera_delay_s": 0.008},
}
_COLOUR_LEVELS = 5.0
_AS_SEEN: dict[str, Any] = {  # light and sensor leave colours as the camera showed them
    "ground.brightness": 1.0,
    "light.elevation_rad": 1.5707,
    "light.ambient": 0.6,
    "light.diffuse": 0.4,
    "light.gloss": {"uniform": [0, 0.2]},
    "sensor.white_balance": [1.0, 1.0, 1.0],
    "sensor.infrared": 0.0,
}
_OUT_OF_SIGHT = ("blur_px", "shutter_s", "jpeg_quality", "grain", "patchiness", "shadows", "wear")
Found = dict[str, tuple[Any, float]]


class Twin(NamedTuple):
    """What a fit found: value and standard deviation by ``group.leaf``; colours are (3,)."""

    found: Found
    unseen: tuple[str, ...]  # sentences: what the drive could not show
    camera: seen.Fitted  # with the poses of the key pictures' eye
    pictures: np.ndarray  # (F, 120, 160, 3) key pictures
    places: tuple[np.ndarray, ...]  # (F, 3) of each drive: where the robot was at its pictures

    @property
    def look(self) -> Look:
        """The likeliest."""
        likeliest = {name: value for name, (value, _) in self.found.items()}
        return look_from_plain(_grouped({"light.elevation_rad": 1.5707, **likeliest}, {}))

    def plain(self) -> dict[str, Any]:
        """As the YAML of a look has it: around what was found, else as wide as ``randomised``."""
        told = dict(_AS_SEEN) if "ground.asphalt_rgb" in self.found else {}
        for name, (value, sd) in self.found.items():
            low, high = np.subtract(value, 2.0 * sd), np.add(value, 2.0 * sd)
            if name.endswith("_rgb"):
                low, high = np.clip(low, 0, 255), np.clip(high, 0, 255)
            elif name.endswith(("_s", "noise", "vignetting", "frame_skip")):
                low = np.maximum(low, 0.0)
            told[name] = {"uniform": [np.round(end, 4).tolist() for end in (low, high)]}
        look = _grouped(told, read_yaml(LOOKS_DIR / "randomised.yaml"))
        look_sampler(look, "twin")
        return look


def _grouped(told: dict[str, Any], look: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """A look with values by ``group.leaf`` put into it."""
    for name, value in told.items():
        group, leaf = name.split(".")
        look.setdefault(group, {})[leaf] = value
    return look


def write_twin(twin: Twin, out: Path) -> None:
    """The look's YAML, with what could not be seen as its head."""
    head = "".join(f"# {line}\n" for line in ("A twin, by duckpilot fit.", *twin.unseen))
    write_text(out, head + yaml.safe_dump(twin.plain(), sort_keys=False, default_flow_style=None))


def twin_pictures(twin: Twin, drive: Recorded) -> np.ndarray:
    """(F, 120, 160, 3) what the twin's camera sees where the key pictures were taken."""
    look = twin.look
    scene = Scene(paint_ground(drive.road_map, look.ground), (), look.sky, look.light)
    drawn = seen_from(scene, twin.camera.values, twin.camera.poses)
    return apply_sensor(drawn, [look.sensor] * len(drawn), np.random.default_rng(0))


def write_twin_page(twin: Twin, drive: Recorded, path: Path) -> None:
    """Recorded pictures beside the twin's, under the table of what was found."""
    both = twin.pictures, twin_pictures(twin, drive)
    chosen = np.linspace(0, len(twin.pictures) - 1, SHOWN).astype(int)
    pairs = [[base64.b64encode(png(some[k])).decode("ascii") for some in both] for k in chosen]
    write_page("twin.html", path, twin=twin, seconds=drive.seconds, pairs=pairs)


def fit_twin(drives: Sequence[Recorded], spread: seen.Spread = map) -> Twin:
    """The twin of the robot, camera and floor of drives; all on one map.

    ConfigError: drives on several maps, or of a robot that did not turn as it was steered.
    """
    if len({drive.map_name for drive in drives}) > 1:
        raise ConfigError("fit: expected recordings of one map, got several")
    told_of = [drive.overhead if len(drive.overhead) else drive.fused for drive in drives]
    above = [moved.from_above(d.commands, told) for d, told in zip(drives, told_of, strict=True)]
    alike = min(map(moved.obeyed, above))
    if alike < LEAST_OBEYED:
        raise ConfigError(
            f"fit: expected a robot that turns as it is steered, got turns {alike:.0%} alike; "
            "is the steering written down the wrong way round?"
        )
    ends_s = np.cumsum([drive.seconds for drive in drives])
    motion = moved.fit_motion(above[: 1 + int(np.searchsorted(ends_s, BEGIN_S))], eye=False)
    above = [moved.surer(told, motion.scale) for told in above]
    ways = [moved.smoothed(told, motion) for told in above]
    near = [moved.at_times(w, d.times_s) for w, d in zip(ways, drives, strict=True)]
    shown = [moved.at_times(w, d.times_s, LATE_S) for w, d in zip(ways, drives, strict=True)]
    images = np.concatenate([drive.images for drive in drives])
    chosen = np.linspace(0, len(images) - 1, KEY_PICTURES).astype(int)
    key = images[chosen], np.concatenate(shown)[chosen], drives[0].road_map
    camera = seen.fit_camera(*key, spread)
    found: Found = {}
    unseen = [f"not seen, as wide as randomised: {', '.join(_OUT_OF_SIGHT)}"]
    known = camera.share >= LEAST_EXPLAINED
    if known:
        told = _tracks(drives, shown, camera, spread)
        motion = moved.fit_motion([*told.values()], True, believed(motion))
        found |= _camera_of(camera, motion)
        scene = cover_scene(drives[0].road_map, float(camera.values[WIDTH]))
        cover = seen_from(scene, camera.values, camera.poses)
        shade = max(0.0, float(camera.values[-1]))
        colours = fit_colours(images[chosen], cover, shade, _still(drives[0]))
        found |= colours_told(colours, camera, unseen)
    else:
        told = dict(enumerate(above))
        unseen.append(f"camera, lens, colours: the map explains {camera.share:.0%} of the pictures")
    found |= _motion_of(drives, told, motion, known, unseen)
    found["timing.frame_skip"] = float(np.mean([drive.skipped for drive in drives])), 0.01
    for name, (value, sd) in found.items():
        found[name] = value, max(sd, LEAST_SD.get(name.split(".")[1], 0.0))
    return Twin(found, tuple(unseen), camera, images[chosen], tuple(near))


def believed(motion: moved.Motion) -> moved.Motion:
    """By overhead poses, of what the eye then tells; its pictures are late, too."""
    values, sd = motion.values.copy(), np.minimum(ALIKE * motion.sd, moved.SPREAD)
    late = moved.NAMES.index("delay_s")
    values[late], sd[late] = values[late] + LATE_S, np.hypot(sd[late], LATE_S)
    return moved.Motion(values, sd)


def _still(drive: Recorded) -> list[np.ndarray]:
    """The first pictures, while nothing was commanded."""
    moves = np.flatnonzero(np.abs(drive.commands).sum(axis=1) > 0.0)
    until_s = (moves[0] if len(moves) else len(drive.commands)) / 30.0
    return list(drive.images[drive.times_s <= until_s])


def _tracks(
    drives: Sequence[Recorded], near: Sequence[np.ndarray], camera: seen.Fitted, spread: seen.Spread
) -> dict[int, moved.Told]:
    """Where the eye was in pictures of the drives, by number, whose pictures tell it."""
    told = {}
    for k, (drive, way) in enumerate(zip(drives, near, strict=True)):
        few = looked_at(drive.times_s, len(drives))
        parts = np.array_split(few, -(-len(few) // seen.PIECE))
        pictures, places = ([all_of[part] for part in parts] for all_of in (drive.images, way))
        how = repeat(drive.road_map), repeat(camera.values), repeat((*seen.AFAR, 1))
        poses, roots, shares = seen.joined(spread(seen.placed, pictures, places, *how))
        fair = shares >= _FAIR * camera.share
        matrices = np.linalg.inv(np.linalg.inv(np.swapaxes(roots, 1, 2) @ roots) + _FLOOR)
        sure = np.swapaxes(np.linalg.cholesky(matrices), 1, 2)
        if fair.sum() >= LEAST_TOLD:
            each = drive.times_s[few][fair], poses[fair], sure[fair]
            told[k] = moved.Told(drive.commands, *each, EYE_PIECE_S)
    return told


def looked_at(times_s: np.ndarray, drives: int) -> np.ndarray:
    """Indices of pictures that tell the motion: close ones, in pieces all over one of the drives.

    The wheels are trusted for a piece only, so pictures far from each other would tell nothing.
    """
    number = (times_s / EYE_PIECE_S).astype(int)
    most = max(TRACKED // drives, LEAST_TRACKED)
    some = np.linspace(0, number[-1], most // IN_PIECE).round().astype(int)
    each = [np.flatnonzero(number == piece) for piece in np.unique(some)]
    share = most // len(each)
    few = [part[np.linspace(0, len(part) - 1, share).astype(int)] for part in each if len(part)]
    return np.unique(np.concatenate(few))


def _camera_of(camera: seen.Fitted, motion: moved.Motion) -> Found:
    # Poses were told by an eye that was taken to sit and look as a nominal one does.
    place = np.array([getattr(NOMINAL.camera, name) for name in moved.EYE])
    values = (*camera.values[:WIDTH], *(place + motion.values[len(moved.NAMES) :]))
    off = (*camera.sd[:WIDTH], *motion.sd[len(moved.NAMES) :])
    each = zip((*NAMES, *moved.EYE), values, off, strict=True)
    return {f"camera.{name}": (float(value), float(sd)) for name, value, sd in each}


def colours_told(colours: Colours, camera: seen.Fitted, unseen: list[str]) -> Found:
    """Of floor and sensor; what was not seen is added to the sentences ``unseen``."""
    # What burns out in the middle of a picture does so in its shaded corners, too.
    light = max([1.0, *(float(rgb.max()) / 255.0 for rgb in colours.rgb.values())])
    found: Found = {"sensor.exposure": (light, 0.035 * light)}
    for kind in ("asphalt", "white", "yellow", "outside"):
        if kind in colours.rgb:
            rgb = np.round(colours.rgb[kind] / light, 1).tolist()
            found[f"ground.{kind}_rgb"] = rgb, _COLOUR_LEVELS / 2.0
        else:
            unseen.append(f"colour of {kind}: too little of it in the pictures")
    unseen.append("white balance and exposure are in the colours, but for what burns out")
    found["ground.line_width_scale"] = float(camera.values[WIDTH]), 0.08
    found["sensor.vignetting"] = max(0.0, float(camera.values[-1])), 0.05
    if colours.noise is None:
        unseen.append("noise: the robot never stood still")
    else:
        found["sensor.noise"] = colours.noise, 0.3
    return found


def _motion_of(
    drives: Sequence[Recorded],
    told: dict[int, moved.Told],
    motion: moved.Motion,
    known: bool,
    unseen: list[str],
) -> Found:
    found: Found = {"drive.acceleration_mps2": (drives[0].acceleration_mps2, 0.0)}
    each = zip(moved.NAMES, motion.values.tolist(), motion.sd.tolist(), moved.SPREAD, strict=False)
    for name, value, sd, spread in each:
        if sd > 0.5 * spread:
            unseen.append(f"{name}: the drive does not tell")
        elif name != "delay_s":
            found[f"drive.{name}"] = value, sd
    total_s = float(motion.values[moved.NAMES.index("delay_s")])
    if not known:
        found["drive.delay_s"] = total_s, 0.02
    elif not told or not all(len(drive.overhead) for drive in drives):
        unseen.append(
            f"delays: without overhead poses only the sum of camera's and motors' is known, "
            f"{1e3 * total_s:.0f} ms"
        )
    else:
        late_s, off_s = camera_delay([drives[k] for k in told], list(told.values()), motion)
        found["timing.camera_delay_s"] = max(late_s, 0.0), off_s
        found["drive.delay_s"] = max(total_s - late_s, 0.0), off_s
    return found


def camera_delay(
    drives: Sequence[Recorded], told: Sequence[moved.Told], motion: moved.Motion
) -> tuple[float, float]:
    """How late pictures are after overhead poses [s], and its standard deviation.

    By headings alone: places also hang on how fast the robot was.
    """
    eye = motion.values[None, len(moved.NAMES) :]
    axles = [each._replace(poses=uncompose(each.poses, eye)) for each in told]
    ways = [moved.smoothed(axle, motion)[:, 2] for axle in axles]
    overhead = []
    for drive, each in zip(drives, told, strict=True):
        away_s = np.abs(drive.overhead[:, :1] - each.times_s).min(axis=1)
        overhead.append(drive.overhead[away_s < NEAR_S])
    spread = np.array((0.1, 0.02))  # of delay, and of what the eye's heading is wrong by

    def off(guess: np.ndarray, keep: float = 0.0) -> np.ndarray:
        rows = []
        for poses, way in zip(overhead, ways, strict=True):
            grid_s = np.arange(len(way)) * moved.PHYSICS_DT_S
            late_rad = np.interp(poses[:, 0] + guess[0], grid_s, way)
            missed = np.asarray(wrap_angle(poses[:, 3] - late_rad - guess[1]))
            rows.append(missed[1:] - keep ** (np.diff(poses[:, 0]) / 0.1) * missed[:-1])
        return np.concatenate(rows)

    guess, keep = np.array((0.03, 0.0)), 0.0
    for _ in range(3):  # errors of poses last: what is left of one is taken off the next
        left = off(guess, keep)
        scale = 1.4826 * float(np.median(np.abs(left))) + 1e-6

        def cost(guess: np.ndarray, keep: float = keep, scale: float = scale) -> np.ndarray:
            return np.concatenate((off(guess, keep) / scale, guess / spread))

        found = least_squares(cost, guess, x_scale=spread, loss="soft_l1", diff_step=1e-2)
        guess, left = found.x, np.clip(off(found.x), -0.3, 0.3)
        keep = float(np.clip((left[1:] * left[:-1]).sum() / (left**2).sum(), 0.0, 0.98))
    return float(guess[0]), float(np.sqrt(np.linalg.inv(found.jac.T @ found.jac)[0, 0]))
