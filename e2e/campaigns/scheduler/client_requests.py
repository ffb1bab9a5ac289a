"""What a request and a watch event cost the client, in µs of its CPU: python e2e/campaigns/scheduler/client_requests.py

The server is a stub in another process that answers as cheaply as possible, so the figures are the client's own.
Use ratios between variants; absolute values belong to the machine.
"""

import argparse
import asyncio
import json
import ssl
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import uvloop

from robotapp_client import ApiClient, Endpoint
from robotapp_client.informer.watch_decoder import WatchDecoder
from robotapp_client.transport.credentials import Credentials

BODY = json.dumps(
    {
        "apiVersion": "v1",
        "kind": "Binding",
        "metadata": {"name": "driver-7d9c9c9c9c-abcde", "namespace": "robots", "uid": "x" * 36},
        "target": {"apiVersion": "v1", "kind": "Node", "name": "node-0001"},
    }
).encode()
ANSWER = b'{"kind":"Status","apiVersion":"v1","metadata":{},"status":"Success","code":201}'
REPLY = b"HTTP/1.1 201 Created\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n%s" % (
    len(ANSWER),
    ANSWER,
)


class Stub(asyncio.Protocol):
    """Answers every request of a keep-alive connection with the same bytes."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.rest = b""

    def data_received(self, data: bytes) -> None:
        self.rest += data
        while (end := self.rest.find(b"\r\n\r\n")) >= 0:
            at = self.rest.find(b"Content-Length: ") + 16
            size = end + 4 + int(self.rest[at : self.rest.index(b"\r\n", at)])
            if len(self.rest) < size:
                return
            self.rest = self.rest[size:]
            self.transport.write(REPLY)  # type: ignore[attr-defined]


async def serve(certificate: str) -> None:
    context = None
    if certificate:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate)
    server = await asyncio.get_running_loop().create_server(Stub, "127.0.0.1", 0, ssl=context)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


async def post(url: str, tls: ssl.SSLContext | None, *, flying: int, requests: int) -> tuple[float, float]:
    """(CPU µs per request, requests per second)"""
    endpoint = Endpoint(url, tls, Credentials.fixed("t" * 900))
    path = "/api/v1/namespaces/robots/pods/driver-7d9c9c9c9c-{}/binding"
    async with ApiClient(endpoint, user_agent="bench", max_connections=flying) as client:

        async def worker(count: int) -> None:
            for number in range(count):
                await client.post_raw(path.format(number), BODY)

        await asyncio.gather(*(worker(20) for _ in range(flying)))
        cpu, wall = time.process_time(), time.perf_counter()
        await asyncio.gather(*(worker(requests // flying) for _ in range(flying)))
        return (time.process_time() - cpu) / requests * 1e6, requests / (time.perf_counter() - wall)


class Meta(msgspec.Struct, rename="camel", gc=False):
    name: str
    namespace: str
    uid: str
    resource_version: str
    labels: dict[str, str] = {}


class Pod(msgspec.Struct, gc=False):
    metadata: Meta


def decode(as_type: Any, *, events: int) -> float:
    """µs per MODIFIED event of a 5 kB pod, decoded and identified."""
    meta = {"name": "p", "namespace": "n", "uid": "u", "resourceVersion": "1", "labels": {"a": "b"}}
    fields = [{"manager": "m", "fieldsV1": {f"f:{number}": {"f:x": {}} for number in range(100)}} for _ in range(2)]
    spec = {"containers": [{"name": f"c{n}", "image": "i", "env": [{"name": "A", "value": "b"}] * 8} for n in range(4)]}
    obj = {"kind": "Pod", "metadata": meta | {"managedFields": fields}, "spec": spec, "status": {"phase": "Running"}}
    line = msgspec.json.encode({"type": "MODIFIED", "object": obj})
    decoder = WatchDecoder(as_type, namespaced=True)
    decoder.event(line)
    started = time.process_time()
    for _ in range(events):
        decoder.event(line)
    print(f"  {len(line)} bytes", end="")
    return (time.process_time() - started) / events * 1e6


def start_stub(certificate: str) -> tuple["subprocess.Popen[str]", int]:
    stub = subprocess.Popen([sys.executable, __file__, "--serve", certificate], stdout=subprocess.PIPE, text=True)
    assert stub.stdout is not None
    return stub, int(stub.stdout.readline())


def measure(folder: Path, requests: int) -> None:
    pem = folder / "pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"),
            *("-days", "2", "-subj", "/CN=stub", "-keyout", str(pem), "-out", str(pem) + ".crt"),
        ],
        check=True,
        capture_output=True,
    )
    pem.write_text(pem.read_text() + Path(f"{pem}.crt").read_text())
    loops: dict[str, Callable[[Coroutine[Any, Any, Any]], Any]] = {"asyncio": asyncio.run, "uvloop": uvloop.run}
    for scheme, certificate in (("http", ""), ("https", str(pem))):
        stub, port = start_stub(certificate)
        try:
            for name, run in loops.items():
                for flying in (1, 16, 32):
                    tls = ssl._create_unverified_context() if certificate else None  # noqa: S323 - loopback stub
                    cpu, rate = run(post(f"{scheme}://127.0.0.1:{port}", tls, flying=flying, requests=requests))
                    print(f"post_raw {scheme:5} {name:7} {flying:2} in flight: {cpu:5.0f} µs CPU, {rate:6.0f}/s")
        finally:
            stub.kill()
            stub.wait()
    for as_type in (Pod, dict):
        print(f", watch event as {as_type.__name__}: {decode(as_type, events=20_000):.1f} µs CPU")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=8000)
    parser.add_argument("--serve", nargs="?", const="", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve is not None:
        uvloop.run(serve(arguments.serve))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            measure(Path(temporary), arguments.requests)
