"""Download official release binaries, verified against the checksum file published beside each.

Meant to be quick or not at all: a source that cannot be reached, is too slow or sends something else than announced
is given up, and the binary is compiled instead.
"""

import hashlib
import http.client
import os
import tarfile
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from pathlib import Path

from robotapp_testbed.binaries import pins

CONNECT_TIMEOUT_S = 3.0
_CHUNK_BYTES = 1 << 18
_JUDGE_AFTER_S = 5.0
_CHECKSUM_FILE_BYTES = 1 << 20
_SHA256_DIGITS = 64


class ReleaseProblem(Exception):  # noqa: N818 - an ordinary outcome, handled by compiling
    """Why a binary could not be had from its official release."""


def base_urls(env: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Base URL per source; ROBOTAPP_RELEASES_KUBERNETES, …_ETCD and …_HELM override."""
    return {source: env.get(f"ROBOTAPP_RELEASES_{source.upper()}", url) for source, url in pins.BASE_URLS.items()}


def expected_digest(text: str, file_name: str) -> str:
    """The SHA-256 of `file_name` in a checksum file: either a bare digest or lines `digest  name`."""
    for line in text.splitlines():
        fields = line.split()
        named = len(fields) == 2 and Path(fields[1].lstrip("*")).name == file_name
        if fields and len(fields[0]) == _SHA256_DIGITS and (named or len(fields) == 1):
            return fields[0].lower()
    raise ReleaseProblem(f"the published checksum file does not mention {file_name}")


class Downloader:
    """Fetches from the sources that answer; one failure to reach a source ends all further tries there."""

    def __init__(
        self,
        urls: Mapping[str, str],
        *,
        timeout_s: float = CONNECT_TIMEOUT_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._urls = dict(urls)
        self._timeout_s = timeout_s
        self._clock = clock

    def offers(self, binary: pins.Binary) -> bool:
        return binary.release is not None and bool(self._urls.get(binary.release.source))

    def fetch(self, binary: pins.Binary, target: Path, *, note: Callable[[str], None] = lambda _: None) -> None:
        """Write the verified binary to `target`; ReleaseProblem when that is not possible soon."""
        release = binary.release
        if release is None:
            raise ReleaseProblem(f"{binary.name} has no verifiable official release")
        names = pins.platform_names()
        base = self._urls[release.source].rstrip("/")
        file_url = f"{base}/{release.file.format(**names)}"
        try:
            checksums = self._read(f"{base}/{release.checksums.format(**names)}")
            digest = expected_digest(checksums, Path(file_url).name)
            archive = target.with_name(f"{target.name}.download")
            try:
                self._copy(file_url, archive, digest=digest, patience_s=float(binary.compile_s), note=note)
                _unpack(archive, release.member.format(**names), target)
            finally:
                archive.unlink(missing_ok=True)
        except (OSError, http.client.HTTPException) as error:
            self._urls[release.source] = ""
            reason = getattr(error, "reason", None) or error
            raise ReleaseProblem(f"no usable answer from {base} ({reason})") from error

    def _read(self, url: str) -> str:
        started_s, text = self._clock(), b""
        with self._open(url) as response:
            while len(text) < _CHECKSUM_FILE_BYTES and (chunk := response.read1(_CHUNK_BYTES)):
                text += chunk
                if self._clock() - started_s > _JUDGE_AFTER_S:
                    raise TimeoutError("its checksum file only trickles in")
        return text.decode("utf-8", "replace")

    def _open(self, url: str) -> http.client.HTTPResponse:
        if not url.startswith(("https://", "http://")):
            raise ReleaseProblem(f"{url} is not an http address")
        response: http.client.HTTPResponse = urllib.request.urlopen(url, timeout=self._timeout_s)  # noqa: S310 - scheme checked above
        return response

    def _copy(self, url: str, target: Path, *, digest: str, patience_s: float, note: Callable[[str], None]) -> None:
        started_s = self._clock()
        seen = hashlib.sha256()
        with self._open(url) as response, target.open("wb") as file:
            total = int(response.headers.get("Content-Length") or 0)
            done = 0
            while chunk := response.read1(_CHUNK_BYTES):  # read() would wait for a full chunk, however slow
                file.write(chunk)
                seen.update(chunk)
                done += len(chunk)
                note(f"{done / 1e6:.0f} of {total / 1e6:.0f} MB")
                took_s = self._clock() - started_s
                if took_s > _JUDGE_AFTER_S and took_s * max(total, done) / done > patience_s:
                    raise TimeoutError(f"{done / took_s / 1e3:.0f} kB/s is slower than compiling")
        if seen.hexdigest() != digest:
            raise ReleaseProblem(f"{url} does not match its published checksum and was thrown away")


def _unpack(archive: Path, member: str, target: Path) -> None:
    if not member:
        archive.replace(target)
        return
    try:
        with tarfile.open(archive, "r:gz") as tar:
            source = tar.extractfile(member)  # one named file, streamed: nothing else of the archive touches the disk
            if source is None:
                raise ReleaseProblem(f"{member} in the downloaded archive is not a file")
            with source, target.open("wb") as file:
                while chunk := source.read(_CHUNK_BYTES):
                    file.write(chunk)
    except (tarfile.TarError, KeyError) as error:
        raise ReleaseProblem(f"the downloaded archive holds no {member}") from error
