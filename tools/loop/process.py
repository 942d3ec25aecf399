"""``Process``: one program of the bench."""

import os
import re
import signal
import subprocess
from pathlib import Path

END_S = 5.0


class Process:
    """One program of the bench; what it says is in ``log``, and what it hears is ``typed``."""

    def __init__(self, name: str, command: list[str], log: Path, typed: bool = False) -> None:
        self.name, self.log = name, log
        self.frozen = self.ending = False  # by a signal
        # where nohup has the bench ignore a hang-up, its programs would inherit that
        before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
        with log.open("ab") as output:
            self.child = subprocess.Popen(
                command,
                stdin=subprocess.PIPE if typed else subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                bufsize=0,
                env={**os.environ, "PYTHONUNBUFFERED": "1", "OMP_NUM_THREADS": "1"},
            )
        signal.signal(signal.SIGHUP, before)

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self.child.poll() is None

    @property
    def figures(self) -> dict[str, float]:
        """Resident memory [MB], threads and open files, now."""
        folder = Path(f"/proc/{self.child.pid}")
        (kb,) = re.findall(r"VmRSS:\s+(\d+)", (folder / "status").read_text(encoding="ascii"))
        return {
            "rss_mb": int(kb) / 1024.0,
            "threads": len(list((folder / "task").iterdir())),
            "files": len(list((folder / "fd").iterdir())),
        }

    def said(self) -> str:
        """Its output so far."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    def end(self) -> None:
        """By force, whatever it is doing."""
        self.child.kill()
        self.child.wait(END_S)
