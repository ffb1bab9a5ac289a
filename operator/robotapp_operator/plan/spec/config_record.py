"""Restarts of a component for another content of its ConfigMaps and Secrets, and the record of them.

The record stands on the component's Deployment, so that neither a restart nor a new version of the operator starts pods:
the first content that is seen is only recorded. What keeps changing is rolled out less and less often.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any, Final

from robotapp_operator.plan.spec.config_content import ConfigContent
from robotapp_operator.plan.spec.text import shown

PAUSES_S: Final = (0.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0)
"""Least time between a restart for a change and the next one, by how many such restarts there were before."""
QUIET: Final = timedelta(hours=2)
"""After so long without a restart for a change, the next ones are counted anew; longer than the longest pause."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ConfigRecord:
    """The contents that the pods of a component were started with.

    references: hash of what the component refers to. config_hash: what its pods are annotated with, "" until the first restart
    for a change. file_hash and absent: of the parameter files. at: the last restart for a change, of `rolls` in a row.
    """

    references: str = ""
    mounted: Mapping[str, str] = dataclasses.field(default_factory=dict)
    files: Mapping[str, str] = dataclasses.field(default_factory=dict)
    config_hash: str = ""
    file_hash: str = ""
    absent: tuple[int, ...] = ()
    rolls: int = 0
    at: str = ""

    def text(self) -> str:
        """Returns the record as it is stored."""
        return json.dumps({name: getattr(self, name) for name in self.__slots__}, separators=(",", ":"), sort_keys=True)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class ConfigDecision:
    """The contents that pods are to run with, as a record. changed: objects whose change starts the component anew now. held: those whose
    change waits, until `due` (None: for no known time).
    """

    record: ConfigRecord
    changed: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    due: datetime | None = None

    @property
    def held_text(self) -> str:
        """Returns a sentence about a restart that waits, "" for none."""
        if not self.held or self.due is None:
            return ""
        return (
            f"{shown(self.held, limit=3)} changed again after {self.record.rolls} restarts for changes; the next one is at "
            f"{self.due.isoformat(timespec='seconds').replace('+00:00', 'Z')} (update.onConfigChange: None leaves pods running)"
        )


def parse_record(text: str) -> ConfigRecord | None:
    """Returns a stored record; None for one that is absent or cannot be read, which counts as none."""
    try:
        raw: Any = json.loads(text) if text else None
        if not isinstance(raw, dict):
            return None
        return ConfigRecord(
            references=str(raw.get("references", "")),
            mounted=_texts(raw.get("mounted")),
            files=_texts(raw.get("files")),
            config_hash=str(raw.get("config_hash", "")),
            file_hash=str(raw.get("file_hash", "")),
            absent=tuple(int(item) for item in raw.get("absent") or ()),
            rolls=max(0, int(raw.get("rolls", 0))),
            at=str(raw.get("at", "")),
        )
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None


def decide_config(
    record: ConfigRecord,
    content: ConfigContent,
    *,
    file_hash: str,
    absent: Sequence[int],
    rolls_out: bool,
    startable: bool,
    now: datetime,
) -> ConfigDecision:
    """Decides what the running pods of a component go on with, by the record of what they were started with.

    file_hash, absent: of the parameter files as they are now. rolls_out: `update.onConfigChange` is Roll. startable: nothing that
    the component requires is missing.
    """
    current = record_content(content, file_hash=file_hash, absent=absent, before=record)
    if record.references != content.references:
        return ConfigDecision(record=current)  # an edit, which changes the template by itself
    record = _follow_names(record, content)
    names = tuple(content.changed_since(record.mounted, record.files))
    if not names and (record.file_hash, record.absent) == (file_hash, tuple(absent)):
        return ConfigDecision(record=record)
    if (
        not rolls_out or not startable
    ):  # a pod that runs needs no longer what is missing, and its successor could not start
        return ConfigDecision(record=record, held=names)
    last = _moment(record.at, now)
    due = last + timedelta(seconds=PAUSES_S[min(record.rolls, len(PAUSES_S) - 1)]) if last else now
    if due > now:
        return ConfigDecision(record=record, held=names, due=due)
    new_record = dataclasses.replace(
        current,
        config_hash=content.mounted_hash if content.mounted != record.mounted else record.config_hash,
        rolls=record.rolls + 1 if last and now - last < QUIET else 1,
        at=now.isoformat(timespec="seconds"),
    )
    return ConfigDecision(record=new_record, changed=names)


def record_content(
    content: ConfigContent, *, file_hash: str, absent: Sequence[int], before: ConfigRecord | None = None
) -> ConfigRecord:
    """Returns the record of pods that start with this content, with the restarts of the record before."""
    return dataclasses.replace(
        before or ConfigRecord(),
        references=content.references,
        mounted=content.mounted,
        files=content.files,
        file_hash=file_hash,
        absent=tuple(absent),
    )


def _follow_names(record: ConfigRecord, content: ConfigContent) -> ConfigRecord:
    """The same references with other names: Secrets are followed since now, which changes no content."""

    def follow(before: Mapping[str, str], now: Mapping[str, str]) -> dict[str, str]:
        return {name: before.get(name, digest) for name, digest in now.items()}

    return dataclasses.replace(
        record, mounted=follow(record.mounted, content.mounted), files=follow(record.files, content.files)
    )


def _moment(text: str, now: datetime) -> datetime | None:
    """Returns when that was; None for a time ahead of the present, as after a change to a machine with another clock."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return None
    return moment if moment.tzinfo and moment <= now + timedelta(minutes=1) else None


def _texts(value: Any) -> dict[str, str]:
    return {str(key): str(text) for key, text in value.items()} if isinstance(value, dict) else {}
