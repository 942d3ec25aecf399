"""``TorchCamera``: a `RayCamera` whose pictures are drawn, and stay, on a device of torch."""

import numpy as np
import torch

from robot.contract import ImageSpec
from robot.lens import CameraRig
from sim_pybullet.rendering.mip_texture import mip_texture
from sim_pybullet.rendering.ray_camera import RayCamera
from sim_pybullet.rendering.rays import MAX_TAPS, FloorTable, floor_shade
from sim_pybullet.rendering.solid_geometry import BLUE, RED, ROUND
from sim_pybullet.rendering.solid_kernel import in_sight
from sim_pybullet.scene import Mover, Scene

UNSEEN = 1 << 62  # where no solid was met; else depth's bits << 24 | colour, the nearest the least
Met = tuple[torch.Tensor, torch.Tensor, torch.Tensor]  # whether, depth and colour, (Q, 4) each
_SPREAD = 0.125  # of neighbours' difference: a quarter of a pixel


class TorchCamera(RayCamera):
    """As `RayCamera`, which works out on the CPU what changes with an episode, and culls solids.

    Pictures are those of `RayCamera` but for rounding: a grey level in a few pixels.
    """

    def __init__(
        self, image: ImageSpec, n_robots: int, movers: tuple[Mover, ...] = (), device: str = "cuda"
    ) -> None:
        super().__init__(image, n_robots, movers)
        height, width, _ = image.shape
        pixels, self.device, self._device = height * width, device, torch.device(device)
        self._textures = Textures(n_robots, self._device)
        self._sky = torch.zeros((n_robots, pixels, 3), dtype=torch.uint8, device=self._device)
        self._held: list[FloorTable | None] = [None] * n_robots  # the tables on the device, by slot
        self._points = torch.zeros((n_robots, 4, pixels), device=self._device)
        # of each pixel: its mip level (-1: sky), and how many taps it averages
        self._reads = torch.zeros((n_robots, 2, pixels), dtype=torch.int64, device=self._device)
        self._rays = torch.zeros((n_robots, 3, 4, pixels), device=self._device)

    def set_robot(self, i: int, scene: Scene, rig: CameraRig) -> None:
        """Give robot ``i`` its world and its camera."""
        super().set_robot(i, scene, rig)
        self._textures.put(i, mip_texture(scene.ground, floor_shade(scene.light))[0])
        self._sky[i] = self._sent(self._skies[i]).view(-1, 3)
        tables, slot = self._tables, int(self._tables.slots[i])
        table = tables.stored[slot]
        if table is not None and self._held[slot] is not table:
            self._held[slot] = table
            self._points[slot] = self._sent(table.points)
            self._reads[slot] = self._sent(_reads(table))
            self._rays[slot] = self._sent(sub_rays(tables.directions[slot]))

    def render(  # type: ignore[override]  # tensors, where its base class has arrays
        self, poses: np.ndarray, robots: np.ndarray | None = None, movers: np.ndarray | None = None
    ) -> torch.Tensor:
        """(N, H, W, 3) uint8 on the device; arguments as of `RayCamera`."""
        poses, robots = self._checked(poses, robots)
        pictures = self._floor(poses, robots)
        self._put_solids(pictures, poses, robots, movers)
        return pictures.view(len(robots), *self.shape)

    def _sent(self, array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(array).to(self._device)

    def _floor(self, poses: np.ndarray, robots: np.ndarray) -> torch.Tensor:
        """Floor and sky (N, P, 3) uint8: the arithmetic of `draw_floor`, all pixels at once."""
        views = self._floor_views(poses, robots)
        slots = self._sent(views.slots)
        x, y, dx, dy = self._points[slots].unbind(1)
        level, taps = self._reads[slots].unbind(1)
        floor = (level >= 0)[..., None]
        level = level.clamp(min=0)
        levels = self._sent(views.levels).long()
        first, wide, high = (each.gather(1, level) for each in levels.unbind(2))
        first += self._textures.firsts(robots)[:, None]
        column, row, c, s = self._sent(views.placed.astype(np.float32))[..., None].unbind(1)
        scale = torch.exp2(8.0 - level)
        sums = torch.zeros((*x.shape, 3), device=self._device)
        for tap in range(MAX_TAPS):
            ahead, left = 256.0 * (x + tap * dx), 256.0 * (y + tap * dy)
            u = c * ahead - s * left + (column * scale + 128.0)
            v = row * scale + 128.0 - s * ahead - c * left
            sums += (tap < taps)[..., None] * self._textures.read(u, v, first, wide, high)
        taps = taps[..., None]
        rgb = ((sums + 128.0 * taps) / (256.0 * taps)).to(torch.uint8)  # rounds down
        return torch.where(floor, rgb, self._sky[self._sent(robots)])

    def _put_solids(
        self,
        pictures: torch.Tensor,
        poses: np.ndarray,
        robots: np.ndarray,
        movers: np.ndarray | None,
    ) -> None:
        """Blend into pictures (N, P, 3) what four rays per pixel meet."""
        views = self._solid_views(poses, robots, movers)
        if views is None:
            return
        rows, boxes, colours, lights, seen = in_sight(views, self._rows.shape[1])
        nearest = torch.full((len(poses) * 4 * pictures.shape[1],), UNSEEN, device=self._device)
        round_ = rows[..., ROUND] > 0.0
        for which, meet in ((seen & ~round_, meet_boxes), (seen & round_, meet_cylinders)):
            who, _ = np.nonzero(which)
            where = np.stack((who, views.slots[who]), axis=-1)
            pixels = SolidPixels(self._rays, self.shape[1], *map(self._sent, (where, boxes[which])))
            told = rows[which], colours[which].astype(np.int64), lights[who]
            pixels.put(nearest, meet(pixels, *map(self._sent, told)))
        nearest = nearest.view(len(poses), 4, -1)
        met = nearest != UNSEEN
        total = 2 + (~met).sum(1)[..., None] * pictures
        for k in range(3):
            total[..., k] += torch.where(met, nearest >> 8 * k & 255, 0).sum(1)
        pictures[:] = (total >> 2).to(torch.uint8)


class Textures:
    """The floors of N robots in one tensor on a device; robots with the same floor share it."""

    def __init__(self, n_robots: int, device: torch.device) -> None:
        self._device = device
        self._of: list[np.ndarray | None] = [None] * n_robots
        self._held: dict[int, tuple[int, np.ndarray]] = {}  # by identity: where it begins, itself
        self._end = 0
        self._texels = torch.zeros(0, dtype=torch.int32, device=device)

    def put(self, i: int, texels: np.ndarray) -> None:
        """Robot ``i`` has this floor, the texels of a `MipTexture`."""
        self._of[i] = texels
        if id(texels) in self._held:
            return
        used = {id(each): each for each in self._of if each is not None}
        if self._end + len(texels) > len(self._texels):
            room = 2 * sum(map(len, used.values()))  # what is in use, and as much again
            self._texels = torch.zeros(room, dtype=torch.int32, device=self._device)
            self._held, self._end = {}, 0
        for key in used.keys() - self._held.keys():
            floor, begin = used[key], self._end
            rgb = floor & 0xFF | (floor >> 12 & 0xFF) << 8 | (floor >> 24) << 16
            self._held[key], self._end = (begin, floor), begin + len(floor)
            self._texels[begin : self._end] = torch.from_numpy(rgb.view(np.int32))

    def firsts(self, robots: np.ndarray) -> torch.Tensor:
        """(M,) where these robots' (M,) floors begin."""
        begins = [self._held[id(self._of[i])][0] for i in robots.tolist()]
        return torch.tensor(begins, device=self._device)

    def read(
        self,
        u: torch.Tensor,
        v: torch.Tensor,
        first: torch.Tensor,
        wide: torch.Tensor,
        high: torch.Tensor,
    ) -> torch.Tensor:
        """Bilinear colours (N, P, 3) times 256.

        u, v (N, P) are columns and rows in 256ths of a texel; ``first``, ``wide`` and ``high``
        (N, P) are of the level that each pixel reads.
        """
        u = u.clamp(min=0).minimum((wide - 1) * 256.0 - 1.0).to(torch.int32)
        v = v.clamp(min=0).minimum((high - 1) * 256.0 - 1.0).to(torch.int32)
        at = first + (v >> 8) * wide + (u >> 8)
        fx, fy = u & 255, v & 255
        both = fx * fy + 128 >> 8
        total = self._rgb(at) * (256 - fx - fy + both)[..., None]
        total += self._rgb(at + 1) * (fx - both)[..., None]
        total += self._rgb(at + wide) * (fy - both)[..., None]
        return total + self._rgb(at + wide + 1) * both[..., None]

    def _rgb(self, at: torch.Tensor) -> torch.Tensor:
        return self._texels[at].view(torch.uint8).view(*at.shape, 4)[..., :3].float()


def _reads(table: FloorTable) -> np.ndarray:
    """(2, P) int64: mip level and number of taps of each pixel, from the runs; -1 and 1 are sky."""
    reads = np.stack((np.full(table.points.shape[1], -1), np.ones(table.points.shape[1], int)))
    for first, last, level, log_taps in table.runs.tolist():
        reads[:, first:last] = [[level], [1 << log_taps]]
    return reads


# Solids met by rays: the geometry of `solid_geometry`, all pixels at once.


def sub_rays(directions: np.ndarray) -> np.ndarray:
    """The four rays (3, 4, H W) float32 of each pixel, from their middles (3, H, W)."""
    padded = np.pad(directions, ((0, 0), (1, 1), (1, 1)), mode="edge")
    across = _SPREAD * (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2])
    down = _SPREAD * (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1])
    rays = [directions + a * across + b * down for b in (-1, 1) for a in (-1, 1)]
    return np.stack(rays, axis=1).reshape(3, 4, -1).astype(np.float32)


