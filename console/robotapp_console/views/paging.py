"""Filter, order and page of a long table, read from its address."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar
from urllib.parse import urlencode

T = TypeVar("T")

PAGE_ROWS: Final = 50
MOST_QUERY: Final = 200
MOST_PAGE: Final = 100_000
NAMESPACE: Final = "namespace"
"""The filter that belongs to every screen."""
NEAR, FAR = "near", "far"
"""The two zones whose pairs of nodes are looked at: they choose no rows of the table."""
_NO_FILTERS: Final = frozenset({NAMESPACE, NEAR, FAR})


@dataclass(frozen=True, slots=True)
class Query:
    """The filter, order and page of a table's address. Every field has a safe default, so that any address shows a page."""

    text: str = ""
    sort: str = ""
    descending: bool = False
    page: int = 1
    filters: tuple[tuple[str, str], ...] = ()
    """Chosen values by the filter's name."""

    @classmethod
    def read(cls, parameters: Mapping[str, str], *, sorts: Sequence[str], filters: Sequence[str]) -> "Query":
        """Returns the query of these parameters. What is not known there counts as not given."""
        sort = parameters.get("sort", "")
        page = parameters.get("page", "")
        chosen = tuple((name, _decode(parameters[name])) for name in filters if parameters.get(name))
        return cls(
            text=_decode(parameters.get("q", "")).strip(),
            sort=sort if sort in sorts else sorts[0],
            descending=parameters.get("desc") == "1",
            page=min(MOST_PAGE, max(1, int(page))) if page.isascii() and page.isdigit() and len(page) < 7 else 1,
            filters=chosen,
        )

    @property
    def is_narrowed(self) -> bool:
        """Returns whether rows may be left out, apart from those of other namespaces."""
        return bool(self.text) or any(name not in _NO_FILTERS for name, _ in self.filters)

    def filter_value(self, name: str) -> str:
        """Returns the chosen value of a filter, empty without one."""
        return dict(self.filters).get(name, "")

    def encode(self, **changes: Any) -> str:
        """Returns the address's query with these changes: `?q=amr&page=2`, `?` for the table's first page."""
        fields = {
            "q": self.text,
            **dict(self.filters),
            "sort": self.sort,
            "desc": "1" if self.descending else "",
            "page": str(self.page) if self.page > 1 else "",
        } | changes
        return "?" + urlencode({key: value for key, value in fields.items() if value})

    def encode_sort(self, column: str) -> str:
        """Returns the address that orders by this column, the other way round if it does already."""
        descending = self.sort == column and not self.descending
        return self.encode(sort=column, desc="1" if descending else "", page="")


def _decode(text: str) -> str:
    """Returns the text without the halves of characters that stand for bytes which were none."""
    return text[:MOST_QUERY].encode("utf-8", "replace").decode()


@dataclass(frozen=True, slots=True)
class Page(Generic[T]):
    """The rows to show; `total` counts all that match."""

    rows: tuple[T, ...]
    query: Query
    total: int
    number: int
    pages: int

    @property
    def first(self) -> int:
        """Number of the first row, 0 when there is none."""
        return (self.number - 1) * PAGE_ROWS + 1 if self.rows else 0

    @property
    def last(self) -> int:
        return (self.number - 1) * PAGE_ROWS + len(self.rows)

    @property
    def previous(self) -> str:
        return self.query.encode(page=str(self.number - 1)) if self.number > 1 else ""

    @property
    def following(self) -> str:
        return self.query.encode(page=str(self.number + 1)) if self.number < self.pages else ""


def take_page(
    rows: Sequence[T],
    query: Query,
    *,
    keys: Mapping[str, Callable[[T], Any]],
    matches: Callable[[T, str], bool],
) -> Page[T]:
    """Returns the page of `rows` of the query, or the last one when there are fewer.

    keys: what each order compares; rows that are equal in it keep the order they come in.
    """
    words = query.text.casefold().split()
    chosen = [row for row in rows if all(matches(row, word) for word in words)]
    chosen.sort(key=keys[query.sort], reverse=query.descending)
    pages = max(1, -(-len(chosen) // PAGE_ROWS))
    number = min(query.page, pages)
    start = (number - 1) * PAGE_ROWS
    return Page(tuple(chosen[start : start + PAGE_ROWS]), query, len(chosen), number, pages)
