"""Triangles of floor and solids for a renderer that draws meshes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_pybullet.scene import Ground, Solid

SIDES = 48  # of the prism that stands for a cylinder
FAR_M = 200.0  # how far the floor beyond the map is drawn


class Mesh(NamedTuple):
    """Counter-clockwise triangles: vertices and normals (V, 3), texture (V, 2), faces (F, 3)."""

    vertices: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray
    faces: np.ndarray


def floor_mesh(ground: Ground) -> Mesh:
    """The floor's picture as one rectangle; u runs east, v north."""
    height, width = ground.classes.shape
    east, south = ground.west_m + width * ground.texel_m, ground.north_m - height * ground.texel_m
    corners = [(ground.west_m, south), (east, south), (east, ground.north_m)]
    corners.append((ground.west_m, ground.north_m))
    uvs = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    return _level([np.array(corners)], uvs)


def outside_mesh(ground: Ground) -> Mesh:
    """The floor around the picture, out to ``FAR_M``."""
    height, width = ground.classes.shape
    east, south = ground.west_m + width * ground.texel_m, ground.north_m - height * ground.texel_m
    x = (ground.west_m - FAR_M, ground.west_m, east, east + FAR_M)
    y = (south - FAR_M, south, ground.north_m, ground.north_m + FAR_M)
    pieces = []
    for left, right, low, high in ((0, 3, 0, 1), (0, 1, 1, 2), (2, 3, 1, 2), (0, 3, 2, 3)):
        corners = [(x[left], y[low]), (x[right], y[low]), (x[right], y[high]), (x[left], y[high])]
        pieces.append(np.array(corners))
    return _level(pieces, np.zeros((16, 2)))


def solid_mesh(solid: Solid) -> Mesh:
    """A solid about its own footpoint: x along its heading, z = 0 at its underside."""
    length, width, height = solid.size_m
    if solid.shape == "cylinder":
        return _prism(0.5 * length, height)
    if solid.shape == "billboard":
        return _faces([_face((1.0, 0.0, 0.0), (0.0, 0.5 * width, 0.5 * height), height)])
    half = (0.5 * length, 0.5 * width, 0.5 * height)
    axes = np.concatenate((np.eye(3), -np.eye(3)))
    return _faces([_face(tuple(axis), half, height) for axis in axes])


def _level(pieces: list[np.ndarray], uvs: np.ndarray) -> Mesh:
    corners = np.concatenate(pieces)
    vertices = np.column_stack((corners, np.zeros(len(corners))))
    normals = np.tile((0.0, 0.0, 1.0), (len(corners), 1))
    faces = np.concatenate([_QUAD + 4 * k for k in range(len(pieces))])
    return Mesh(vertices, normals, uvs, faces)


_QUAD = np.array([(0, 1, 2), (0, 2, 3)])


def _face(normal: tuple[float, ...], half: tuple[float, float, float], height: float) -> np.ndarray:
    """Four corners and their normal, (4, 6), of the side of a box that looks along an axis."""
    n = np.array(normal)
    first = np.roll(np.abs(n), 1) * np.array(half)
    second = np.cross(n, first / max(np.linalg.norm(first), 1e-12))
    second = second * np.array(half)
    middle = n * np.array(half) + (0.0, 0.0, 0.5 * height)
    corners = [middle + a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.column_stack((np.array(corners), np.tile(n, (4, 1))))


def _faces(faces: list[np.ndarray]) -> Mesh:
    corners = np.concatenate(faces)
    triangles = np.concatenate([_QUAD + 4 * k for k in range(len(faces))])
    return Mesh(corners[:, :3], corners[:, 3:], np.zeros((len(corners), 2)), triangles)


def _prism(radius: float, height: float) -> Mesh:
    angles = np.arange(SIDES) * (2.0 * math.pi / SIDES)
    round_ = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(SIDES)))
    foot, head = radius * round_, radius * round_ + (0.0, 0.0, height)
    up = np.tile((0.0, 0.0, 1.0), (SIDES, 1))
    i, j = np.arange(SIDES), np.roll(np.arange(SIDES), -1)
    side = np.concatenate(
        (np.column_stack((i, j, j + SIDES)), np.column_stack((i, j + SIDES, i + SIDES)))
    )
    fan = np.column_stack((np.zeros(SIDES - 2, int), i[1:-1], i[2:]))
    return Mesh(
        np.concatenate((foot, head, head, foot)),
        np.concatenate((round_, round_, up, -up)),
        np.zeros((4 * SIDES, 2)),
        np.concatenate((side, fan + 2 * SIDES, fan[:, ::-1] + 3 * SIDES)),
    )
