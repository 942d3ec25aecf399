"""``make package``: builds wheel and sdist, installs them as a stranger would, and uses them.

What the robot needs is installed by pip from nothing, on Python 3.8 with a Jetson Nano's versions
where a 3.8 is found, else on this Python. What the extras need is a gigabyte, which is not
downloaded again: each clean environment gets links to those packages of this environment that the
wheel's metadata ask for, and that those ask for in turn. What the metadata forget is missing there,
as it would be for a stranger. All of it happens in a folder outside the repository.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import re
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
import urllib.request
import zipfile
from pathlib import Path

from packaging.requirements import Requirement

from robot.command_line import answer
from tools.loop.bench import free_ports

ROOT = Path(__file__).parent.parent
PACKAGES = ("robot", "trainer", "sim_pybullet", "localizer_node", "tools")
MODEL = "robot/models/lane_dueling.onnx"
PICTURE = "P6 4 3 255 " + "duckpilot drives a robot on the road."[:36]
# Of each set of extras: what is called there, the exit status, and what it says.
CALLS: dict[str, tuple[tuple[str, int, str], ...]] = {
    "": (
        ("--help", 0, "calibrate"),
        ("infer --model {model} --images pictures --json out.json", 0, "STRAIGHT"),
        ("keygen keys", 0, "keys"),
        ("localizer locate --image pictures/a.ppm --calibration none.yaml", 2, "none.yaml"),
        ("train --out run", 2, "pip install '.[trainer"),
    ),
    "trainer": (
        ("train --algo ppo --preset debug --steps 64 --out run", 0, "run"),
        ("export run", 0, "model.onnx"),
        ("loop --laps 0.02 --model {model} --json laps.json", 0, "laps"),
        ("monitor --demo", 2, "pip install '.[monitor]'"),
    ),
    "monitor": (("monitor --demo", 2, "pip install '.[trainer"),),
    "trainer,monitor": (),  # served, see `serve`
    "trainer,scale": (("train --ray auto --out runs", 2, "running cluster"),),
}


def main() -> int:
    """Exit status 0 when every command did what it has to."""
    return answer("package", work)


def work() -> None:
    """Build, install, use; raises CalledProcessError or AssertionError where something is amiss."""
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="duckpilot-package-") as folder:
        place = Path(folder)
        wheel = build(place)
        for extras, calls in CALLS.items():
            python = clean_environment(place / (extras or "robot"), wheel, extras)
            use(python, calls)
            if extras == "trainer,monitor":
                serve(python)
        found = run("bash", "tools/python38.sh", check=False).strip()
        use(installed_by_pip(place / "pip", wheel, found or sys.executable), CALLS[""])
    print(f"package: {wheel.name} works, the robot's from {found or 'this Python, no 3.8 found'}")
    print(f"package: {time.monotonic() - begin:.0f} s")


def run(*words: object, check: bool = True) -> str:
    """What a command says, run in the checkout as a stranger would run it."""
    command = [str(word) for word in words]
    ended = subprocess.run(
        command, cwd=ROOT, env=environment(), check=check, stdout=subprocess.PIPE, text=True
    )
    return ended.stdout


def build(place: Path) -> Path:
    """Wheel and sdist of the checkout; both hold every file of the packages that git knows."""
    run(sys.executable, "-m", "hatchling", "build", "-d", place / "dist")
    (wheel,) = (place / "dist").glob("*.whl")
    (sdist,) = (place / "dist").glob("*.tar.gz")
    listed = run("git", "ls-files", *PACKAGES).split("\n")[:-1]
    with zipfile.ZipFile(wheel) as archive:
        packed = set(archive.namelist())
    with tarfile.open(sdist) as source:
        told = {name.partition("/")[2] for name in source.getnames()}
    for what, names in (("wheel", packed), ("sdist", told)):
        absent = [name for name in listed if name not in names and (ROOT / name).exists()]
        assert not absent, f"{what}: expected every file of the packages, lacks {absent}"
    return wheel


def clean_environment(folder: Path, wheel: Path, extras: str) -> Path:
    """The Python of an environment with the wheel and what it asks for, by links."""
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    python = folder / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python)
    run(*pip, "install", "-qq", "--no-deps", "--no-index", wheel)
    (site,) = folder.glob("lib/python*/site-packages")
    (own,) = importlib.metadata.distributions(name="duckpilot", path=[str(site)])
    for name in sorted(asked_for(own.requires or [], set(extras.split(",")))):
        package = importlib.metadata.distribution(name)
        tops = {file.parts[0] for file in package.files or [] if file.parts[0] != ".."}
        for top in tops - {"__pycache__"}:
            with contextlib.suppress(FileExistsError):  # google, which several packages share
                (site / top).symlink_to(Path(str(package.locate_file(top))))
    return python


def asked_for(requirements: list[str], extras: set[str]) -> set[str]:
    """The names of all packages that these requirements lead to."""
    found: dict[str, set[str]] = {}
    waiting = [(text, extras) for text in requirements]
    while waiting:
        text, of = waiting.pop()
        wanted = Requirement(text)
        if wanted.marker and not any(wanted.marker.evaluate({"extra": e}) for e in of | {""}):
            continue
        name = re.sub(r"[-_.]+", "-", wanted.name).lower()
        if name in found and wanted.extras <= found[name]:
            continue
        found.setdefault(name, set()).update(wanted.extras)
        version = importlib.metadata.version(name)
        assert wanted.specifier.contains(version, prereleases=True), f"{text}: {version} is here"
        waiting += [(t, found[name]) for t in importlib.metadata.requires(name) or []]
    return set(found)


def installed_by_pip(folder: Path, wheel: Path, python: str) -> Path:
    """The Python of an environment that pip filled from nothing."""
    run(python, "-m", "venv", folder)
    nano = () if python == sys.executable else ("--constraint", ROOT / "constraints-nano.txt")
    run(folder / "bin" / "python", "-m", "pip", "install", "-qq", wheel, *nano)
    return folder / "bin" / "python"


def environment() -> dict[str, str]:
    """That of a stranger: nothing of ours is found by accident."""
    return {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}


def use(python: Path, calls: tuple[tuple[str, int, str], ...]) -> None:
    """Call ``duckpilot`` from an empty folder."""
    here = python.parent.parent / "used"
    (here / "pictures").mkdir(parents=True)
    (here / "pictures" / "a.ppm").write_text(PICTURE)
    (model,) = python.parent.parent.glob(f"lib/python*/site-packages/{MODEL}")
    for call, status, said in calls:
        words = [word.format(model=model) for word in call.split()]
        ended = subprocess.run(
            [str(python.with_name("duckpilot")), *words],
            cwd=here,
            env=environment(),
            capture_output=True,
            text=True,
            check=False,
        )
        told = ended.stdout + ended.stderr
        assert ended.returncode == status, f"duckpilot {call}: {ended.returncode}: {told}"
        assert said in told, f"duckpilot {call}: expected {said!r}, got: {told}"
        print(f"package: {python.parent.parent.name}: duckpilot {call}")


def serve(python: Path) -> None:
    """The monitor's page, its files and its simulated robot come from the wheel."""
    here, port = python.parent.parent / "used", free_ports(1)
    server = subprocess.Popen(
        [str(python.with_name("duckpilot")), "monitor", "--demo", "--port", str(port)],
        cwd=here,
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert server.stdout is not None
        address = next(line for line in server.stdout if "http" in line).split()[-1]
        for path in ("", "static/app.js"):
            with urllib.request.urlopen(address.replace("/?", f"/{path}?"), timeout=20) as page:
                assert page.status == 200
        print("package: monitor: duckpilot monitor serves its page")
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(timeout=20)


if __name__ == "__main__":
    sys.exit(main())
