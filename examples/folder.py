"""The folder that the first word after an example names, or ``runs/examples``."""

import sys
from pathlib import Path

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