class SolidPixels:
    """The Q pixels that M solids may be seen in, one solid's after the other's, and their rays.

    ``rays`` (S, 3, 4, P), see `sub_rays`, are in rows of ``width``; ``where`` (M, 2) is the picture
    that a solid is in, and the slot of its rays; ``boxes`` (M, 4) are as `pixel_box` writes them.
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

    def slab(self, low: torch.Tensor, high: torch.Tensor, axis: torch.Tensor) -> list[torch.Tensor]:
        """Where rays, by their component across two planes, enter and leave the space between."""
        a, b = low / axis, high / axis
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
    """`meet_box` for ``rows`` (M, 13) of `to_camera`, with ``colours`` (M, 3) of `face_colours`."""
    x, y, c, s, *sizes = rows[:, :ROUND].T
    own = c, s, c * x + s * y, c * y - s * x  # in the box's axes
    c, s, x, y, half_x, half_y, base, top = pixels.of(*own, *sizes)
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
    x, y, _, _, radius, _, base, top = rows[:, :ROUND].T
    place, light = (x, y, x**2 + y**2 - radius**2, base, top), lights.T
    lit = light[0] / radius, light[1] / radius, *light[3:]
    x, y, outside, base, top, light_x, light_y, ambient, diffuse = pixels.of(*place, *lit)
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
