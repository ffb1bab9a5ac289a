"""The latency switch as a process of a cluster."""

from pathlib import Path

from robotapp_testbed.binaries import programs
from robotapp_testbed.failures import TestbedError
from robotapp_testbed.processes.process import Process
from robotapp_testbed.switch.control import Control

NAME = "latency-switch"
_LONGEST_SOCKET_PATH = 107  # sockaddr_un


class LatencySwitch(Control):
    """Joins real nodes; how long a frame takes between two of them, and whether it arrives, is set per pair.

    `process` is started, killed and ended like the other programs of the testbed. Needs root on Linux.
    """

    def __init__(self, *, run_dir: Path, seed: int = 0) -> None:
        super().__init__(run_dir / "switch.sock")
        if len(str(self.path)) > _LONGEST_SOCKET_PATH:
            raise TestbedError(f"the path of the switch's socket is too long: {self.path}")
        self.process = Process(
            NAME,
            [programs.build(NAME), "--control", str(self.path), "--seed", str(seed)],
            run_dir=run_dir,
            log_path=run_dir / f"{NAME}.log",
            ready=self._serves,
            before_start=lambda: self.path.unlink(missing_ok=True),
        )

    def start(self) -> "LatencySwitch":
        """Start it and wait until it takes commands."""
        self.process.start().wait_ready()
        return self

    def _serves(self) -> bool:
        try:
            self.nodes()
        except OSError:
            return False
        return True
