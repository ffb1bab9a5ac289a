"""The control socket's client against a socket that answers from a script."""

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robotapp_testbed.failures import TestbedError
from robotapp_testbed.switch import LatencySwitch, Link
from robotapp_testbed.switch.control import Control, SwitchRefusedError, samples

TEXT = """# TYPE latency_switch_frames_total counter
latency_switch_frames_total{from="a",to="b"} 7
latency_switch_frames_total{from="b",to="a"} 3
latency_switch_frames_total_other 9
latency_switch_ports 2
"""


@contextmanager
def answering(tmp_path: Path, *answers: bytes) -> Iterator[tuple[Control, list[dict[str, Any]]]]:
    """Each connection gets the next answer; what was asked is collected."""
    asked: list[dict[str, Any]] = []
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "s"))
        server.listen()

        def serve() -> None:
            for answer in answers:
                connection, _ = server.accept()
                with connection, connection.makefile() as lines:
                    asked.append(json.loads(lines.readline()))
                    connection.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        yield Control(tmp_path / "s"), asked
        thread.join()


def test_commands_are_one_line_of_json(tmp_path: Path) -> None:
    with answering(tmp_path, *[b'{"ok": true}\n'] * 4) as (control, asked):
        control.attach("a", pid=12, tap="lat0", bridge="cni0")
        control.set_link("a", "b", delay_ms=3)
        control.set_node("a", down=True)
        control.detach("a")
    assert asked == [
        {"op": "attach", "node": "a", "pid": 12, "tap": "lat0", "bridge": "cni0"},
        {"op": "set", "links": [{"from": "a", "to": "b", "one_way": False, "delay_ms": 3}]},
        {"op": "set", "links": [{"node": "a", "down": True}]},
        {"op": "detach", "node": "a"},
    ]


def test_the_state_is_read(tmp_path: Path) -> None:
    link = {"delay_ms": 1.5, "jitter_ms": 0, "loss": 0, "mbit_s": 0, "buffer_ms": 200, "down": False}
    state = json.dumps({"ok": True, "nodes": ["a", "b"], "links": [{"from": "a", "to": "b", **link}]}).encode() + b"\n"
    with answering(tmp_path, state, b'{"ok": true}\n', state) as (control, _):
        assert control.links() == {("a", "b"): Link(delay_ms=1.5)}
        assert control.nodes() == []
        assert control.nodes() == ["a", "b"]


def test_metrics_are_text_and_samples_are_read_from_it(tmp_path: Path) -> None:
    answer = json.dumps({"ok": True, "metrics": TEXT}).encode() + b"\n"
    with answering(tmp_path, answer, answer) as (control, _):
        assert control.metrics() == TEXT
        assert control.counts("frames_total") == {("a", "b"): 7, ("b", "a"): 3}
    assert samples(TEXT, "latency_switch_ports") == {(): 2}


def test_a_refusal_says_why(tmp_path: Path) -> None:
    with answering(tmp_path, b'{"ok": false, "error": "links[0]: no node"}\n') as (control, _):  # noqa: SIM117 - read in order
        with pytest.raises(SwitchRefusedError, match=r"latency switch, set: links\[0\]: no node"):
            control.set_link("a", "b", delay_ms=1)


def test_a_switch_that_ends_meanwhile_is_an_os_error(tmp_path: Path) -> None:
    with answering(tmp_path, b'{"ok": ') as (control, _), pytest.raises(ConnectionResetError):
        control.nodes()
    (tmp_path / "s").unlink()
    with pytest.raises(FileNotFoundError):
        control.nodes()


def test_a_folder_that_is_too_deep_for_a_socket_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TestbedError, match="too long"):
        LatencySwitch(run_dir=tmp_path / ("x" * 120))
