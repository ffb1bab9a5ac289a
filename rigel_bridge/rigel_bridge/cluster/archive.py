"""Files out of a tar archive that a container made, which need not be what it should be. Pure but for the archive's bytes."""

import io
import tarfile
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Final

MAX_FILES: Final = 10_000


class ArchiveError(Exception):
    """Why an archive is not taken."""


def files_of(data: bytes) -> Iterator[tuple[PurePosixPath, bytes]]:
    """Relative path and content of the ordinary files; links, devices and paths that lead out of the folder are passed over."""
    try:
        with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as archive:
            for count, member in enumerate(archive):
                if count >= MAX_FILES:
                    raise ArchiveError(f"has more than {MAX_FILES} files")
                path = PurePosixPath(member.name)
                content = archive.extractfile(member) if member.isreg() else None
                if content is not None and path.parts and not path.is_absolute() and ".." not in path.parts:
                    yield path, content.read()
    except (tarfile.TarError, EOFError, ValueError) as error:
        raise ArchiveError(f"is no archive: {error}") from error
