"""The web side of the monitor: one static page, its data, a WebSocket, and POST for commands."""

import asyncio
import json
import logging
import math
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import FastAPI, Request, Response, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse, JSONResponse
from fastapi.staticfiles import StaticFiles
from pydantic import BaseModel, ConfigDict, Field

from robot.contract import Stick
from robot.errors import ConfigError, ContractError
from robot.link.messages import Mission
from robot.link.wire import plain, tidy_text
from robot.navigation.map_objects import objects_of
from robot.navigation.road_map import Lane, RoadMap, Tile
from robot.recording.reader import Piece
from tools.monitor.access import AccessGate
from tools.monitor.drives import list_drives, read_drive, read_marks, read_picture, write_marks
from tools.monitor.monitor import Monitor

STATIC = Path(__file__).parent / "static"
SEND_EVERY_S = 0.1
UNSEEN = 3  # states on their way to a page that has not said that it showed them
TEXT_LIMIT = 200  # characters from the page; its longest is {"manual":[-0.123,0.123]}
MANUAL_EVERY_S = 0.02
Seconds = Annotated[float, Field(ge=0.0, le=1e6, allow_inf_nan=False)]  # no drive is longer


class CommandBody(BaseModel):
    """What the page asks; places are x, y [m] in the world frame."""

    model_config = ConfigDict(extra="forbid")

    kind: Literal["arm", "auto", "disarm", "stop", "clear", "mission", "place"]
    destination: tuple[float, float] | None = None
    start: tuple[float, float] | None = None
    arm: bool = False  # a robot that stands, for its mission, once it has said that it would go


class MarkBody(BaseModel):
    """A piece of a drive, in seconds since its first report."""

    model_config = ConfigDict(extra="forbid")

    from_s: Seconds
    to_s: Seconds
    kind: Literal["good", "bad"]


