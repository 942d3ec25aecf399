import subprocess
import sys

MUTED = """
import os
from sim_pybullet.stderr import stderr_muted
os.write(2, b"before ")
with stderr_muted():
    os.write(2, b"noise ")
os.write(2, b"after")
"""


def said_by(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout + done.stderr


def test_compiled_code_is_silent_only_meanwhile():
    assert said_by(MUTED) == "before after"


def test_importing_the_simulator_prints_nothing():
    assert said_by("import sim_pybullet.bullet") == ""
