"""``Look``: everything about appearance and physics that can vary, as one frozen dataclass.

Colours are (r, g, b) in 0..255. A Look is read from and written to YAML; randomisation
(`sim_pybullet.randomise`) samples Looks and nothing else does.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import Annotated, Literal, get_type_hints

from robot.contract import FRAME_WIDTH_PX
from robot.errors import ConfigError
from robot.lens import DUCKIEBOT_LENS, CameraRig, Mount
from robot.typed_config import from_plain

# Kinds of numbers with the limits beyond which they cannot be, or leave a camera nothing to see.
Rgb = Annotated[tuple[float, float, float], (0.0, 255.0)]
Share = Annotated[float, (0.0, 1.0)]
Seconds = Annotated[float, (0.0, 10.0)]
Gain = Annotated[float, (0.01, 10.0)]
Strength = Annotated[float, (0.0, 10.0)]
Greys = Annotated[float, (0.0, 255.0)]
Count = Annotated[int, (0, 100)]
_ANY = (-1e9, 1e9)


@dataclass(frozen=True)
class GroundLook:
    """The painted floor."""

    asphalt_rgb: Rgb = (46.0, 46.0, 50.0)
    white_rgb: Rgb = (224.0, 224.0, 218.0)
    yellow_rgb: Rgb = (224.0, 184.0, 44.0)
    red_rgb: Rgb = (196.0, 40.0, 40.0)
    outside_rgb: Rgb = (96.0, 108.0, 92.0)  # floor, grass and whatever lies beyond the map
    grain: Greys = 6.0  # standard deviation of the surface noise, grey levels
    seam_depth: float = 14.0  # how much darker the joints of the foam mats are, grey levels
    wear: Share = 0.0  # 0 new paint .. 1 half of it gone
    gaps: Share = 0.0  # of the lines, in stretches of some 20 cm: lines that end
    line_width_scale: Annotated[float, (0.1, 5.0)] = 1.0
    brightness: Strength = 1.0  # multiplies the whole floor
    patchiness: Share = 0.0  # strength of large soft light and dark areas, 0..1
    shadows: Share = 0.0  # how dark the shadows of window bars, furniture and people are, 0..1
    texture_seed: Annotated[int, (0, 1e9)] = 0
    # The second shares no code with the first: floors to judge policies on, see `docs/looks.md`.
    painter: Literal["tiles", "strips"] = "tiles"

    @property
    def beyond_rgb(self) -> Rgb:
        """``outside_rgb``, as bright as the rest."""
        red, green, blue = (min(255.0, self.brightness * value) for value in self.outside_rgb)
        return red, green, blue


@dataclass(frozen=True)
class TrackLook:
    """What a race track has that a road of foam mats has not; the rest is in GroundLook."""

    grass_rgb: Rgb = (82.0, 118.0, 62.0)  # beside the road; beyond the walls is outside_rgb
    kerb_rgb: Rgb = (190.0, 36.0, 36.0)
    kerb_2_rgb: Rgb = (228.0, 228.0, 224.0)
    wall_rgb: Rgb = (172.0, 172.0, 176.0)
    wall_2_rgb: Rgb = (150.0, 150.0, 156.0)
    wall_height_m: Annotated[float, (0.0, 100.0)] = 1.0  # in metres of the real track
    dashes_m: Annotated[float, (0.1, 1000.0)] = 10.0  # period of the yellow middle, real metres


@dataclass(frozen=True)
class SkyLook:
    """What is above the horizon."""

    horizon_rgb: Rgb = (176.0, 200.0, 220.0)
    zenith_rgb: Rgb = (115.0, 209.0, 255.0)


@dataclass(frozen=True)
class LightLook:
    """One far light and an ambient part; a floor lit from straight above has intensity 1."""

    azimuth_rad: float = 0.8
    elevation_rad: float = 1.2
    ambient: Strength = 0.6
    diffuse: Strength = 0.4
    gloss: Share = 0.0  # how much of the light the floor mirrors: a bright spot on the road, 0..1
    gloss_width_rad: Annotated[float, (1e-3, math.pi)] = 0.15  # radius of that spot


@dataclass(frozen=True)
class ClutterLook:
    """What stands around the road; nothing that a robot could meet."""

    boxes: Count = 0
    people: Count = 0
    things: Count = 0  # ducks, signs, robots and legs, on the road and beside it


@dataclass(frozen=True)
class CameraLook(Mount):
    """How this robot's camera is mounted, and how its lens differs from the nominal one."""

    height_m: Annotated[float, (0.01, 1.0)] = Mount.height_m
    pitch_rad: Annotated[float, (-0.5 * math.pi, 0.5 * math.pi)] = Mount.pitch_rad
    focal_scale: Annotated[float, (0.2, 5.0)] = 1.0  # below 1 it sees more
    distortion_scale: Annotated[float, (-2.0, 2.0)] = 1.0
    centre_right_px: float = 0.0  # the lens's axis from the nominal one, in a 160 px wide frame
    centre_down_px: float = 0.0


