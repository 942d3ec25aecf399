"""Solids by PyTorch: every pixel that may show a solid is tried against it, all in one list."""

from __future__ import annotations

from typing import NamedTuple

import torch

from sim_pybullet.rendering import solid_table as column
from sim_pybullet.rendering.solid_table import CYLINDER

NOTHING = 1e9  # depth where no solid is


class Candidates(NamedTuple):
    """M solids, each in sight of one robot, as ``solid_kernel.gather_in_sight`` finds them.

    ``rows`` (M, 13) float32 in the camera's axes, ``colours`` (M, 3) int32 of the faces across
    height, length and width, ``robots`` (M,), ``boxes`` (M, 4) int64, ``lights`` (N, 5) float32.
    """

    rows: torch.Tensor
    colours: torch.Tensor
    robots: torch.Tensor
    boxes: torch.Tensor
    lights: torch.Tensor


class Seen(NamedTuple):
    """The nearest solid along each ray: ``depth`` and ``colour``, both (N * P * samples,)."""

    depth: torch.Tensor
    colour: torch.Tensor


def meet_solids(
    candidates: Candidates,
    rays: torch.Tensor,
    slots: torch.Tensor,
    width: int,
    side_lit: bool,
) -> Seen:
    """Find what is nearest along ``rays`` (S, samples, 3, P) of robots that use ``slots`` (N,).

    ``side_lit``: light a cylinder's side by its normal, or leave it in the first colour.
    """
    samples, pixels = rays.shape[1], rays.shape[3]
    solid, pixel = _tried(candidates.boxes, width)
    robot = candidates.robots[solid]
    d = rays[slots[robot], :, :, pixel]  # (K, samples, 3)
    row, faces = candidates.rows[solid], candidates.colours[solid]
    box = row[:, column.SHAPE] != CYLINDER
    light = candidates.lights[robot] if side_lit else None
    at_box, at_drum = _meet_box(row, faces, d), _meet_cylinder(row, faces, d, light)
    depth = torch.where(box[:, None], at_box.depth, at_drum.depth)
    colour = torch.where(box[:, None], at_box.colour, at_drum.colour)
    place = (robot * pixels + pixel)[:, None] * samples
    place = place + torch.arange(samples, device=rays.device)
    count = len(slots) * pixels * samples
    nearest = depth.new_full((count,), NOTHING)
    nearest.scatter_reduce_(0, place.flatten(), depth.flatten(), "amin")
    winner = (depth < NOTHING) & (depth == nearest[place])
    shown = colour.new_zeros((count,))
    shown[place[winner]] = colour[winner]
    return Seen(nearest, shown)


def blend_solids(pictures: torch.Tensor, seen: Seen) -> torch.Tensor:
    """Mix what four rays per pixel met with what is behind it, (N, P, 3) int32."""
    colour = seen.colour.reshape(*pictures.shape[:2], 4, 1)
    met = (seen.depth < NOTHING).reshape(colour.shape)
    rgb = torch.cat([colour >> shift & 255 for shift in (0, 8, 16)], dim=-1)
    return (torch.where(met, rgb, pictures[:, :, None]).sum(dim=2) + 2) >> 2


def _tried(boxes: torch.Tensor, width: int) -> tuple[torch.Tensor, torch.Tensor]:
    """All pixels of all boxes in one list: which solid, which pixel."""
    wide = boxes[:, 3] - boxes[:, 2] + 1
    counts = (boxes[:, 1] - boxes[:, 0] + 1) * wide
    solid = torch.repeat_interleave(torch.arange(len(boxes), device=boxes.device), counts)
    first = torch.cumsum(counts, 0) - counts
    k = torch.arange(len(solid), device=boxes.device) - first[solid]
    wide, box = wide[solid], boxes[solid]
    return solid, (box[:, 0] + k // wide) * width + box[:, 2] + k % wide


def _meet_box(row: torch.Tensor, faces: torch.Tensor, d: torch.Tensor) -> Seen:
    c, s = row[:, column.COS, None], row[:, column.SIN, None]
    x0, y0 = row[:, column.X, None], row[:, column.Y, None]
    x, y = c * x0 + s * y0, c * y0 - s * x0
    along_x = 1.0 / (c * d[..., 0] + s * d[..., 1])
    along_y = 1.0 / (c * d[..., 1] - s * d[..., 0])
    along_z = 1.0 / d[..., 2]
    half_x, half_y = row[:, column.HALF_LENGTH, None], row[:, column.HALF_WIDTH, None]
    into_x, out_x = _slab((x - half_x) * along_x, (x + half_x) * along_x)
    into_y, out_y = _slab((y - half_y) * along_y, (y + half_y) * along_y)
    into_z, out_z = _slab(row[:, column.BASE, None] * along_z, row[:, column.TOP, None] * along_z)
    enter = into_x.maximum(into_y).maximum(into_z)
    leave = out_x.minimum(out_y).minimum(out_z)
    side = torch.where(enter == into_x, faces[:, 1, None], faces[:, 2, None])
    colour = torch.where(enter == into_z, faces[:, 0, None], side)
    return Seen(torch.where((enter > 0.0) & (enter <= leave), enter, NOTHING), colour)


def _meet_cylinder(
    row: torch.Tensor, faces: torch.Tensor, d: torch.Tensor, light: torch.Tensor | None
) -> Seen:
    x, y = row[:, column.X, None], row[:, column.Y, None]
    radius = row[:, column.HALF_LENGTH, None]
    dx, dy = d[..., 0], d[..., 1]
    per_level = 1.0 / (dx * dx + dy * dy).clamp(min=1e-12)
    middle = (x * dx + y * dy) * per_level
    root = middle * middle - (x * x + y * y - radius * radius) * per_level
    half = root.clamp(min=0.0).sqrt()
    along_z = 1.0 / d[..., 2]
    into_z, out_z = _slab(row[:, column.BASE, None] * along_z, row[:, column.TOP, None] * along_z)
    enter, leave = (middle - half).maximum(into_z), (middle + half).minimum(out_z)
    colour = faces[:, 0, None].expand(enter.shape)
    if light is not None:
        facing = (enter * dx - x) * light[:, 0, None] + (enter * dy - y) * light[:, 1, None]
        shade = light[:, 3, None] + light[:, 4, None] * (facing / radius).clamp(min=0.0)
        channels = (column.RED, column.GREEN, column.BLUE)
        r, g, b = ((row[:, k, None] * shade + 0.5).clamp(max=255.0).int() for k in channels)
        colour = torch.where(enter == into_z, colour, r | g << 8 | b << 16)
    hit = (root > 0.0) & (enter > 0.0) & (enter <= leave)
    return Seen(torch.where(hit, enter, NOTHING), colour)


def _slab(first: torch.Tensor, second: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return first.minimum(second), first.maximum(second)
