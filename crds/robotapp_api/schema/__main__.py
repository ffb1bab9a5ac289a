"""`python -m robotapp_api.schema` writes the generated files; `--check` only compares them and fails on a difference."""

import argparse
import difflib
import sys
from pathlib import Path

from robotapp_api.schema.output import generate

ROOT = Path(__file__).parents[3]


def check(root: Path, files: dict[Path, str]) -> list[str]:
    """One line per file that differs, with the first line of difference."""
    problems = []
    for path, wanted in files.items():
        target = root / path
        present = target.read_text() if target.exists() else ""
        if present != wanted:
            lines = difflib.unified_diff(present.splitlines(), wanted.splitlines(), lineterm="", n=0)
            first = next((line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---")), "")
            problems.append(f"{path} is out of date ({first.strip()})")
    return problems


def write(root: Path, files: dict[Path, str]) -> None:
    for path, text in files.items():
        target = root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m robotapp_api.schema", description=__doc__)
    parser.add_argument("--check", action="store_true", help="fail if a generated file differs from the models")
    parser.add_argument("--root", type=Path, default=ROOT, help="root of the repository")
    arguments = parser.parse_args()
    files = generate()
    if not arguments.check:
        write(arguments.root, files)
        return 0
    problems = check(arguments.root, files)
    for problem in problems:
        print(problem, file=sys.stderr)
    if problems:
        print("run: python -m robotapp_api.schema", file=sys.stderr)
    return bool(problems)


if __name__ == "__main__":
    sys.exit(main())
