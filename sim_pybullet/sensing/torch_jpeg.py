"""What JPEG leaves of pictures, worked out on a device of torch, without a file.

Baseline JPEG to the bit as libjpeg writes and reads it by default (ITU-T T.81; JFIF 1.02): YCbCr,
colour at half the size, blocks of 8 x 8 by the discrete cosine transform, rounded to multiples of
the quality's table. All in whole numbers, which float64 holds exactly.
"""

from functools import cache
from io import BytesIO

import torch
from PIL import Image
from torch.nn.functional import interpolate, pad

# JFIF, in 65536ths: rows give Y, Cb and Cr of red, green and blue, and the way back.
_TO_YCC = ((19595, 38470, 7471), (-11059, -21709, 32768), (32768, -27439, -5329))
_FROM_YCC = ((65536, 0, 91881), (65536, -22554, -46802), (65536, 116130, 0))
# The cosine transform of 8 numbers times 8192 sqrt(8), as the constants of libjpeg's "islow" method
# (after Loeffler, Ligtenberg and Moschytz 1989) add up. Its transpose is the way back.
_COSINES = (
    (8192, 8192, 8192, 8192, 8192, 8192, 8192, 8192),
    (11363, 9633, 6437, 2260, -2260, -6437, -9633, -11363),
    (10703, 4433, -4433, -10703, -10703, -4433, 4433, 10703),
    (9633, -2259, -11362, -6436, 6436, 11362, 2259, -9633),
    (8192, -8192, -8192, 8192, 8192, -8192, -8192, 8192),
    (6437, -11362, 2261, 9633, -9633, -2261, 11362, -6437),
    (4433, -10704, 10704, -4433, -4433, 10704, -10704, 4433),
    (2260, -6436, 9633, -11363, 11363, -9633, 6436, -2260),
)


def compressed(pictures: torch.Tensor, qualities: torch.Tensor) -> torch.Tensor:
    """Pictures (M, H, W, 3) of whole numbers 0..255, float32, after JPEG of qualities (M,)."""
    to_ycc, from_ycc = (
        torch.tensor(matrix, dtype=torch.float64, device=pictures.device)
        for matrix in (_TO_YCC, _FROM_YCC)
    )
    ycc = torch.einsum("mhwc,dc->mdhw", pictures.double(), to_ycc)
    luma, chroma = _halved(ycc[:, :1], 16), _halved(ycc[:, 1:] - 1.0, 16)
    height, width = luma.shape[2:]
    turn = torch.arange(width + 16, device=pictures.device) % 2  # it rounds by turns
    chroma = pad(chroma, (0, -width % 16, 0, height % 2), mode="replicate")
    quads = chroma.unfold(2, 2, 2).unfold(3, 2, 2).sum((4, 5))
    small = ((quads + 1.0 + turn[: quads.shape[3]]) / 4.0).floor()
    luma = _rounded_waves(luma - 128.0, _steps()[0], qualities) + 128.0
    small = _rounded_waves(small, _steps()[1], qualities)[..., : (width + 1) // 2]
    chroma = interpolate(small, scale_factor=2, mode="bilinear")[..., :height, :width]
    chroma = (chroma + (8.0 - turn[:width]) / 16.0).floor()
    rgb = torch.einsum("mdhw,cd->mhwc", torch.cat((luma, chroma), dim=1), from_ycc)
    return _halved(rgb, 16).clamp(0.0, 255.0).float()


@cache
def _steps() -> dict[int, list[int]]:
    """Of luminance, 0, and chrominance, 1, at quality 50 (T.81, annex K.1), as a file has them."""
    file = BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", quality=50)
    return dict(Image.open(file).quantization)  # type: ignore[attr-defined]


def _halved(numbers: torch.Tensor, times: int) -> torch.Tensor:
    """Whole numbers halved so many times, rounded to the nearest, ties up."""
    return (numbers * 0.5**times + 0.5).floor()


def _rounded_waves(planes: torch.Tensor, table: list[int], qualities: torch.Tensor) -> torch.Tensor:
    """Planes (M, C, H, W) about 0 from their blocks' waves, each a multiple of its step (64)."""
    scale = torch.where(qualities < 50, 5000 // qualities, 200 - 2 * qualities)[:, None, None]
    steps = (torch.tensor(table, device=planes.device).view(8, 8) * scale + 50) // 100
    steps = steps.clamp(1, 255)[:, None, None, :, None, :]
    height, width = planes.shape[2:]
    blocks = pad(planes, (0, -width % 8, 0, -height % 8), mode="replicate")
    blocks = blocks.unflatten(3, (-1, 8)).unflatten(2, (-1, 8))  # (M, C, rows, 8, columns, 8)
    cosines = torch.tensor(_COSINES, dtype=torch.float64, device=planes.device)
    waves = _halved(torch.einsum("mcribj,vj->mcribv", blocks, cosines), 11)
    waves = _halved(torch.einsum("mcribv,ui->mcrubv", waves, cosines), 15)  # times 8
    waves = waves.sign() * ((waves.abs() + 4 * steps) / (8 * steps)).floor() * steps
    blocks = _halved(torch.einsum("mcrubv,ui->mcribv", waves, cosines), 11)
    blocks = _halved(torch.einsum("mcribv,vj->mcribj", blocks, cosines), 18)
    return blocks.clamp(-128.0, 127.0).flatten(4, 5).flatten(2, 3)[..., :height, :width]
