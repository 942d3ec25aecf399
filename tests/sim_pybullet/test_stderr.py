import subprocess
import sys


def said_by(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout + done.stderr


def test_importing_the_simulator_prints_nothing():
    assert said_by("import sim_pybullet.bullet") == ""
