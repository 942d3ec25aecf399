"""``TorchSensors``: what sensors make of pictures that lie on a device of torch."""

import numpy as np
import torch

from sim_pybullet.look import SensorLook
from sim_pybullet.sensing import sensor
from sim_pybullet.sensing.torch_jpeg import compressed


class TorchSensors(sensor.Sensors):
    """As `Sensors`, all robots at once: the same pictures but for rounding, and the same noise."""

    def __init__(
        self, count: int, shape: tuple[int, ...], crop_top_px: int = 0, device: str = "cuda"
    ) -> None:
        super().__init__(count, shape, crop_top_px)
        self._device = torch.device(device)
        self._lookup = self._sent(self._noise)
        # r^2 of each pixel, (H, W, 1)
        self._away = self._sent(self._rows[:, None] + self._columns[::3])[..., None]
        self._mirrored = torch.zeros((count, *shape), device=self._device)  # rays

    def blank(self, shape: tuple[int, ...]) -> torch.Tensor:  # type: ignore[override]
        """Black pictures of this shape, uint8, on the device."""
        return torch.zeros(shape, dtype=torch.uint8, device=self._device)

    def put(self, i: int, look: SensorLook, mirror: sensor.Mirror | None = None) -> None:
        """Robot ``i`` has this sensor, over this floor if it mirrors the light."""
        super().put(i, look, mirror)
        if mirror is not None:
            self._mirrored[i] = self._sent(mirror.rays)

    def take(  # type: ignore[override]  # tensors, where its base class has arrays
        self,
        frames: torch.Tensor,
        robots: np.ndarray,
        rng: np.random.Generator,
        turns_radps: np.ndarray | float = 0.0,
        headings_rad: np.ndarray | float = 0.0,
    ) -> torch.Tensor:
        """As of `Sensors`; frames (M, H, W, 3) uint8 on the device are left as they are."""
        looks = [self._looks[i] for i in robots.tolist()]
        light = self._glossed(frames.float(), robots, headings_rad)
        smears = [sensor.smear_weights(length) for length in self._smears_px(robots, turns_radps)]
        light = self._averaged(light, smears, axis=2).round()
        blurs = [self._kernels[i] for i in robots]
        light = self._averaged(self._averaged(light, blurs, axis=1), blurs, axis=2)
        light = (light + 0.5).floor()
        light = torch.einsum("mhwc,mdc->mhwd", light, self._sent(self._mixing[robots]).float())
        light = light.round().clamp(0.0, 255.0)
        gains = self._sent(self._gains[robots]).float()[:, None, None]
        vignetting, noise, qualities = (
            torch.tensor([getattr(look, name) for look in looks], device=self._device)
            for name in ("vignetting", "noise", "jpeg_quality")
        )
        light *= (1.0 - vignetting[:, None, None, None] * self._away) * gains
        starts = self._sent(self._noise_starts(robots, rng))
        row = torch.arange(light[0, 0].numel(), device=self._device)
        noisy = self._lookup[starts[..., None] + row].view(light.shape)
        light += min(1.0, self._scale) * noise[:, None, None, None] * noisy
        light = (light + 0.5).clamp(0.0, 255.0).floor()
        packed = np.flatnonzero([look.jpeg_quality < 100 for look in looks])
        if len(packed):
            light[packed] = compressed(light[packed], qualities[packed])
        return light.to(torch.uint8)

    def _glossed(
        self, light: torch.Tensor, robots: np.ndarray, headings_rad: np.ndarray | float
    ) -> torch.Tensor:
        """As `add_gloss`."""
        lamps = np.tile(np.array((0.0, 0.0, -1.0, 1.0, 0.0), np.float32), (len(robots), 1))
        for k, (i, heading_rad) in enumerate(np.broadcast(robots, headings_rad)):
            mirror = self._mirrors[i]
            if mirror is not None:
                shine = mirror.light
                lamps[k, :3] = sensor.lamp_in_floor(shine, heading_rad)
                lamps[k, 3:] = shine.gloss_width_rad**2, shine.gloss * sensor.LAMP
        told = self._sent(lamps)[:, None, None]
        lamp, variance, bright = told[..., :3], told[..., 3], told[..., 4]
        rays = self._mirrored[robots]
        cosine = (rays * lamp).sum(-1)
        seen = (cosine > 1.0 + variance * sensor.LOG_BARELY) & (rays[..., 2] < 0.0)
        spot = seen * bright * ((cosine.clamp(max=1.0) - 1.0) / variance).exp()
        return (light + spot[..., None] + 0.5).clamp(max=255.0).floor()

    def _averaged(self, light: torch.Tensor, kernels: list[np.ndarray], axis: int) -> torch.Tensor:
        """Along an axis, each with its own weights (2 R + 1,); edges repeat."""
        radius = max(map(len, kernels)) // 2
        weights = np.zeros((len(kernels), 2 * radius + 1))
        for row, kernel in zip(weights, kernels, strict=True):
            row[radius - len(kernel) // 2 :][: len(kernel)] = kernel
        place = torch.arange(light.shape[axis], device=self._device)
        total = torch.zeros_like(light)
        for k, weight in enumerate(self._sent(weights).float().T):
            moved = light.index_select(axis, (place + k - radius).clamp(0, len(place) - 1))
            total += weight[:, None, None, None] * moved
        return total

    def _sent(self, array: np.ndarray) -> torch.Tensor:
        return torch.tensor(array, device=self._device)
