"""Solids as rows of numbers; compiled geometry of one that is seen along many rays.

That is in the robot's axes, from the camera.
"""

import math

import numpy as np
from numba import njit

from sim_pybullet.look import LightLook
from sim_pybullet.rendering.rays import AZIMUTHS, ELEVATIONS
from sim_pybullet.scene import Solid

# Columns of a row: position, heading, half extents (a cylinder has no width: its length is all),
# underside and top [m], whether it is a cylinder, looks.
X, Y, COS, SIN, HALF_LENGTH, HALF_WIDTH, BASE, TOP, ROUND, KIND, RED, GREEN, BLUE = range(13)

NO_HIT = 1e9
Outline = tuple[float, float, float, float]  # azimuth, half its spread, lowest, highest [rad]
_FAST = {"contract", "arcp", "nsz", "reassoc"}  # not nnan, ninf: a ray may be level with a face


def solid_rows(solids: tuple[Solid, ...]) -> np.ndarray:
    """(K, 13) float64, one row per solid in the world frame."""
    rows = []
    for each in solids:
        place = each.x_m, each.y_m, math.cos(each.heading_rad), math.sin(each.heading_rad)
        half = 0.5 * each.size_m[0], 0.5 * each.size_m[1] * (each.shape == "box")
        ends = each.base_m, each.base_m + each.size_m[2]
        rows.append((*place, *half, *ends, each.shape == "cylinder", int(each.kind), *each.rgb))
    return np.array(rows, dtype=np.float64).reshape(len(solids), 13)


def light_row(light: LightLook) -> np.ndarray:
    """(5,): unit vector to the light in the world frame, ambient and diffuse share."""
    level = math.cos(light.elevation_rad)
    direction = (level * math.cos(light.azimuth_rad), level * math.sin(light.azimuth_rad))
    return np.array((*direction, math.sin(light.elevation_rad), light.ambient, light.diffuse))


@njit(cache=True)
def place_movers(
    rows: np.ndarray, last: np.ndarray, parts: np.ndarray, owners: np.ndarray, poses: np.ndarray
) -> None:
    """Append the parts of what moves to what stands around M robots.

    ``rows`` (R, 13), of robot i up to last[i] (M,), which moves on; ``parts`` (D, 13) about the
    origins of the movers that ``owners`` (D,) names; ``poses`` (M, U, 3) of these, not finite where
    one is not there.
    """
    for i in range(len(poses)):
        for k in range(len(parts)):
            x, y, heading = poses[i, owners[k]]
            if math.isfinite(x):
                part, row = parts[k], rows[last[i]]
                c, s = math.cos(heading), math.sin(heading)
                row[:] = part
                row[X], row[Y] = x + c * part[X] - s * part[Y], y + s * part[X] + c * part[Y]
                row[COS] = c * part[COS] - s * part[SIN]
                row[SIN] = s * part[COS] + c * part[SIN]
                last[i] += 1


