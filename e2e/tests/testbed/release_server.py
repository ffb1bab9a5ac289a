"""A local stand-in for the official release hosts, able to misbehave."""

import hashlib
import io
import tarfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from robotapp_testbed.binaries import pins


@dataclass
class ReleaseServer:
    """`files` by path, and how long to sleep after each byte of it that is sent; `requests` are the paths asked for."""

    url: str
    files: dict[str, bytes] = field(default_factory=dict)
    requests: list[str] = field(default_factory=list)
    trickle_s: dict[str, float] = field(default_factory=dict)
    stop: threading.Event = field(default_factory=threading.Event)

    def publish(self, binary: pins.Binary, content: bytes, *, digest: str | None = None) -> None:
        """Put the binary where its project would, with its checksum file (a wrong one when `digest` is given)."""
        release = binary.release
        assert release is not None
        names = pins.platform_names()
        path = release.file.format(**names)
        member = release.member.format(**names)
        data = archive(member, content) if member else content
        right = digest or hashlib.sha256(data).hexdigest()
        text = (
            right
            if release.checksums.endswith(".sha256")
            else f"{'0' * 64}  other.tar.gz\n{right}  {path.rsplit('/', 1)[-1]}\n"
        )
        self.files[f"/{path}"] = data
        self.files[f"/{release.checksums.format(**names)}"] = text.encode()

    def base_urls(self) -> dict[str, str]:
        return dict.fromkeys(pins.BASE_URLS, self.url)


def archive(member: str, content: bytes) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        info = tarfile.TarInfo(member)
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))
    return buffer.getvalue()


def handler(server: ReleaseServer) -> type[BaseHTTPRequestHandler]:
    """Answers with the server's `files`."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            server.requests.append(self.path)
            data = server.files.get(self.path)
            if data is None:
                self.send_error(404)
                return
            self.send_response(200)
            if self.path.endswith("/"):
                self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self._send(data)

        def _send(self, data: bytes) -> None:
            try:
                pause_s = server.trickle_s.get(self.path, 0)
                for start in range(0, len(data), 1 if pause_s else len(data)):
                    self.wfile.write(data[start : start + 1] if pause_s else data)
                    if server.stop.is_set():
                        return
                    time.sleep(pause_s)
            except (BrokenPipeError, ConnectionResetError):
                pass  # the client gave up, which is what the test is about

        def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class names it so
            del format, args

    return Handler


@contextmanager
def serving() -> Iterator[ReleaseServer]:
    server = ReleaseServer(url="")
    with ThreadingHTTPServer(("127.0.0.1", 0), handler(server)) as http:
        http.daemon_threads = True
        server.url = f"http://127.0.0.1:{http.server_address[1]}"
        thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield server
        finally:
            server.stop.set()
            http.shutdown()
            thread.join()
