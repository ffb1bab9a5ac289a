"""Output that all verbs share: lines of progress, and the file that `--json` names."""

import json
import sys
import time
from pathlib import Path


def say(text: str) -> None:
    """Prints a line of progress with the time of day, beside the results."""
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def save(path: Path | None, figures: object) -> None:
    """Writes the figures of a run as JSON where a path is given."""
    if path is not None:
        path.write_text(json.dumps(figures, indent=1) + "\n")
