"""Real kubelet nodes on this machine, beside the simulated ones: Linux, root and a few packages."""

from robotapp_testbed.real.cluster import RealNodes
from robotapp_testbed.real.node import RealNode
from robotapp_testbed.real.prerequisites import UnavailableError

__all__ = ["RealNode", "RealNodes", "UnavailableError"]
