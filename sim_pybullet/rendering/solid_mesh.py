"""Triangles of floor and solids for a renderer that draws meshes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_pybullet.scene import Ground, Solid

SIDES = 48  # of the prism that stands for a cylinder
FAR_M = 200.0  # how far the floor beyond the map is drawn
_QUAD = np.array([(0, 1, 2), (0, 2, 3)])
_UP = np.array((0.0, 0.0, 1.0))


class Mesh(NamedTuple):
    """Counter-clockwise triangles: vertices and normals (V, 3), texture (V, 2), faces (F, 3)."""

    vertices: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray
    faces: np.ndarray


def floor_mesh(ground: Ground) -> Mesh:
    """The floor's picture as one rectangle; u runs east, v north."""
    west, south, east, north = _edges(ground)
    mesh = _quads([_level(west, south, east, north)], [_UP])
    return mesh._replace(uvs=np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]))


def outside_mesh(ground: Ground) -> Mesh:
    """The floor around the picture, out to ``FAR_M``."""
    west, south, east, north = _edges(ground)
    x, y = (west - FAR_M, west, east, east + FAR_M), (south - FAR_M, south, north, north + FAR_M)
    around = ((0, 3, 0, 1), (0, 1, 1, 2), (2, 3, 1, 2), (0, 3, 2, 3))
    return _quads([_level(x[a], y[c], x[b], y[d]) for a, b, c, d in around], [_UP] * 4)


def solid_mesh(solid: Solid) -> Mesh:
    """A solid about its own footpoint: x along its heading, z = 0 at its underside."""
    length, width, height = solid.size_m
    if solid.shape == "cylinder":
        return _prism(0.5 * length, height)
    half = np.array((0.5 * length, 0.5 * width, 0.5 * height))
    normals = np.concatenate((np.eye(3), -np.eye(3)))
    return _quads([_side(normal, half) for normal in normals], normals)


def _edges(ground: Ground) -> tuple[float, float, float, float]:
    """West, south, east and north [m]."""
    height, width = ground.classes.shape
    east, south = ground.west_m + width * ground.texel_m, ground.north_m - height * ground.texel_m
    return ground.west_m, south, east, ground.north_m


def _level(west: float, south: float, east: float, north: float) -> np.ndarray:
    return np.array([(west, south, 0), (east, south, 0), (east, north, 0), (west, north, 0)])


def _side(normal: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Four corners (4, 3) of the side of a box that looks along an axis."""
    first = np.roll(np.abs(normal), 1) * half
    second = np.cross(normal, np.roll(np.abs(normal), 1)) * half
    middle = normal * half + half * _UP
    return np.array(
        [middle + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


def _quads(corners: list[np.ndarray], normals: list[np.ndarray] | np.ndarray) -> Mesh:
    """Rectangles (4, 3) and their normals (3,)."""
    vertices = np.concatenate(corners)
    faces = np.concatenate([_QUAD + 4 * k for k in range(len(corners))])
    return Mesh(vertices, np.repeat(normals, 4, axis=0), np.zeros((len(vertices), 2)), faces)


def _prism(radius: float, height: float) -> Mesh:
    angles = np.arange(SIDES) * (2.0 * math.pi / SIDES)
    round_ = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(SIDES)))
    foot, head, up = radius * round_, radius * round_ + height * _UP, np.tile(_UP, (SIDES, 1))
    i, j = np.arange(SIDES), np.roll(np.arange(SIDES), -1)
    side = np.concatenate((np.stack((i, j, j + SIDES), 1), np.stack((i, j + SIDES, i + SIDES), 1)))
    fan = np.column_stack((np.zeros(SIDES - 2, int), i[1:-1], i[2:]))
    return Mesh(
        np.concatenate((foot, head, head, foot)),
        np.concatenate((round_, round_, up, -up)),
        np.zeros((4 * SIDES, 2)),
        np.concatenate((side, fan + 2 * SIDES, fan[:, ::-1] + 3 * SIDES)),
    )
