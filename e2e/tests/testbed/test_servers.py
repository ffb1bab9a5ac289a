import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest
import yaml

from robotapp_testbed.control_plane import servers
from robotapp_testbed.control_plane.api import Api
from robotapp_testbed.control_plane.components import Layout, Settings
from robotapp_testbed.control_plane.servers import Builder, Program


class Handler(http.server.BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/healthz" else 503)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class names it so
        del format, args


@pytest.fixture
def url() -> Iterator[str]:
    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def test_only_success_is_an_answer(url: str) -> None:
    assert servers.answers(f"{url}/healthz")
    assert not servers.answers(f"{url}/readyz")


def test_nobody_there_is_no_answer() -> None:
    assert not servers.answers("http://127.0.0.1:9/healthz")


@pytest.fixture
def layout(tmp_path: Path) -> Layout:
    return Layout(tmp_path, 1, 2, 3, 4)


def scheduler_config(layout: Layout, wanted: bool | str | Path) -> dict[str, object]:
    builder = Builder(layout, Settings(), {}, cast(Api, None))
    config: dict[str, object] = yaml.safe_load(builder._write_scheduler_config(wanted).read_text())
    return config


def test_kube_scheduler_gets_the_configuration_for_comparisons(layout: Layout) -> None:
    config = scheduler_config(layout, wanted=True)
    assert config["parallelism"] == 1
    assert config["clientConnection"]["kubeconfig"] == str(layout.kubeconfig(Program.SCHEDULER))  # type: ignore[index]  # a JSON tree


def test_the_callers_configuration_keeps_all_but_connection_and_election(layout: Layout, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    mine = {
        "profiles": [{"schedulerName": "mine"}],
        "clientConnection": {"qps": 50, "kubeconfig": "/else"},
        "leaderElection": {"leaderElect": True},
    }
    path.write_text(yaml.safe_dump(mine))
    config = scheduler_config(layout, path)
    assert config["profiles"] == [{"schedulerName": "mine"}]
    assert config["clientConnection"] == {"qps": 50, "kubeconfig": str(layout.kubeconfig(Program.SCHEDULER))}
    assert config["leaderElection"] == {"leaderElect": False}
    assert yaml.safe_load(path.read_text()) == mine, "the caller's file is left alone"


def test_a_program_gets_the_environment_that_is_meant_for_it(layout: Layout) -> None:
    settings, api = (
        Settings(environment={Program.ETCD: {"GOGC": "400"}}),
        Api("https://127.0.0.1:9", ca_file=Path(), token=""),
    )
    builder = Builder(layout, settings, {program: Path("/bin/true") for program in Program}, api)
    plain = {"HOME": str(layout.run_dir), "PATH": ""}
    found = [builder._process(program, [])._env for program in (Program.ETCD, Program.KWOK)]
    assert found == [{**plain, "GOGC": "400"}, plain]
