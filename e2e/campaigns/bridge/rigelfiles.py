"""Thousands of made Rigelfiles: read by Rigel 0.2.22 and by us, and broken ones that must end in lines and a code."""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from tests.support.rigel.cases import ENVIRONMENT, first_generation, mutated

from campaigns.bridge.bridge_watch import run
from rigel_bridge.document.failures import BridgeError
from rigel_bridge.document.tree import parse
from rigel_bridge.generations.dockerfile import read_env
from rigel_bridge.generations.load import load, outline
from rigel_bridge.generations.model import Options

# Rigel's own reading of ./Rigelfile in every folder, as JSON.
_READ: Final = """
import json, os
from rigel.cli import parse_rigelfile
found = {}
for folder in sorted(os.listdir(".")):
    os.chdir(folder)
    try:
        found[folder] = {"packages": json.loads(parse_rigelfile().json())["packages"]}
    except BaseException as error:
        found[folder] = {"error": type(error).__name__ + ": " + str(error)[:300]}
    os.chdir("..")
print("JSON" + json.dumps(found))
"""
STRICTER: Final = {
    "text is not made of other types": r"put it in quotes|expected text, found|must be text for",
    "unknown keys are errors": r"is not known",
    "a package is there once": r"is already in line",
    "an app needs a package": r"needs at least one entry",
    "a list of packages is what shows the generation": r"packages \(Rigel 0\.2\)",
    "empty is missing": r"is missing$",
    "our settings are checked": r"orchestration|kwargs",
    "the environment is read for named variables alone": r"is not in vars",
    "an entry of env has a name and a value": r"\.env\[",
    "only what a deployment needs is read as Rigel means it": r"expected a (list|mapping|whole number)",
}
"""Why we refuse what Rigel takes; each with what our message then has."""


