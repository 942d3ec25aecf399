"""What the commands write."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, Dict, Optional

from robot import output

SCHEMA = 1
STDOUT = "-"


def write_json(target: str, plain: Dict[str, Any]) -> None:
    """JSON to a file, whole or not at all, or to standard output for ``-``."""
    if target == STDOUT:
        sys.stdout.write(json.dumps(plain, indent=1) + "\n")
        return
    output.write_json(Path(target), plain)


def expect_outputs(*targets: Optional[str], inputs: Dict[str, Any]) -> None:
    """Make sure, before the work, that these files can be written; ConfigError if not."""
    files = (Path(target) for target in targets if target not in (None, STDOUT))
    output.expect_writable(*files, inputs=[Path(each) for each in inputs.values() if each])