@njit(cache=True)
def to_camera(row: np.ndarray, pose: np.ndarray, eye: np.ndarray, out: np.ndarray) -> None:
    """A world row as the camera has it: relative to the eye (3,), axes of the robot."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = row[X] - pose[0], row[Y] - pose[1]
    for k in range(len(row)):
        out[k] = row[k]
    out[X] = c * dx + s * dy - eye[0]
    out[Y] = c * dy - s * dx - eye[1]
    out[COS] = c * row[COS] + s * row[SIN]
    out[SIN] = c * row[SIN] - s * row[COS]
    out[BASE] -= eye[2]
    out[TOP] -= eye[2]


@njit(cache=True)
def outline(row: np.ndarray, margin_rad: float) -> Outline:
    """The directions that enclose the solid as seen from the camera, wider by a margin."""
    distance = math.hypot(row[X], row[Y])
    radius = math.hypot(row[HALF_LENGTH], row[HALF_WIDTH])
    if distance < radius + 1e-6:
        return 0.0, math.pi, -0.5 * math.pi, 0.5 * math.pi
    near, far = distance - radius, distance + radius
    low = math.atan2(row[BASE], near if row[BASE] < 0.0 else far)
    high = math.atan2(row[TOP], near if row[TOP] > 0.0 else far)
    # A pixel near straight down or up is wider in azimuth than on the horizon.
    level = max(1e-3, math.cos(max(abs(low), abs(high))))
    spread = math.asin(radius / distance) + margin_rad / level
    return math.atan2(row[Y], row[X]), min(spread, math.pi), low - margin_rad, high + margin_rad


@njit(cache=True)
def pixel_box(around: Outline, cells: np.ndarray, box: np.ndarray) -> bool:
    """Whether any pixel looks into an outline.

    Writes the first and last row, first and last column of those that do into ``box`` (4,).
    """
    azimuth, spread, low, high = around
    first_azimuth = math.floor(((azimuth - spread) / math.pi + 1.0) * (AZIMUTHS // 2))
    last_azimuth = math.floor(((azimuth + spread) / math.pi + 1.0) * (AZIMUTHS // 2))
    first_elevation = max(0, int((low / math.pi + 0.5) * ELEVATIONS))
    last_elevation = min(ELEVATIONS - 1, int((high / math.pi + 0.5) * ELEVATIONS))
    box[0] = box[2] = 1 << 30
    box[1] = box[3] = -1
    for i in range(first_azimuth, min(last_azimuth, first_azimuth + AZIMUTHS - 1) + 1):
        for j in range(first_elevation, last_elevation + 1):
            cell = cells[i % AZIMUTHS, j]
            box[0], box[1] = min(box[0], cell[0]), max(box[1], cell[1])
            box[2], box[3] = min(box[2], cell[2]), max(box[3], cell[3])
    return box[0] <= box[1]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def meet_box(
    row: np.ndarray,
    colours: np.ndarray,
    rays: np.ndarray,
    depth: np.ndarray,
    seen: np.ndarray,
    first: int,
    last: int,
) -> None:
    """Put a box where it is the nearest along its rays: slabs, Kay and Kajiya 1986.

    Of ``rays`` (3, R) float32 those from first to last - 1 are tried. ``depth`` (R,) float32 and
    what is ``seen`` there, uint32, change where the box is nearer. ``colours`` (3,) are those of
    the faces across its height, its length and its width.
    """
    one = np.float32(1.0)
    c, s = np.float32(row[COS]), np.float32(row[SIN])
    x = np.float32(row[COS] * row[X] + row[SIN] * row[Y])
    y = np.float32(row[COS] * row[Y] - row[SIN] * row[X])
    half_x, half_y = np.float32(row[HALF_LENGTH]), np.float32(row[HALF_WIDTH])
    base, top = np.float32(row[BASE]), np.float32(row[TOP])
    cap, front, flank = colours
    rx, ry, rz = rays[0, first:last], rays[1, first:last], rays[2, first:last]
    near, shown = depth[first:last], seen[first:last]
    for k in range(len(near)):
        along_x, along_y = one / (c * rx[k] + s * ry[k]), one / (c * ry[k] - s * rx[k])
        along_z = one / rz[k]
        x0, x1 = (x - half_x) * along_x, (x + half_x) * along_x
        y0, y1 = (y - half_y) * along_y, (y + half_y) * along_y
        z0, z1 = base * along_z, top * along_z
        into_x, into_y, into_z = min(x0, x1), min(y0, y1), min(z0, z1)
        enter = max(into_x, into_y, into_z)
        leave = min(max(x0, x1), max(y0, y1), max(z0, z1))
        nearest = (enter > 0.0) & (enter <= leave) & (enter < near[k])
        colour = cap if enter == into_z else (front if enter == into_x else flank)
        near[k] = enter if nearest else near[k]
        shown[k] = colour if nearest else shown[k]


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def meet_cylinder(
    row: np.ndarray,
    light: np.ndarray,
    colours: np.ndarray,
    rays: np.ndarray,
    depth: np.ndarray,
    seen: np.ndarray,
    first: int,
    last: int,
) -> None:
    """As ``meet_box``; ``colours[0]`` is the cap's, the side is lit by its normal.

    A ``light`` of no strength (ambient and diffuse 0) gives the side the cap's.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    x, y, radius = np.float32(row[X]), np.float32(row[Y]), np.float32(row[HALF_LENGTH])
    outside = np.float32(row[X] ** 2 + row[Y] ** 2 - row[HALF_LENGTH] ** 2)
    base, top = np.float32(row[BASE]), np.float32(row[TOP])
    light_x, light_y = np.float32(light[0]) / radius, np.float32(light[1]) / radius
    ambient, diffuse = np.float32(light[3]), np.float32(light[4])
    red, green, blue = np.float32(row[RED]), np.float32(row[GREEN]), np.float32(row[BLUE])
    dark, cap = ambient + diffuse == 0.0, colours[0]
    rx, ry, rz = rays[0, first:last], rays[1, first:last], rays[2, first:last]
    near, shown = depth[first:last], seen[first:last]
    for k in range(len(near)):
        dx, dy = rx[k], ry[k]
        per_level = one / max(dx * dx + dy * dy, np.float32(1e-12))
        middle = (x * dx + y * dy) * per_level
        root = middle * middle - outside * per_level
        half = math.sqrt(max(root, zero))
        along_z = one / rz[k]
        z0, z1 = base * along_z, top * along_z
        into_z = min(z0, z1)
        enter = max(middle - half, into_z)
        leave = min(middle + half, max(z0, z1))
        nearest = (root > 0.0) & (enter > 0.0) & (enter <= leave) & (enter < near[k])
        facing = (enter * dx - x) * light_x + (enter * dy - y) * light_y
        colour = pack(red, green, blue, ambient + diffuse * max(zero, facing))
        colour = cap if (enter == into_z) | dark else colour
        near[k] = enter if nearest else near[k]
        shown[k] = colour if nearest else shown[k]


@njit(inline="always")
def pack(red: np.float32, green: np.float32, blue: np.float32, shade: np.float32) -> np.uint32:
    """A colour under a shade as red, green << 8 and blue << 16."""
    half, high = np.float32(0.5), np.float32(255.0)
    r = np.uint32(np.int32(min(red * shade + half, high)))
    g = np.uint32(np.int32(min(green * shade + half, high)))
    b = np.uint32(np.int32(min(blue * shade + half, high)))
    return r | g << np.uint32(8) | b << np.uint32(16)


@njit(cache=True)
def face_colours(row: np.ndarray, light: np.ndarray, colours: np.ndarray) -> None:
    """Lambert colours of the faces that the camera can see, as ``meet_box`` wants them."""
    c, s = row[COS], row[SIN]
    up = 1.0 if row[TOP] < 0.0 else -1.0
    ahead = -math.copysign(1.0, c * row[X] + s * row[Y])
    left = -math.copysign(1.0, c * row[Y] - s * row[X])
    to_front, to_flank = c * light[0] + s * light[1], c * light[1] - s * light[0]
    red, green, blue = np.float32(row[RED]), np.float32(row[GREEN]), np.float32(row[BLUE])
    for k, cosine in enumerate((up * light[2], ahead * to_front, left * to_flank)):
        shade = np.float32(light[3] + light[4] * max(0.0, cosine))
        colours[k] = pack(red, green, blue, shade)
