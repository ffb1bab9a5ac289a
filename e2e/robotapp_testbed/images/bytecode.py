"""Compile what an image holds with the image's own interpreter: a container then starts in a fraction of the time.

Files are marked as never to be checked against their source, so that they hold no times.
"""

import subprocess
from pathlib import Path

from robotapp_testbed.failures import TestbedError


def python_version(base: Path) -> str:
    """ "3.11" of the interpreter in the layer `base`."""
    return (base / "usr" / "bin" / "python3").readlink().name.removeprefix("python")


def compile_all(base: Path, layer: Path, folder: str) -> None:
    """All modules below `folder` of `layer`. Started through the layer's own loader: needs neither root nor this machine's libc."""
    (loader,) = (base / "usr").glob("lib*/ld-linux-*.so.*")
    libraries = ":".join(str(path) for path in (base / "usr" / "lib").glob("*-linux-gnu"))
    interpreter = base / "usr" / "bin" / f"python{python_version(base)}"
    command: list[str | Path] = [
        loader,
        "--library-path",
        libraries,
        interpreter,
        "-S",
        "-m",
        "compileall",
        "-q",
        "-j1",
    ]
    command += ["--invalidation-mode=unchecked-hash", "-s", layer, "-p", "/", layer / folder]
    # A fixed hash seed: constants that are sets are written in the order of their hashes.
    env = {"PYTHONHOME": str(base / "usr"), "PYTHONHASHSEED": "0", "PYTHONDONTWRITEBYTECODE": "1"}
    result = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if result.returncode > 1:  # 1: some file is not valid in this version, as among the standard library's tests
        raise TestbedError(f"{layer / folder} could not be compiled: {result.stderr.strip()[-500:]}")
