"""A real Kubernetes control plane on one machine for tests, benchmarks and the demo: no container runtime, no root."""

from robotapp_testbed.control_plane.controlplane import ControlPlane
from robotapp_testbed.control_plane.identity import Identity
from robotapp_testbed.failures import ApiStatusError, CommandError, TestbedError
from robotapp_testbed.processes.process import Process, wait_until

__all__ = ["ApiStatusError", "CommandError", "ControlPlane", "Identity", "Process", "TestbedError", "wait_until"]
