"""Archives: content of an image belongs to root and carries no times, and comes out as it went in."""

import io
import tarfile
from pathlib import Path

from robotapp_testbed.images import oci


def read_layer(archive: Path) -> bytes:
    """Returns the only file of the archive that is itself an archive."""
    with tarfile.open(archive) as tar:
        files = [tar.extractfile(member) for member in tar if member.isfile()]
        contents = [file.read() for file in files if file is not None]
    (layer,) = (content for content in contents if tarfile.is_tarfile(io.BytesIO(content)))
    return layer


def test_members_belong_to_root_with_plain_modes_and_no_times(tmp_path: Path) -> None:
    folder = tmp_path / "content"
    (folder / "bin").mkdir(parents=True)
    for name, mode in (("bin/app", 0o750), ("data", 0o600)):
        (folder / name).write_text("content")
        (folder / name).chmod(mode)
    (folder / "link").symlink_to("bin")
    (folder / "tmp").mkdir()
    (folder / "tmp").chmod(0o1777)
    oci.write(tmp_path / "a.tar", "n:t", [folder], oci.Config(entrypoint=["/bin/app"], architecture="amd64"))
    with tarfile.open(fileobj=io.BytesIO(read_layer(tmp_path / "a.tar"))) as tar:
        members = tar.getmembers()
    assert {(member.uid, member.gid, member.uname, member.mtime) for member in members} == {(0, 0, "", 0)}
    modes = {member.name: member.mode for member in members if not member.issym()}
    assert modes == {"bin": 0o755, "bin/app": 0o755, "data": 0o644, "tmp": 0o1777}


def test_an_unpacked_archive_has_the_files_of_all_layers_with_the_upper_one_on_top(tmp_path: Path) -> None:
    lower, upper, root = tmp_path / "lower", tmp_path / "upper", tmp_path / "root"
    for layer in (lower, upper):
        (layer / "usr" / "bin").mkdir(parents=True)
        (layer / "bin").symlink_to("usr/bin")
        (layer / "usr" / "bin" / layer.name).write_text(layer.name)
        (layer / "both").write_text(layer.name)
    oci.write(tmp_path / "a.tar", "n:t", [lower, upper], oci.Config(entrypoint=["/bin/app"], architecture="amd64"))
    oci.unpack(tmp_path / "a.tar", root)
    assert (root / "both").read_text() == "upper"
    assert sorted(path.name for path in (root / "bin").iterdir()) == ["lower", "upper"]