def readings(python: Path, folder: Path, texts: Iterable[str], environment: Mapping[str, str]) -> list[dict[str, Any]]:
    """What the real Rigel makes of each text, read in one process of its own environment."""
    count = 0
    for count, text in enumerate(texts, start=1):
        home = folder / f"{count:05}"
        home.mkdir()
        (home / "Rigelfile").write_text(text)
    result = subprocess.run(
        [python, "-W", "ignore", "-c", _READ],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    if result.returncode:
        raise RuntimeError(result.stdout + result.stderr)
    found: dict[str, dict[str, Any]] = json.loads(result.stdout.rpartition("JSON")[2])
    return [found[f"{number:05}"] for number in range(1, count + 1)]


def difference(text: str, theirs: Mapping[str, Any], environment: Mapping[str, str]) -> str:
    """What is unexplained between both readings; empty for nothing."""
    options = Options(environment=environment)
    try:
        root = parse(text.encode(), "Rigelfile")
        lint = outline(root, options)
        findings = [*map(str, lint.errors), *lint.notes]
    except BridgeError as error:
        findings = [str(error)]
    try:
        packages = load(parse(text.encode(), "Rigelfile"), options).targets[0].packages
    except BridgeError as error:
        findings.append(str(error))
        if "error" in theirs:
            return ""
        reason = any(re.search(pattern, str(error)) for pattern in STRICTER.values())
        return "" if reason else f"Rigel takes it, we say: {error}"
    if "error" in theirs:
        return "" if findings else f"Rigel says {theirs['error']}, we find nothing"
    if len(packages) != len(theirs["packages"]):
        return f"{len(theirs['packages'])} packages for Rigel, {len(packages)} for us"
    for ours, rigels in zip(packages, theirs["packages"], strict=True):
        if "dockerfile" in rigels and ours.command and findings:
            continue  # a mistake made Rigel take the entry for one with its own Dockerfile; we name the mistake
        for field, value in (
            ("package", ours.name),
            ("image", ours.image),
            ("distro", ours.distro),
            ("command", ours.command),
        ):
            if field == "distro" and "dockerfile" in rigels:
                continue  # Rigel drops it; for us it names the distribution of the image that the user builds
            if not _same(value, rigels.get(field)):
                return f"{field} is {rigels.get(field)!r} for Rigel, {value!r} for us"
        texts = {str(entry["name"]): entry.get("value") for entry in rigels.get("env", ())}
        image = read_env({name: text for name, text in texts.items() if isinstance(text, str)})
        for name, value in image.values.items():
            if not _same(ours.env.values.get(name), value):
                return f"env {name} is {value!r} for Rigel, {ours.env.values.get(name)!r} for us"
        if missing := image.from_base.keys() - ours.env.from_base.keys():
            return f"env {sorted(missing)} takes its value from the base image for Rigel, not for us"
    return ""


def _same(ours: str | None, rigels: str | None) -> bool:
    """Equal, but for names inside of vars: Rigel leaves them as they stand unless vars come first in the file."""
    if ours == rigels:
        return True
    if rigels is None or ours is None:
        return False
    pattern = ".*".join(re.escape(part) for part in re.split(r"\{\{[^{}]*\}\}", rigels))
    return "{{" in rigels and bool(re.fullmatch(pattern, ours, re.DOTALL))


REQUIREMENTS = ("rigel==0.2.22", "setuptools<82")  # setuptools 82 dropped pkg_resources, which Rigel imports


def main() -> int:
    parser = argparse.ArgumentParser(prog="scripts/bench rigelfiles", description=__doc__)
    parser.add_argument("--compared", type=int, default=500, help="files that both read (default 500)")
    parser.add_argument("--broken", type=int, default=2000, help="broken files (default 2000)")
    parser.add_argument("--seed", type=int, default=int(time.time()))
    arguments = parser.parse_args()
    print(f"seed {arguments.seed}")
    with tempfile.TemporaryDirectory() as folder:
        failed = compared(Path(folder), arguments.compared, arguments.seed) if arguments.compared else 0
        failed += broken(Path(folder) / "Rigelfile", arguments.broken, arguments.seed) if arguments.broken else 0
    return 1 if failed else 0


def compared(folder: Path, count: int, seed: int) -> int:
    """How many files both programs read differently without a reason."""
    python = environment(folder / "venv")
    (folder / "files").mkdir()
    texts = [first_generation(seed + number) for number in range(count)]
    theirs = readings(python, folder / "files", texts, ENVIRONMENT)
    failed = 0
    for number, (text, one) in enumerate(zip(texts, theirs, strict=True)):
        if found := difference(text, one, ENVIRONMENT):
            failed += 1
            print(f"seed {seed + number}: {found}")
    taken = sum("packages" in one for one in theirs)
    print(f"compared {count}: Rigel takes {taken}; {failed} unexplained")
    return failed


def broken(path: Path, count: int, seed: int) -> int:
    """How many broken files end otherwise than in lines and a code."""
    failed, codes, slowest_s = 0, Counter[int](), 0.0
    for number in range(seed, seed + count):
        path.write_bytes(mutated(number))
        for arguments in (["render"], ["check"]):
            try:
                found = run(path, *arguments)
            except Exception as error:  # noqa: BLE001  # that is what is looked for
                failed += 1
                print(f"seed {number}: {arguments} ended with {type(error).__name__}: {error}")
                continue
            codes[found.code] += 1
            slowest_s = max(slowest_s, found.cpu_s)
            if found.cpu_s > 1 or found.written > 1_000_000 or found.foreign:
                failed += 1
                print(
                    f"seed {number}: {arguments} {found.cpu_s:.1f} s, {found.written} characters, touched {found.foreign}"
                )
    print(
        f"broken {count}: exit codes {dict(sorted(codes.items()))}, slowest {slowest_s:.2f} s of CPU; {failed} failed"
    )
    return failed


def environment(folder: Path) -> Path:
    """The interpreter of an environment with the real Rigel."""
    uv = str(Path(sys.executable).parent / "uv")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    subprocess.run([uv, "venv", "--quiet", "--python", version, str(folder)], check=True)
    python = folder / "bin" / "python"
    subprocess.run([uv, "pip", "install", "--quiet", "--python", str(python), *REQUIREMENTS], check=True)
    return python


if __name__ == "__main__":
    sys.exit(main())
