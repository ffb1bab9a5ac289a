"""Reads what `scripts/language.py` counts from one Python file: functions, assignments, docstrings and annotated names.

verbs      Functions and methods; a finding is a name that does not begin with a verb. A verb is a word of the list `verbs`; a
           word of `nouns_and_verbs` where the function returns nothing or is async; a condition (`is_ready`, or a verb in the
           third person that returns bool: `holds_claim`), a conversion (`to_json`, `with_rows`) or a handler (`on_close`); any
           of them behind a prefix (`pre_bind`). Names that something else decides are left out: dunder methods, properties,
           fixtures, overloads, commands of the command line, and the list `required`.
locals     Assignments to local names (`=`, `for`, `with`, `:=`, comprehensions); a finding is a name that is a participle
           (`found`, `listed`) or a pronoun (`each`, `others`) and nothing more. `left` beside `right` is a side.
docstrings Docstrings; a finding is one whose first sentence opens with a fragment: a preposition, conjunction, question word or
           pronoun ("Of …", "As …", "What …", "Whether …"), a constant, a range ("0…100 per node"), a small letter, a participle
           that hangs on what follows it ("Called by …"); or that is a question or a single word.
leftovers  Arguments, attributes and locals that are annotated with a class; a finding is one named by a participle or pronoun
           (`held: Claim`) that is no word of the class's name, or by a word that `old_names` lists for the class
           (`cluster: Cache`).

The lists are in `language_words.toml` beside this file.
"""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

WORDS: Final = tomllib.loads(Path(__file__).with_name("language_words.toml").read_text())


def read_list(name: str) -> frozenset[str]:
    """Returns the words of a list in `language_words.toml`."""
    return frozenset(WORDS[name].split())


VERBS: Final = read_list("verbs")
NOUNS_AND_VERBS: Final = read_list("nouns_and_verbs")
OPENINGS: Final = read_list("conditions") | read_list("conversions") | read_list("handlers")
PREFIXES: Final = read_list("prefixes")
REQUIRED: Final = read_list("required")
PARTICIPLES: Final = read_list("participles")
NOUNS_IN_ED: Final = read_list("nouns_in_ed")
PRONOUNS: Final = read_list("pronouns")
FRAGMENT_OPENERS: Final = read_list("fragment_openers")
LOWER_CASE_NAMES: Final = read_list("lower_case_names")
OLD_NAMES: Final = {name: frozenset(words.split()) for name, words in WORDS["old_names"].items()}
DECORATORS: Final = ("property", "fixture", "overload", "override", "setter", "command", "callback")
"""Ends of the names of decorators under which something else decides the function's name."""
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Item(NamedTuple):
    """A function, assignment, docstring or annotated name. It stays the same item when it is moved to another file."""

    measure: str
    owner: str
    """Name of the function or class around it."""
    name: str
    is_finding: bool


class Place(NamedTuple):
    """An item and its line in a file."""

    path: str
    line: int
    item: Item


class FileItems(NamedTuple):
    """The items of a file and the classes that it defines."""

    places: list[Place]
    classes: set[str]


def is_participle(word: str) -> bool:
    """Tells a past participle, or a present one of the list, from other words."""
    return word in PARTICIPLES or (word.endswith("ed") and word.isalpha() and word not in NOUNS_IN_ED)


def is_placeholder(name: str) -> bool:
    """Returns True for a name that is a participle or pronoun and nothing more."""
    word = name.strip("_0123456789")
    return word in PRONOUNS or is_participle(word)


def list_stems(word: str) -> Iterator[str]:
    """Yields the verbs of which the word may be the third person: `holds`, `matches`, `carries`."""
    if word.endswith("s"):
        yield word[:-1]
        yield word.removesuffix("es")
        yield word.removesuffix("ies") + "y"


def begins_with_verb(node: Function) -> bool:
    """Returns True where the function's name begins with a verb, as the head of this file defines it."""
    words = node.name.strip("_").lower().split("_")
    while len(words) > 1 and words[0] in PREFIXES:
        del words[0]
    verb = words[0]
    returns = ast.unparse(node.returns) if node.returns else "None"
    if verb in VERBS or (len(words) > 1 and verb in OPENINGS):
        return True
    if verb in NOUNS_AND_VERBS and (returns == "None" or isinstance(node, ast.AsyncFunctionDef)):
        return True
    return returns == "bool" and any(stem in VERBS | NOUNS_AND_VERBS for stem in list_stems(verb))


def list_decorators(node: Function) -> Iterator[str]:
    """Yields the last name of each decorator: `command` for `@app.command("list")`."""
    for decorator in node.decorator_list:
        function = decorator.func if isinstance(decorator, ast.Call) else decorator
        yield function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def has_free_name(node: Function) -> bool:
    """Returns True for a function that could have another name."""
    if node.name in REQUIRED or (node.name.startswith("__") and node.name.endswith("__")) or not node.name.strip("_"):
        return False
    return not any(name.endswith(DECORATORS) for name in list_decorators(node))