@dataclass(frozen=True)
class SensorLook:
    """What happens to the light after the lens, in this order."""

    shutter_s: Share = 0.0  # exposure time: what turns meanwhile is smeared
    blur_px: Annotated[float, (0.0, 50.0)] = 0.0  # standard deviation, in a 160 px wide frame
    infrared: Share = 0.0  # share of the light that a sensor without filter takes for pale pink
    vignetting: Share = 0.0  # darkening at the corners, 0..1
    exposure: Annotated[float, (0.0, 20.0)] = 1.0
    white_balance: Annotated[tuple[float, float, float], (0.0, 20.0)] = (1.0, 1.0, 1.0)  # gains
    noise: Greys = 0.0  # standard deviation, grey levels
    jpeg_quality: Annotated[int, (1, 100)] = 100  # 100 is no compression


@dataclass(frozen=True)
class DriveLook:
    """How the wheels answer a command."""

    forward_lag_s: Seconds = 0.08  # first-order time constants; steppers follow almost at once
    turn_lag_s: Seconds = 0.08
    delay_s: Seconds = 0.0  # between command and wheel
    gain: Gain = 1.0  # of both wheels
    trim: Annotated[float, (-1.0, 1.0)] = 0.0  # right wheel gains this, left loses it
    turn_gain: Gain = 1.0  # part of the commanded turn rate that the tyres turn into turning
    noise: Share = 0.02  # standard deviation of each wheel's speed, relative
    acceleration_mps2: Annotated[float, (0.01, 1e6)] = 1e6  # of rims: the driver's ramp


@dataclass(frozen=True)
class TimingLook:
    """When pictures arrive."""

    camera_delay_s: Seconds = 0.0
    frame_skip: Share = 0.0  # probability that a decision sees the previous picture again


@dataclass(frozen=True)
class PoseLook:
    """Error of the poses that the overhead localizer sends."""

    position_m: Annotated[float, (0.0, 100.0)] = 0.0  # standard deviation of each coordinate
    heading_rad: Annotated[float, (0.0, math.pi)] = 0.0
    correlation_s: Annotated[float, (1e-3, 1e6)] = 2.0  # time constant of Ornstein-Uhlenbeck
    delay_s: Seconds = 0.0
    dropout_per_s: Annotated[float, (0.0, 100.0)] = 0.0  # rate at which gaps begin
    dropout_s: Annotated[float, (0.0, 1e6)] = 0.0  # longest gap
    outlier: Share = 0.0  # probability that a pose is wrong by up to a metre


@dataclass(frozen=True)
class Look:
    """One world as one robot meets it in one episode."""

    ground: GroundLook = GroundLook()
    track: TrackLook = TrackLook()
    sky: SkyLook = SkyLook()
    light: LightLook = LightLook()
    clutter: ClutterLook = ClutterLook()
    camera: CameraLook = CameraLook()
    sensor: SensorLook = SensorLook()
    drive: DriveLook = DriveLook()
    timing: TimingLook = TimingLook()
    pose: PoseLook = PoseLook()

    def rig(self) -> CameraRig:
        """This Look's camera: the nominal lens on this mounting, with these scales."""
        c, lens = self.camera, DUCKIEBOT_LENS
        changed = replace(
            lens,
            fx_px=lens.fx_px * c.focal_scale,
            fy_px=lens.fy_px * c.focal_scale,
            cx_px=lens.cx_px + c.centre_right_px * lens.width_px / FRAME_WIDTH_PX,
            cy_px=lens.cy_px + c.centre_down_px * lens.width_px / FRAME_WIDTH_PX,
            distortion=tuple(k * c.distortion_scale for k in lens.distortion),
        )
        mount = Mount(**{each.name: getattr(c, each.name) for each in fields(Mount)})
        return CameraRig(changed, mount)


NOMINAL = Look()

# What an overhead camera over the arena delivers (specification row A10).
ARENA_POSE = PoseLook(
    position_m=0.03,
    heading_rad=math.radians(5.0),
    delay_s=0.2,
    dropout_per_s=0.05,
    dropout_s=1.0,
    outlier=0.005,
)

POSE_ERRORS = {"none": PoseLook(), "arena": ARENA_POSE}


def look_from_plain(data: object) -> Look:
    """A Look from plain nested data, as YAML gives it; ConfigError beyond its limits."""
    look = from_plain(Look, data, where="look")
    for name in get_type_hints(Look):
        group = getattr(look, name)
        for leaf, kind in get_type_hints(type(group), include_extras=True).items():
            value, (low, high) = getattr(group, leaf), getattr(kind, "__metadata__", [_ANY])[0]
            for number in value if isinstance(value, tuple) else (value,):
                if not isinstance(number, str) and not low <= number <= high:
                    expected = f"expected {low:g} to {high:g}, got {number:g}"
                    raise ConfigError(f"look.{name}.{leaf}: {expected}")
    return look