def create_app(monitor: Monitor, road_map: RoadMap, token: str, host: str = "127.0.0.1") -> FastAPI:
    """The application; the monitor runs while it does, and is closed with it."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        task = asyncio.create_task(monitor.run())
        task.add_done_callback(_end_if_broken)
        yield
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        monitor.close()

    app = FastAPI(title="duckpilot monitor", docs_url=None, openapi_url=None, lifespan=lifespan)
    app.add_exception_handler(RequestValidationError, _malformed)
    app.add_exception_handler(ConfigError, _no_drive)
    app.add_middleware(AccessGate, token=token, host=host)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    _add_pages(app, monitor, draw_map(road_map))
    _add_control(app, monitor)
    return app


async def _malformed(_: Request, error: Exception) -> JSONResponse:
    """What is wrong, without what came: that may be anything, even what no answer can carry."""
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    return JSONResponse({"detail": tidy_text(f"{where}: {first['msg']}", 200)}, 422)


async def _no_drive(_: Request, error: Exception) -> JSONResponse:
    return JSONResponse({"detail": str(error)}, 404)


def _end_if_broken(task: asyncio.Task[None]) -> None:
    """A page whose monitor has died would show the past: end the program, so that it is seen."""
    if not task.cancelled() and task.exception() is not None:
        logging.getLogger(__name__).error("the monitor broke", exc_info=task.exception())
        signal.raise_signal(signal.SIGTERM)


def _add_pages(app: FastAPI, monitor: Monitor, drawing: dict[str, Any]) -> None:
    @app.get("/")
    async def page() -> FileResponse:
        return FileResponse(STATIC / "index.html")

    @app.get("/api/map")
    async def the_map() -> dict[str, Any]:
        return drawing

    # Not async: these read the disk, in a thread of their own.
    @app.get("/api/drives")
    def drives() -> list[dict[str, Any]]:
        return [asdict(drive) for drive in list_drives(monitor.drives)]

    @app.get("/api/drives/{name}")
    def drive(name: str) -> Response:  # written in this thread, and piece by piece
        told = ",".join(map(json.dumps, read_drive(monitor.drives, name)))
        return Response(f"[{told}]", media_type="application/json")

    @app.get("/api/drives/{name}/picture")
    def drive_picture(name: str, t_s: Seconds) -> Response:
        found = read_picture(monitor.drives, name, t_s)
        return Response(found[0], media_type=found[1]) if found else Response(status_code=204)

    @app.get("/api/drives/{name}/marks")
    def marks(name: str) -> list[dict[str, Any]]:
        return [piece._asdict() for piece in read_marks(monitor.drives, name)]

    @app.post("/api/drives/{name}/marks")
    def mark(name: str, pieces: list[MarkBody]) -> dict[str, Any]:
        try:
            write_marks(monitor.drives, name, [Piece(**piece.model_dump()) for piece in pieces])
        except ConfigError as error:
            return {"accepted": False, "reason": str(error)}
        return {"accepted": True, "reason": ""}


def _add_control(app: FastAPI, monitor: Monitor) -> None:
    @app.post("/api/command")
    async def command(body: CommandBody) -> dict[str, Any]:
        try:
            mission = Mission(body.destination, body.start) if body.destination else None
            if (body.arm and body.kind != "mission") or (body.start and mission is None):
                raise ContractError(f"{body.kind}: expected start and arm only with kind mission")
            if body.kind == "mission" and mission is not None:
                ack = await monitor.drive(mission, body.arm)
            else:
                ack = await monitor.command(body.kind, mission)
        except ContractError as error:  # of what does not belong together
            return {"accepted": False, "reason": str(error)}
        return {"accepted": ack.accepted, "reason": ack.reason}

    @app.websocket("/ws")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        page = Page(socket, monitor)
        sending = asyncio.create_task(page.send())
        try:
            await page.listen()
        finally:
            sending.cancel()
            monitor.page_closed(page)


class Page:
    """One open page: gets the newest state ten times a second and the newest pictures."""

    def __init__(self, socket: WebSocket, monitor: Monitor) -> None:
        self._socket = socket
        self._monitor = monitor
        self._refused, self._room = False, asyncio.Semaphore(UNSEEN)
        self._asked_s = -math.inf

    async def send(self) -> None:
        """Send until the page is gone; a slow page gets fewer, never older states."""
        log, frame = 0, 0
        while True:
            await self._room.acquire()
            snapshot = self._monitor.snapshot()
            entries = self._monitor.state.log_after(log)
            log = entries[-1].number if entries else log
            message = {"state": plain(snapshot), "log": plain(entries)}
            await self._socket.send_text(json.dumps(message, separators=(",", ":")))
            picture = self._monitor.state.frame
            if picture is not None and picture.sequence != frame:
                frame = picture.sequence
                await self._socket.send_bytes(picture.jpeg)
            await asyncio.sleep(SEND_EVERY_S)

    async def listen(self) -> None:
        """Read what the page shows and how it drives, until it is gone."""
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if text == "seen":
                self._monitor.page_showed(self)
                self._room.release()
            elif text == "stop":  # not behind requests that wait for one another
                self._stopping = asyncio.create_task(self._monitor.command("stop"))
            elif text is not None and len(text) <= TEXT_LIMIT:
                self._drive(text)

    def _drive(self, text: str) -> None:
        try:
            told = json.loads(text)["manual"]
            stick = None if told is None else Stick(*map(float, told))
            if isinstance(told, (str, dict)) or not all(abs(value) <= 1.0 for value in stick or ()):
                raise ValueError(told)
        except (ValueError, KeyError, TypeError, RecursionError):
            return  # not ours: an old page after an update
        self._monitor.page_showed(self)
        now_s = time.monotonic()
        if stick is not None and now_s - self._asked_s < MANUAL_EVERY_S:
            return  # faster than any hand: the next one comes in time
        self._asked_s = now_s
        taken = self._monitor.drive_by_hand(self, stick)
        if not taken and not self._refused:
            self._monitor.state.note("refused", "driving by hand: another page drives")
        self._refused = not taken


def draw_map(road_map: RoadMap) -> dict[str, Any]:
    """The drawing of a road map, for JSON, in metres of the world frame.

    ``lanes`` and ``centre_lines`` (between the two lanes of a tile, where nobody turns) are cubic
    Beziers x0, y0, ... x3, y3; ``floor`` are tiles without road, by their south-west corners.
    """
    size = road_map.tile_size_m
    bare = [tile for row in road_map.tiles for tile in row if not tile.is_road]
    last, told = road_map.rows - 1, ("kind", "x_m", "y_m", "heading_rad", "height_m")
    return {
        "name": road_map.name,
        "width_m": road_map.width_m,
        "height_m": road_map.height_m,
        "tile_size_m": size,
        "floor": [
            {"kind": tile.kind, "x_m": tile.column * size, "y_m": (last - tile.row) * size}
            for tile in bare
        ],
        "lanes": [_curve(lane.control_points_m) for lane in road_map.lanes],
        "centre_lines": _centre_lines(road_map.lanes),
        "objects": [{name: getattr(o, name) for name in told} for o in objects_of(road_map)],
    }


def _centre_lines(lanes: tuple[Lane, ...]) -> list[list[float]]:
    by_tile: dict[Tile, list[np.ndarray]] = {}
    for lane in lanes:
        by_tile.setdefault(lane.tile, []).append(lane.control_points_m)
    pairs = (curves for curves in by_tile.values() if len(curves) == 2)
    return [_curve((one + other[::-1]) / 2.0) for one, other in pairs]


def _curve(control_points_m: np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in control_points_m.ravel()]
