"""Our scheduler without pod events, to see what they cost: `python -m campaigns.free_api.silent [flags]`."""

import sys
from typing import Any
from unittest.mock import patch

from robotapp_scheduler.main import main
from robotapp_scheduler.shell.status.event_recorder import PodEvents


def nothing(*_: Any, **__: Any) -> None: ...


if __name__ == "__main__":
    with patch.object(PodEvents, "pod_event", nothing):
        sys.exit(main())
