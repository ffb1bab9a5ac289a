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
    """Relative path and content of the ordinary files; links, devices and paths that lead out of the folder are passed over.

    A container can write any archive: a sparse file of a few bytes stands for terabytes, a size can be larger than any memory
    address, and headers can follow headers until Python's stack ends. All that is an ArchiveError.
    """
    left = len(data)
    try:
        with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as archive:
            for count, member in enumerate(archive):
                if count >= MAX_FILES:
                    raise ArchiveError(f"has more than {MAX_FILES} files")
                if not member.isreg() or not _is_inside(member.name):
                    continue
                left -= max(member.size, 0)
                if left < 0:
                    raise ArchiveError(f"is no archive: the files are larger than its {len(data)} bytes")
                content = archive.extractfile(member)
                if content is not None:
                    yield PurePosixPath(member.name), content.read()
    except (tarfile.TarError, EOFError, ValueError, ArithmeticError, LookupError, RecursionError) as error:
        raise ArchiveError(f"is no archive: {error}") from error


def _is_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts and "\0" not in name
