import argparse
from pathlib import Path

import pytest

from campaigns.common import options


def parsed(kind: object, text: str) -> object:
    parser = argparse.ArgumentParser()
    parser.add_argument("--x", type=kind)  # type: ignore[arg-type] # any of them
    return parser.parse_args([f"--x={text}"]).x


@pytest.mark.parametrize(
    ("kind", "text", "reason"),
    [
        (options.count(1, 20), "0", "is not a whole number from 1 to 20"),
        (options.count(1, 20), "21", "is not a whole number from 1 to 20"),
        (options.count(0), "-1", "is not a whole number from 0"),
        (options.amount, "nan", "is not a number from 0"),
        (options.amount, "inf", "is not a number from 0"),
        (options.amount, "-4", "is not a number from 0"),
        (options.amount, "soon", "is not a number from 0"),
        (options.report, "/no/such/folder/x.json", "name a file in a folder that exists"),
        (options.report, "/", "name a file in a folder that exists"),
    ],
)
def test_what_cannot_work_is_refused(kind: object, text: str, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed(kind, text)
    assert reason in capsys.readouterr().err


def test_what_can_work_is_taken(tmp_path: Path) -> None:
    assert parsed(options.count(1, 20), "20") == 20
    assert parsed(options.amount, "0.5") == 0.5
    assert parsed(options.report, str(tmp_path / "new.json")) == tmp_path / "new.json"
