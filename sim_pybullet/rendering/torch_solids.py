"""Solids met by rays on a device of torch: the geometry of `solid_geometry`, all pixels at once."""

import numpy as np
import torch

from sim_pybullet.rendering.solid_geometry import (
    BASE,
    BLUE,
    COS,
    HALF_LENGTH,
    HALF_WIDTH,
    RED,
    SIN,
    TOP,
    X,
    Y,
)

UNSEEN = 1 << 62  # where no solid was met; else depth's bits << 24 | colour, the nearest the least
Met = tuple[torch.Tensor, torch.Tensor, torch.Tensor]  # whether, depth and colour, (Q, 4) each
_SPREAD = 0.125  # of neighbours' difference: a quarter of a pixel


def sub_rays(directions: np.ndarray) -> np.ndarray:
    """The four rays (3, 4, H W) float32 of each pixel, from their middles (3, H, W)."""
    padded = np.pad(directions, ((0, 0), (1, 1), (1, 1)), mode="edge")
    across = _SPREAD * (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2])
    down = _SPREAD * (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1])
    rays = [directions + a * across + b * down for b in (-1, 1) for a in (-1, 1)]
    return np.stack(rays, axis=1).reshape(3, 4, -1).astype(np.float32)


class SolidPixels:
    """The Q pixels that M solids may be seen in, one solid's after the other's, and their rays.

    Args:
        rays: (S, 3, 4, P), see `sub_rays`; ``width`` pixels make a row.
        where: (M, 2) the picture that each solid is in, and the slot of its rays.
        boxes: (M, 4) as `solid_geometry.pixel_box`.
    """

    def __init__(
        self, rays: torch.Tensor, width: int, where: torch.Tensor, boxes: torch.Tensor
    ) -> None:
        columns = boxes[:, 3] + 1 - boxes[:, 2]
        counts = (boxes[:, 1] + 1 - boxes[:, 0]) * columns
        self.solid = torch.arange(len(boxes), device=boxes.device).repeat_interleave(counts)
        k = torch.arange(len(self.solid), device=boxes.device)
        k -= (counts.cumsum(0) - counts)[self.solid]
        row, column = k // columns[self.solid], k % columns[self.solid]
        pixel = (boxes[self.solid, 0] + row) * width + boxes[self.solid, 2] + column
        picture, slot = where[self.solid].T
        ray = torch.arange(4, device=boxes.device)
        self._at = (4 * picture[:, None] + ray) * rays.shape[-1] + pixel[:, None]
        self.x, self.y, self.z = rays[slot, :, :, pixel].unbind(1)  # (Q, 4) each

    def of(self, *values: torch.Tensor) -> list[torch.Tensor]:
        """Values (M,) of the solids as (Q, 1) float32 of their pixels."""
        return [value.float()[self.solid, None] for value in values]

    def slab(
        self, low: torch.Tensor, high: torch.Tensor, along: torch.Tensor
    ) -> list[torch.Tensor]:
        """Where rays, by their component across two planes, enter and leave the space between."""
        a, b = low / along, high / along
        return [a.minimum(b), a.maximum(b)]

    def put(self, nearest: torch.Tensor, met: Met) -> None:
        """Keep in ``nearest`` (N 4 P,) int64 what is met, where it is the nearest."""
        there, depth, colour = met
        keys = depth.view(torch.int32).long() << 24 | colour
        keys = torch.where(there, keys, UNSEEN)
        nearest.scatter_reduce_(0, self._at.ravel(), keys.ravel(), "amin")


def meet_boxes(
    pixels: SolidPixels, rows: torch.Tensor, colours: torch.Tensor, _lights: torch.Tensor
) -> Met:
    """`solid_geometry.meet_box` for M boxes.

    ``rows`` (M, 13) as `to_camera` leaves them, ``colours`` (M, 3) as of `face_colours`.
    """
    row = rows.T
    c, s, x, y, half_x, half_y, base, top = pixels.of(
        row[COS],
        row[SIN],
        row[COS] * row[X] + row[SIN] * row[Y],
        row[COS] * row[Y] - row[SIN] * row[X],
        *(row[k] for k in (HALF_LENGTH, HALF_WIDTH, BASE, TOP)),
    )
    into_x, out_x = pixels.slab(x - half_x, x + half_x, c * pixels.x + s * pixels.y)
    into_y, out_y = pixels.slab(y - half_y, y + half_y, c * pixels.y - s * pixels.x)
    into_z, out_z = pixels.slab(base, top, pixels.z)
    enter = into_x.maximum(into_y).maximum(into_z)
    leave = out_x.minimum(out_y).minimum(out_z)
    cap, front, flank = colours[pixels.solid, :, None].unbind(1)
    colour = torch.where(enter == into_z, cap, torch.where(enter == into_x, front, flank))
    return (enter > 0.0) & (enter <= leave), enter, colour


def meet_cylinders(
    pixels: SolidPixels, rows: torch.Tensor, colours: torch.Tensor, lights: torch.Tensor
) -> Met:
    """`solid_geometry.meet_cylinder` likewise, under lights (M, 5) in the robots' axes."""
    row, light = rows.T, lights.T
    x, y, outside, base, top, light_x, light_y, ambient, diffuse = pixels.of(
        row[X],
        row[Y],
        row[X] ** 2 + row[Y] ** 2 - row[HALF_LENGTH] ** 2,
        row[BASE],
        row[TOP],
        light[0] / row[HALF_LENGTH],
        light[1] / row[HALF_LENGTH],
        *light[3:],
    )
    per_level = 1.0 / (pixels.x**2 + pixels.y**2).clamp(min=1e-12)
    middle = (x * pixels.x + y * pixels.y) * per_level
    root = middle**2 - outside * per_level
    half = root.clamp(min=0.0).sqrt()
    into_z, out_z = pixels.slab(base, top, pixels.z)
    enter, leave = (middle - half).maximum(into_z), (middle + half).minimum(out_z)
    facing = (enter * pixels.x - x) * light_x + (enter * pixels.y - y) * light_y
    shade = (ambient + diffuse * facing.clamp(min=0.0))[..., None]
    rgb = (rows[:, RED : BLUE + 1].float()[pixels.solid, None] * shade + 0.5).clamp(0.0, 255.0)
    red, green, blue = rgb.nan_to_num().long().unbind(-1)
    side = red | green << 8 | blue << 16
    colour = torch.where(enter == into_z, colours[pixels.solid, :1], side)
    return (root > 0.0) & (enter > 0.0) & (enter <= leave), enter, colour