def opens_with_fragment(docstring: str) -> bool:
    """Returns True where the first sentence opens with a fragment, as the head of this file defines it."""
    sentence = re.split(r"(?<=[.?!])\s|\n\s*\n", docstring.strip(), maxsplit=1)[0]
    words = sentence.split()
    opening = words[0].rstrip(".,:;?!…")
    if len(words) == 1 or sentence.endswith("?"):
        return True
    if opening.lower() in FRAGMENT_OPENERS or re.match(r"[-\d]+(…|\.\.)", opening):
        return True
    if re.fullmatch("[a-z][a-z-]*", opening):
        return opening not in LOWER_CASE_NAMES
    return is_participle(opening.lower()) and words[1].lower() in FRAGMENT_OPENERS


def read_class_name(annotation: ast.expr | None) -> str:
    """Returns the name of the class in `Cache`, `cache.Cache`, `Cache | None` or `"Cache"`, "" for anything else."""
    match annotation:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case ast.BinOp(left=ast.expr() as option, right=ast.Constant(value=None)):
            return read_class_name(option)
        case ast.Constant(value=str(text)):
            return text.removesuffix(" | None")
    return ""


class Reader(ast.NodeVisitor):
    """Collects the items of one file."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.places: list[Place] = []
        self.classes: set[str] = set()
        self._owners: list[ast.ClassDef | Function] = []

    def visit_Module(self, node: ast.Module) -> None:
        """Counts the module's docstring and goes on."""
        self._add_docstring(node, "")
        self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Counts the docstring and goes on."""
        self.classes.add(node.name)
        self._add_docstring(node, node.name)
        self._visit_body(node)

    def visit_FunctionDef(self, node: Function) -> None:
        """Counts name and docstring and goes on."""
        if has_free_name(node):
            self._add("verbs", node, node.name, is_finding=not begins_with_verb(node))
        self._add_docstring(node, node.name)
        self._visit_body(node)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        """Counts the same as for other functions."""
        self.visit_FunctionDef(node)

    def visit_Name(self, node: ast.Name) -> None:
        """Counts the name where it is assigned to in a function."""
        if isinstance(node.ctx, ast.Store) and self._is_in_function() and node.id.strip("_"):
            is_side = node.id == "left" and self._has_local("right")
            self._add("locals", node, node.id, is_finding=is_placeholder(node.id) and not is_side)

    def visit_arg(self, node: ast.arg) -> None:
        """Counts the annotation of an argument."""
        self._add_annotation(node, node.arg, node.annotation)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Counts the annotation of an attribute or a local."""
        match node.target:
            case ast.Name(id=name) | ast.Attribute(attr=name):
                self._add_annotation(node, name, node.annotation)
        self.generic_visit(node)

    def _visit_body(self, node: ast.ClassDef | Function) -> None:
        self._owners.append(node)
        self.generic_visit(node)
        self._owners.pop()

    def _is_in_function(self) -> bool:
        return bool(self._owners) and not isinstance(self._owners[-1], ast.ClassDef)

    def _has_local(self, name: str) -> bool:
        """Returns True where the innermost function has a local or an argument of this name."""
        return any(
            name in {getattr(node, "id", None), getattr(node, "arg", None)} for node in ast.walk(self._owners[-1])
        )

    def _add(self, measure: str, node: ast.AST, name: str, *, is_finding: bool) -> None:
        owner = self._owners[-1].name if self._owners else ""
        self.places.append(Place(self.path, getattr(node, "lineno", 1), Item(measure, owner, name, is_finding)))

    def _add_docstring(self, node: ast.Module | ast.ClassDef | Function, name: str) -> None:
        docstring = ast.get_docstring(node)
        if docstring:
            opening = " ".join([f"{name}:" if name else "", *docstring.split()[:4]])
            self._add("docstrings", node, opening.strip(), is_finding=opens_with_fragment(docstring))

    def _add_annotation(self, node: ast.AST, name: str, annotation: ast.expr | None) -> None:
        """Counts the name. A field of a class may be a participle, as some fields of the API's objects are."""
        class_name = read_class_name(annotation)
        if class_name:
            word = name.strip("_")
            is_field = isinstance(node, ast.AnnAssign) and not self._is_in_function()
            is_free = not is_field and word.capitalize() not in re.findall("[A-Z][a-z]*", class_name)
            is_finding = word in OLD_NAMES.get(class_name, ()) or (is_free and is_placeholder(word))
            self._add("leftovers", node, f"{name}: {class_name}", is_finding=is_finding)


def read_items(path: str, text: str) -> FileItems:
    """Returns the items of a file."""
    reader = Reader(path)
    reader.visit(ast.parse(text, path))
    return FileItems(reader.places, reader.classes)
