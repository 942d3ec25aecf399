"""What a policy looks at.

*Features* are the visualisation of paper A (its Figures 27 to 29 and 40): the channel mean of the
last convolution is enlarged to the one before and multiplied with its channel mean, layer by layer
down to the first; the product, normalised, is laid over the picture. *Influence* asks the policy
itself: how much its values change when a patch of the picture is covered (occlusion sensitivity,
Zeiler and Fergus 2014). Both need only the ONNX file, so every policy that can drive the robot.
"""

import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import onnx
from onnxruntime import InferenceSession, SessionOptions
from rich.console import Console
from rich.progress import track

from robot.camera.files import PICTURES, VIDEOS, picture_files, play, read_picture, write_png
from robot.camera.source import fit_to_frame
from robot.errors import ConfigError, ContractError
from robot.inference.policy import read_contract
from robot.inference.preprocess import preprocess
from trainer.mp4 import write_mp4
from trainer.run import RunFolder

ATTENTION_SHARE = 0.55  # of the overlay's colour that comes from the colour map
SHEET = 16  # pictures on a sheet
PATCHES = 20  # covered ones across a picture
VIDEO_FPS = 10.0  # of a video drawn of one that does not tell its own: a decision's pace
_SHEET_EVERY = 10  # frames of a video, so that a long one fits into memory
_SHOWN_PX, _CELL_PX = (320, 240), (600, 150)


