"""The latency switch between real nodes: its process, its links, and traces that change them over time."""

from robotapp_testbed.switch.links import Link, LinkChange
from robotapp_testbed.switch.process import LatencySwitch
from robotapp_testbed.switch.replay import Replay
from robotapp_testbed.switch.traces import Trace

__all__ = ["LatencySwitch", "Link", "LinkChange", "Replay", "Trace"]
