"""`robotapp-recorder`: record, list, info."""

import json
import sys
from collections.abc import Sequence

from robotapp_recorder.listing import list_bags, read_info
from robotapp_recorder.settings import Settings, make_parser, read_settings
from robotapp_recorder.store import BagStore


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns the exit code; 2 for wrong arguments, 1 where bags cannot be read or written."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = make_parser().parse_args(given)
    try:
        if options.verb == "record":
            return record(read_settings(given[1:]))
        answer = list_bags(options.folder) if options.verb == "list" else read_info(options.folder / options.bag)
    except (ValueError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2 if isinstance(error, ValueError) else 1
    sys.stdout.write(json.dumps(answer) + "\n")
    return 0


def record(settings: Settings) -> int:
    """Records until SIGTERM."""
    from robotapp_recorder.node import record as record_topics  # rclpy is in images with ROS alone
    from robotapp_recorder.node import tell

    store = BagStore(settings.folder, settings.name, settings.limits)
    for line in store.open():
        tell(line)
    record_topics(settings.selection, store)
    return 0
