import subprocess
import sys

MUTED = """
import ctypes
from sim_pybullet.quiet import stdout_muted
libc = ctypes.CDLL(None)
print("before")
with stdout_muted():
    libc.puts(b"noise")
print("after")
libc.puts(b"compiled")
"""


def output_of(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_compiled_code_is_silent_only_meanwhile():
    assert sorted(output_of(MUTED)) == ["after", "before", "compiled"]


def test_importing_the_simulator_prints_nothing():
    assert output_of("import sim_pybullet.bullet") == []
