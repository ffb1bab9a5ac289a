"""A Zenoh router, in place of `ros2 run rmw_zenoh_cpp rmw_zenohd`: python3 -m ros_nodes.zenoh.router."""

import signal

from ros_nodes.connect import end_on_request
from ros_nodes.zenoh.sessions import open_session


def main() -> None:
    """Routes until its pod is to end."""
    end_on_request()
    session = open_session("router")
    print("router", session.info.zid(), flush=True)
    signal.pause()


if __name__ == "__main__":
    main()
