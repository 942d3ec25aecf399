"""LeRobot's datasets, version 3.0: Parquet, a video, and what they mean in JSON.

https://huggingface.co/docs/lerobot/lerobot-dataset-v3. An episode is a stretch without a gap; all
episodes lie in one file of data and one video. Actions are wheel speeds (left, right) [m/s].
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np

from robot.errors import ConfigError
from robot.geometry import WheelSpeeds
from robot.recording.drive_file import png
from robot.recording.reader import Sample, read_samples, runs
from tools.data.drives import seen, write_drive
from trainer.mp4 import Mp4
from trainer.run import appearing

VIDEO = "observation.images.front"
DATA, EPISODES = (f"{of}/chunk-000/file-000.parquet" for of in ("data", "meta/episodes"))
FILM = f"videos/{VIDEO}/chunk-000/file-000.mp4"
CHUNKS = "chunk-{chunk_index:03d}/file-{file_index:03d}"
QUALITY = 9.5  # of 10
KEYS_EVERY = 5  # pictures: a training jumps about in the video
WHEELS = ["left_mps", "right_mps"]
MOST_MPS = 3.0  # of a wheel; more are mm/s, or steps
BROKEN = FileNotFoundError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def to_dataset(drives: Sequence[Path], dataset: Path, task: str) -> int:
    """Recordings as a dataset; how many episodes. ConfigError: none, or of other rates or sizes."""
    import pyarrow.parquet as parquet

    episodes = [run for path in drives for run in runs(list(read_samples(path)))]
    if not episodes:
        raise ConfigError(f"{drives[0]}: expected a drive with pictures, got none")
    fps, shape = _rate(episodes), seen(episodes[0][0]).shape
    columns = _columns(episodes, fps)
    with appearing(dataset) as folder:
        for place in (DATA, EPISODES, FILM):
            (folder / place).parent.mkdir(parents=True)
        levels = _write_video(folder / FILM, episodes, fps, shape)
        parquet.write_table(_table(columns), folder / DATA)
        parquet.write_table(_episode_table(episodes, fps, task), folder / EPISODES)
        parquet.write_table(_task_table(task), folder / "meta/tasks.parquet")
        stats: dict[str, Any] = {name: _stats(column) for name, column in columns.items()}
        stats[VIDEO] = {name: np.reshape(v, (-1, 1, 1)).tolist() for name, v in levels.items()}
        stats[VIDEO]["count"] = [len(columns["index"])]
        info = _info(len(episodes), len(columns["index"]), fps, shape, columns)
        for name, told in (("info", info), ("stats", stats)):
            (folder / f"meta/{name}.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
    return len(episodes)


def from_dataset(dataset: Path, out: Path) -> list[Path]:
    """Write a dataset's episodes as recordings; of its cameras the first that shows no depth.

    ConfigError: no whole dataset of version 3, or actions that are not two wheels' speeds.
    """
    try:
        info = json.loads((dataset / "meta/info.json").read_text(encoding="utf-8"))
        if not info["codebase_version"].startswith("v3."):
            remedy = "LeRobot's convert_dataset_v21_to_v30 brings 2.1 to 3.0"
            raise ValueError(f"version {info['codebase_version']}; {remedy}")
        if info["features"]["action"]["names"] != WHEELS:
            raise ValueError(f"actions {info['features']['action']['names']}, not {WHEELS}")
        with appearing(out) as folder:
            names = [path.name for path in _write_drives(dataset, info, folder)]
            if not names:
                raise ValueError("no episode")
    except (*BROKEN, RecursionError) as error:
        told = f"{dataset}: expected a whole LeRobot dataset v3.0 of two wheels, got: {error}"
        raise error if isinstance(error, ConfigError) else ConfigError(told) from error
    return [out / name for name in names]


def _write_drives(dataset: Path, info: dict[str, Any], folder: Path) -> Iterator[Path]:
    told = {n: t.get("info") or {} for n, t in info["features"].items() if t["dtype"] == "video"}
    depth = "video.is_depth_map", "is_depth_map"
    if not (cameras := [name for name in told if not any(map(told[name].get, depth))]):
        raise ValueError("no video of a camera")
    rows, half_s, camera = _rows(dataset, "data"), 0.5 / float(info["fps"]), cameras[0]
    if [row["index"] for row in rows] != [*range(len(rows))]:
        raise ValueError("rows that are missing or out of order, by their index")
    for episode in _rows(dataset, "meta/episodes"):
        place = {k: episode[f"videos/{camera}/{k}"] for k in ("chunk_index", "file_index")}
        film = (dataset / info["video_path"].format(video_key=camera, **place)).resolve(strict=True)
        from_s = episode[f"videos/{camera}/from_timestamp"] - half_s
        images = _frames(film, from_s, episode["length"])
        span = rows[episode["dataset_from_index"] : episode["dataset_to_index"]]
        if len(span) != episode["length"]:
            raise ValueError(f"{len(span)} rows of an episode of {episode['length']}")
        name, robot = f"{dataset.name}-{episode['episode_index']:03d}", info.get("robot_type")
        yield write_drive(folder, name, robot or "lerobot", _samples(span, images))


def _rate(episodes: Sequence[Sequence[Sample]]) -> int:
    """Pictures a second, of every drive alike."""
    gaps = [np.diff([sample.time_s for sample in run]) for run in episodes if len(run) > 1]
    rates = {max(1, round(1.0 / float(np.median(gap)))) for gap in gaps if len(gap) > 9}
    if len(rates) > 1:
        raise ConfigError(f"expected drives of one rate, got {sorted(rates)} turns a second")
    return rates.pop() if rates else 10


def _columns(episodes: Sequence[Sequence[Sample]], fps: int) -> dict[str, np.ndarray]:
    """(rows, numbers) of each feature but the video."""
    wheels = [np.array([sample.wheels for sample in run], np.float32) for run in episodes]
    before = [np.concatenate((run[:1], run[:-1])) for run in wheels]
    frames = np.concatenate([np.arange(len(run)) for run in episodes])
    numbers = np.repeat(np.arange(len(episodes)), [len(run) for run in episodes])
    person = np.array([sample.driver == "person" for run in episodes for sample in run])
    return {
        "observation.state": np.concatenate(before),
        "action": np.concatenate(wheels),
        "intervention": person[:, None],
        "timestamp": (frames / fps).astype(np.float32)[:, None],
        "frame_index": frames[:, None],
        "episode_index": numbers[:, None],
        "index": np.arange(len(frames))[:, None],
        "task_index": np.zeros((len(frames), 1), np.int64),
    }


def _table(columns: dict[str, np.ndarray]) -> Any:
    import pyarrow as pa

    flat = {name: pa.array(values.ravel()) for name, values in columns.items()}
    pairs = [name for name, values in columns.items() if values.shape[1] == 2]
    return pa.table(flat | {n: pa.FixedSizeListArray.from_arrays(flat[n], 2) for n in pairs})


def _episode_table(episodes: Sequence[Sequence[Sample]], fps: int, task: str) -> Any:
    import pyarrow as pa

    ends = np.cumsum([len(run) for run in episodes]).tolist()
    rows = []
    for number, (run, end) in enumerate(zip(episodes, ends, strict=True)):
        first = end - len(run)
        places = product(("data", f"videos/{VIDEO}", "meta/episodes"), ("chunk", "file"))
        files = {f"{of}/{kind}_index": 0 for of, kind in places}
        row = {"episode_index": number, "tasks": [task], "length": len(run)}
        row |= {"dataset_from_index": first, "dataset_to_index": end}
        film = f"videos/{VIDEO}"
        row |= {f"{film}/from_timestamp": first / fps, f"{film}/to_timestamp": end / fps}
        rows.append(row | files)
    return pa.Table.from_pylist(rows)


def _task_table(task: str) -> Any:
    """Tasks are the index of a pandas frame."""
    import pyarrow as pa

    index = "__index_level_0__"
    kinds = (("task_index", "task_index", "int64", "int64"), (None, index, "unicode", "object"))
    keys = ("name", "field_name", "pandas_type", "numpy_type")
    columns = [{**dict(zip(keys, kind, strict=True)), "metadata": None} for kind in kinds]
    told = {"index_columns": [index], "column_indexes": [], "columns": columns}
    table = pa.table({"task_index": [0], index: [task]})
    return table.replace_schema_metadata({"pandas": json.dumps(told)})


def _stats(values: np.ndarray) -> dict[str, list[float]]:
    """Of columns (rows, numbers), or of levels (pixels, colours)."""
    values = np.asarray(values, np.float64)
    found = {name: getattr(values, name)(axis=0) for name in ("min", "max", "mean", "std")}
    found |= {name: np.quantile(values, share, axis=0) for name, share in QUANTILES.items()}
    return {**{name: value.tolist() for name, value in found.items()}, "count": [len(values)]}


def _write_video(
    path: Path, episodes: Sequence[Sequence[Sample]], fps: int, shape: tuple[int, ...]
) -> dict[str, list[float]]:
    """Every picture in one video; the statistics of its colours in [0, 1]."""
    levels = []
    with closing(Mp4(path, fps, QUALITY, ("-g", str(KEYS_EVERY)))) as film:  # also after an error
        for sample in (sample for run in episodes for sample in run):
            frame = seen(sample)
            if frame.shape != shape or shape[0] % 2 or shape[1] % 2:  # as H.264 must be
                raise ConfigError(f"expected one even size, got pictures {frame.shape}, {shape}")
            film.add(frame)
            levels.append(frame[::8, ::8].reshape(-1, 3))
    return _stats(np.concatenate(levels) / 255.0)


def _info(
    episodes: int, frames: int, fps: int, shape: tuple[int, ...], columns: dict[str, np.ndarray]
) -> dict[str, Any]:
    video = {"fps": fps, "height": shape[0], "width": shape[1], "channels": 3, "codec": "h264"}
    video |= {"pix_fmt": "yuv420p", "is_depth_map": False}
    features: dict[str, Any] = {}
    for name, values in columns.items():
        named = WHEELS if values.shape[1] == 2 else None
        features[name] = {"dtype": str(values.dtype), "shape": [values.shape[1]], "names": named}
    told = {"dtype": "video", "shape": list(shape), "names": ["height", "width", "channels"]}
    features[VIDEO] = {**told, "info": {f"video.{name}": value for name, value in video.items()}}
    info: dict[str, Any] = {"codebase_version": "v3.0", "robot_type": "duckpilot", "fps": fps}
    info |= {"total_episodes": episodes, "total_frames": frames, "total_tasks": 1}
    info |= {"chunks_size": 1000, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200}
    info |= {"data_path": f"data/{CHUNKS}.parquet"}
    info |= {"video_path": f"videos/{{video_key}}/{CHUNKS}.mp4"}
    return {**info, "splits": {"train": f"0:{episodes}"}, "features": features}


def _rows(dataset: Path, folder: str) -> list[dict[str, Any]]:
    import pyarrow.parquet as parquet

    files = sorted((dataset / folder).glob("*/*.parquet"))
    return [row for file in files for row in parquet.read_table(file).to_pylist()]


def _frames(film: Path, from_s: float, count: int) -> Iterator[np.ndarray]:
    """So many frames (H, W, 3) uint8 RGB from a moment of a video on."""
    import imageio_ffmpeg

    raw = imageio_ffmpeg.read_frames(str(film), input_params=["-ss", f"{max(0.0, from_s):.6f}"])
    try:
        width, height = next(raw)["size"]
    except OSError as error:  # with ffmpeg's many words
        raise ValueError(f"{film.name} that cannot be played") from error
    for data in islice(raw, count):
        yield np.frombuffer(data, np.uint8).reshape(height, width, 3)


def _samples(rows: Sequence[dict[str, Any]], images: Iterator[np.ndarray]) -> Iterator[Sample]:
    last_s = -1.0
    for number, row in enumerate(rows):
        if (image := next(images, None)) is None:
            raise ValueError(f"a film of {number} pictures for {len(rows)} rows")
        if not last_s < (last_s := row["timestamp"]):
            raise ValueError(f"timestamps that do not grow, at {last_s:g} s")
        if max(map(abs, row["action"])) > MOST_MPS:
            raise ValueError(f"an action of {row['action']} m/s, beyond {MOST_MPS:g}")
        driver = "policy" if row.get("intervention") is False else "person"
        yield Sample(last_s, png(image), WheelSpeeds(*row["action"]), driver)
