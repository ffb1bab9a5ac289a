"""Core fields as JSON text: lists and objects that are decoded when they are read.

As Python objects environment, init containers and volumes of an app take fifteen times the memory of their text, for as long
as the app exists; they are read when its pods are rendered.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, overload

from pydantic import AfterValidator, BeforeValidator, GetCoreSchemaHandler, PlainSerializer

Json = dict[str, Any]


class PackedList(Sequence[Json]):
    """A list of JSON objects; each reading decodes it anew."""

    __slots__ = ("_text",)

    def __init__(self, items: Sequence[Json] = ()) -> None:
        self._text = _text_of(list(items)) if items else _NO_ITEMS

    def __repr__(self) -> str:
        return f"<PackedList of {len(self._text)} bytes>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self.unpack() == list(other)

    def __hash__(self) -> int:
        return hash(self._text)

    def __len__(self) -> int:
        return len(self.unpack())

    def __iter__(self) -> Iterator[Json]:
        return iter(self.unpack())

    def __bool__(self) -> bool:
        return self._text != _NO_ITEMS

    @overload
    def __getitem__(self, index: int) -> Json: ...
    @overload
    def __getitem__(self, index: slice) -> list[Json]: ...
    def __getitem__(self, index: int | slice) -> Json | list[Json]:
        return self.unpack()[index]

    def unpack(self) -> list[Json]:
        """Decodes the items, which the caller may change."""
        items: list[Json] = json.loads(self._text)
        return items

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return handler(Annotated[tuple[Json, ...], *_packing(cls)])


class PackedMap(Mapping[str, Any]):
    """A JSON object; each reading decodes it anew."""

    __slots__ = ("_text",)

    def __init__(self, fields: Mapping[str, Any] | None = None) -> None:
        self._text = _text_of(dict(fields)) if fields else _NO_FIELDS

    def __repr__(self) -> str:
        return f"<PackedMap of {len(self._text)} bytes>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mapping) and self.unpack() == dict(other)

    def __hash__(self) -> int:
        return hash(self._text)

    def __getitem__(self, name: str) -> Any:
        return self.unpack()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.unpack())

    def __len__(self) -> int:
        return len(self.unpack())

    def unpack(self) -> Json:
        """Decodes the fields, which the caller may change."""
        fields: Json = json.loads(self._text)
        return fields

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        return handler(Annotated[Json, *_packing(cls)])


def unpacked(value: Any) -> Any:
    """Returns plain JSON for a packed value, every other value as it is."""
    return value.unpack() if isinstance(value, PackedList | PackedMap) else value


def _packing(packed: type[PackedList] | type[PackedMap]) -> tuple[Any, ...]:
    """Returns what pydantic does with a packed field: validate plain JSON, keep the text, write plain JSON again."""
    return BeforeValidator(unpacked), AfterValidator(packed), PlainSerializer(unpacked)


def _text_of(value: Any) -> bytes:
    """Encodes JSON in as few bytes as the API server does; half a surrogate pair, which Go lets through, stays as it is."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False).encode("utf-8", "surrogatepass")


_NO_ITEMS: Final = b"[]"
_NO_FIELDS: Final = b"{}"
