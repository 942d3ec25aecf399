"""The policy's file: missing, damaged, of another contract, answering NaN, slow."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tools.faults.case import Act, Case
from tools.faults.stage import Stage
from tools.loop.pursuit import write_pursuit

SLOW_S = 0.35


def _starts_with(make: Callable[[Stage], Path]) -> Act:
    def inject(stage: Stage) -> None:
        bench = stage.bench
        bench.stop("robot")
        bench.use_model(make(stage))
        bench.start_and_end("robot")

    return inject


def _own_model(stage: Stage) -> None:
    stage.bench.use_model(stage.bench.options.model)


def _refused(says: str) -> Callable[[Stage], str]:
    def check(stage: Stage) -> str:
        process = stage.bench.processes["robot"]
        code, last = process.child.returncode, process.said().strip().splitlines()[-1]
        if code != 2 or says not in last:
            return f"expected status 2 and a line with {says!r}, got {code}: {last}"
        return ""

    return check


def _missing(stage: Stage) -> Path:
    return stage.bench.folder / "none.onnx"


def _damaged(stage: Stage) -> Path:
    path = stage.bench.folder / "damaged.onnx"
    data = bytearray(stage.bench.options.model.read_bytes())
    data[100:2000] = bytes(1900)
    path.write_bytes(data)
    return path


def _of_another_contract(stage: Stage) -> Path:
    return write_pursuit(stage.bench.folder / "other.onnx", points=7)


def _answers_nan(stage: Stage) -> None:
    """It drives, and answers NaN as soon as the picture's first pixel is not black."""
    bench = stage.bench
    path = write_pursuit(bench.folder / "nan.onnx", nan_unless_black=True)
    see = bench.town.world.see

    def first_pixel_black() -> np.ndarray:
        picture = see()
        picture[38:46, :6] = 0
        return picture

    bench.town.camera.see = first_pixel_black
    bench.stop("robot")
    bench.use_model(path)
    bench.revive()
    stage.ready()


def _show_all(stage: Stage) -> None:
    stage.bench.town.camera.see = stage.bench.town.world.see


def _own_model_again(stage: Stage) -> None:
    _show_all(stage)
    if stage.bench.model != stage.bench.options.model:
        stage.bench.stop("robot")
        _own_model(stage)


def _slow(stage: Stage) -> None:
    stage.bench.time.slow(SLOW_S)


def _fast(stage: Stage) -> None:
    stage.bench.time.slow(0.0)


_START = {"moving": False, "silent": True, "heal": _own_model}

CASES = (
    Case("missing", "no such file", _starts_with(_missing), check=_refused("none.onnx"), **_START),  # type: ignore[arg-type]
    Case("damaged", "bytes overwritten", _starts_with(_damaged), check=_refused("onnx"), **_START),  # type: ignore[arg-type]
    Case(
        *("wrong contract", "seven path points", _starts_with(_of_another_contract)),
        check=_refused("path"),
        **_START,  # type: ignore[arg-type]
    ),
    Case(
        *("NaN", "it answers NaN to some pictures", _show_all),
        threshold_s=0.1,
        says="finite",
        before=_answers_nan,
        heal=_own_model_again,
    ),
    Case(
        *("slow", f"a decision takes {SLOW_S:g} s", _slow),
        threshold_s=0.2,
        says="loop|frame",
        heal=_fast,
    ),
)
