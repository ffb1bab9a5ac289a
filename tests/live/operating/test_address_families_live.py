"""Ports of the operator and the scheduler over IPv6, over IPv4, and on a machine whose kernel has no IPv6."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from campaigns.rigs.ports import ask
from robotapp_testbed import ControlPlane
from robotapp_testbed.control_plane.product import start_operator, start_scheduler
from robotapp_testbed.processes.process import Process

pytestmark = pytest.mark.live

PROGRAMS = [start_operator, start_scheduler]
WITHOUT_IPV6 = """\
import errno, os, socket
class WithoutIPv6(socket.socket):
    def __init__(self, family=-1, *rest, **options):
        if family == socket.AF_INET6:
            raise OSError(errno.EAFNOSUPPORT, os.strerror(errno.EAFNOSUPPORT))
        super().__init__(family, *rest, **options)
socket.socket = WithoutIPv6
"""
"""Python runs it before a program as `sitecustomize`: sockets fail as they do where the kernel was started with `ipv6.disable=1`."""


def is_alive_at(process: Process, host: str) -> bool:
    """Whether the process answers at this address of the machine."""
    port = str(process.health_url).rsplit(":", 1)[1]
    return ask(f"https://{host}:{port}/readyz")[0] == 200


@pytest.mark.parametrize("start", PROGRAMS)
def test_a_port_answers_over_both_families(installed_plane: ControlPlane, start: Callable[..., Process]) -> None:
    if not Path("/proc/net/if_inet6").exists():
        pytest.skip("this machine has no IPv6: boot it without ipv6.disable=1")
    process = start(installed_plane, name="both-families")
    try:
        assert is_alive_at(process, "[::1]")
        assert is_alive_at(process, "127.0.0.1")
    finally:
        process.stop()


@pytest.mark.parametrize("start", PROGRAMS)
def test_a_port_answers_on_a_machine_without_ipv6(
    installed_plane: ControlPlane, start: Callable[..., Process], tmp_path: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(WITHOUT_IPV6)
    paths = os.pathsep.join(filter(None, (str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    process = start(installed_plane, name="without-ipv6", env={"PYTHONPATH": paths})
    try:
        assert is_alive_at(process, "127.0.0.1")
        with pytest.raises(OSError, match="refused"):
            is_alive_at(process, "[::1]")
    finally:
        process.stop()
