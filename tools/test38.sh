#!/usr/bin/env bash
# The robot's tests on Python 3.8 with the exact wheels of a Jetson Nano.
# What takes longest does not depend on the Python, nor do laws on the number of examples: both are
# tried in full on 3.11 only.
# PYTHON38 names the interpreter; without one (pyenv's are looked for too) it says so and passes.
set -euo pipefail
python38=$(bash tools/python38.sh)
if [ -z "$python38" ]; then
  echo "test38: skipped: no Python 3.8 on this machine (set PYTHON38=/path/to/python3.8)"
  exit 0
fi
if [ ! -e .venv38/.installed ] || [ constraints-nano.txt -nt .venv38/.installed ]; then
  "$python38" -m venv --clear .venv38
  .venv38/bin/python -m pip install --quiet --constraint constraints-nano.txt --editable . pytest pytest-timeout pytest-xdist hypothesis
  touch .venv38/.installed
fi
HYPOTHESIS_PROFILE=quick exec .venv38/bin/python -m pytest --numprocesses 2 -m 'not slow' tests/robot tests/localizer_node
