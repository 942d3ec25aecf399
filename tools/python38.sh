#!/usr/bin/env bash
# Prints a Python 3.8: PYTHON38, else one on the PATH, else pyenv's newest; nothing where there is none.
for candidate in "${PYTHON38:-}" python3.8 "$HOME"/.pyenv/versions/3.8.*/bin/python3.8; do
  if [ -n "$candidate" ] && "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 8))' 2>/dev/null; then
    command -v "$candidate"
    exit 0
  fi
done