class Explainer:
    """Attention maps of an ONNX policy; ContractError if it is none, or has no convolutions."""

    def __init__(self, path: Path) -> None:
        self.contract = read_contract(path)
        model = onnx.load(path)
        self._layers = convolution_outputs(model.graph)
        if not self._layers:
            raise ContractError(f"{path}: expected a network with convolutions, found none")
        for name in self._layers:
            model.graph.output.append(onnx.ValueInfoProto(name=name))
        options, providers = SessionOptions(), ["CPUExecutionProvider"]
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        self._session = InferenceSession(model.SerializeToString(), options, providers=providers)

    def attention(self, images: np.ndarray) -> np.ndarray:
        """(N, H, W) float32 in [0, 1] for policy pictures (N, H, W, 3) uint8, each map's peak 1."""
        means = [output.mean(axis=1) for output in self._run(self._layers, images)]  # (N, h, w)
        shape = images.shape[1:3]
        return np.stack([fuse(list(layers), shape) for layers in zip(*means, strict=True)])

    def influence(self, image: np.ndarray) -> np.ndarray:
        """(H, W) float32 in [0, 1] for one policy picture (H, W, 3) uint8, its peak 1.

        Patches of a twentieth of the width are covered with the picture's median colour, one at a
        time; what all values have in common does not count, since it changes no choice.
        """
        height, width = image.shape[:2]
        side = max(1, width // PATCHES)
        corners = [(y, x) for y in range(0, height, side) for x in range(0, width, side)]
        covered = np.repeat(image[None], len(corners) + 1, axis=0)
        colour = np.median(image.reshape(-1, 3), axis=0)
        for picture, (y, x) in zip(covered[1:], corners, strict=True):
            picture[y : y + side, x : x + side] = colour
        values = self._run(["values"], covered)[0]
        values = values - values.mean(axis=1, keepdims=True)
        change = np.abs(values[1:] - values[0]).mean(axis=1)
        patches = change.reshape(-(-height // side), -1).astype(np.float32)
        whole = np.kron(patches, np.ones((side, side), np.float32))[:height, :width]
        return whole / max(float(whole.max()), np.finfo(np.float32).tiny)

    def _run(self, names: list[str], images: np.ndarray) -> list[np.ndarray]:
        feeds = {"image": np.tile(images, self.contract.frames)}  # as if nothing had moved
        if self.contract.told:
            feeds["path"] = np.zeros((len(images), self.contract.told), np.float32)
        return [np.asarray(output) for output in self._session.run(names, feeds)]


def fuse(means: list[np.ndarray], shape: tuple[int, ...]) -> np.ndarray:
    """Multiply channel means (h, w) from last layer to first; enlarge to ``shape`` (H, W)."""
    product = means[-1]
    for mean in reversed(means[:-1]):
        product = _enlarge(product, mean.shape) * mean
    product = product - product.min()
    peak = float(product.max())
    return _enlarge((product / peak if peak > 0.0 else product).astype(np.float32), shape)


def overlay(image: np.ndarray, attention: np.ndarray) -> np.ndarray:
    """The picture (H, W, 3) uint8 with its attention (H, W) in colour: the yellower, the more."""
    coloured = cv2.applyColorMap((255 * attention).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    mixed = (1.0 - ATTENTION_SHARE) * image + ATTENTION_SHARE * coloured[..., ::-1]
    return np.asarray(mixed.round().clip(0, 255), dtype=np.uint8)


def pictures(source: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Names, no two alike, and frames (120, 160, 3) of a source as of `redraw`, or ConfigError."""
    if source.suffix.lower() in VIDEOS:
        index = -1
        for index, picture in enumerate(play(source)):
            yield f"{index:06d}", fit_to_frame(picture)
        if index < 0:
            raise ConfigError(f"{source}: expected a video with pictures, got none")
        return
    single, given = source.is_file() and source.suffix.lower() in PICTURES, set[str]()
    files, skipped = [source] if single else picture_files(source), list[Path]()
    for file in files:
        name = file.stem if single else "_".join(file.relative_to(source).with_suffix("").parts)
        while name in given:  # of x.jpg and x.png
            name += "_" + file.suffix[1:]
        try:
            frame = fit_to_frame(read_picture(file))
        except ConfigError:
            skipped.append(file)
            if len(skipped) == len(files):
                raise
            continue
        given.add(name)
        yield name, frame
    if skipped:
        print(f"skipped {len(skipped)} that OpenCV cannot read, such as {skipped[0]}")


def explain(explainer: Explainer, frame: np.ndarray) -> np.ndarray:
    """A frame (120, 160, 3), then features and influence laid over it, (240, 960, 3).

    Rows that the policy does not see are darkened.
    """
    spec = explainer.contract.image
    image = preprocess(frame, spec)
    large = cv2.resize(frame, _SHOWN_PX, interpolation=cv2.INTER_CUBIC)
    unseen = round(spec.crop_top_px / spec.height_px * len(large))
    shown = [large]
    for attention in (explainer.attention(image[None])[0], explainer.influence(image)):
        above = np.zeros((spec.crop_top_px, spec.width_px), np.float32)
        over = overlay(large, _enlarge(np.concatenate((above, attention)), large.shape))
        over[:unseen] = large[:unseen] // 3
        shown.append(over)
    return np.concatenate(shown, axis=1)


def sheet(shown: Sequence[np.ndarray]) -> np.ndarray:
    """Up to `SHEET` of the pictures that `explain` makes, evenly chosen, one below the other."""
    chosen = np.unique(np.linspace(0, len(shown) - 1, min(SHEET, len(shown))).round().astype(int))
    return np.vstack([cv2.resize(shown[i], _CELL_PX, interpolation=cv2.INTER_AREA) for i in chosen])


def write_explained(policy: Path, source: Path, out: Path) -> int:
    """Write what ``policy`` looks at in each picture of ``source``, and a sheet; how many.

    ``policy`` as of `open_explainer`, ``source`` as of `redraw`; DuckpilotError if either is none.
    """
    explainer, kept, numbers = open_explainer(policy), list[np.ndarray](), itertools.count()
    every = _SHEET_EVERY if source.suffix.lower() in VIDEOS else 1

    def draw(frame: np.ndarray) -> np.ndarray:
        picture = explain(explainer, frame)
        if next(numbers) % every == 0:
            kept.append(picture)
        return picture

    count = redraw(source, out, "explained", draw)
    write_png(out / "sheet.png", sheet(kept))
    return count


def redraw(source: Path, out: Path, word: str, draw: Callable[[np.ndarray], np.ndarray]) -> int:
    """Write what is drawn of each frame (120, 160, 3) of a source, ``NAME_WORD.png``; how many.

    It is a picture, a folder of pictures, or a video, which is answered with a video. ConfigError
    if it is none; then nothing is written.
    """
    frames, count = pictures(source), itertools.count()
    first = next(frames)
    out.mkdir(parents=True, exist_ok=True)
    every = track(itertools.chain([first], frames), word, console=Console(stderr=True))
    drawn = ((next(count), name, draw(frame)) for name, frame in every)
    if source.suffix.lower() in VIDEOS:
        path = out / f"{source.stem}_{word}.mp4"
        rate = cv2.VideoCapture(str(source)).get(cv2.CAP_PROP_FPS)
        rate = rate if 1.0 <= rate <= 240.0 else VIDEO_FPS
        write_mp4(path, (picture for _, _, picture in drawn), rate)
    else:
        for _, name, picture in drawn:
            write_png(out / f"{name}_{word}.png", picture)
    return next(count)


def open_explainer(policy: Path) -> Explainer:
    """That of an ONNX file, of the policy of a run folder, or of a checkpoint in one.

    DuckpilotError for a run folder without a policy, or a file that is neither.
    """
    if policy.is_dir():
        folder = RunFolder(policy)
        found = [path for path in (folder.onnx, folder.best, folder.checkpoint) if path.exists()]
        if not found:
            raise ConfigError(f"{policy}: expected a run with a policy, found none")
        policy = found[0]
    if policy.suffix != ".pt":
        return Explainer(policy)
    from trainer.export import export_weights  # torch, which nothing else here needs

    with tempfile.TemporaryDirectory() as temporary:
        path, folder = Path(temporary) / "policy.onnx", RunFolder(policy.parent)
        export_weights(folder, folder.load_config(), policy, path)
        return Explainer(path)


def _enlarge(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    return cv2.resize(values, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)


def convolution_outputs(graph: onnx.GraphProto) -> list[str]:
    """What the rectifier after each convolution gives, first layer first."""
    reader = {node.input[0]: node for node in graph.node if node.input}
    names = []
    for convolution in (node for node in graph.node if node.op_type == "Conv"):
        node = reader.get(convolution.output[0])
        while node is not None and node.op_type in ("QuantizeLinear", "DequantizeLinear"):
            node = reader.get(node.output[0])
        rectifier = node if node is not None and node.op_type == "Relu" else convolution
        names.append(rectifier.output[0])
    return names
