"""Parsing of the command line by tyro, with one line for each error.

tyro prints errors as boxes of several lines, with choices in random order. A hook for errors provides the parts of a
line. The hook and the fields of options are not part of tyro's public interface, so pyproject.toml limits its versions.
"""

from __future__ import annotations

import difflib
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from tyro import _errors as events
from tyro._fields import FieldDefinition
from tyro._parsers import LazyParserSpecification
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo
from tyro.extras import SubcommandApp

from bodysense.errors import BodysenseError, did_you_mean
from bodysense.files import written_beside

PROGRAM = "bodysense"
_DEEPEST = 2  # words of a command: a group and its command
_COMPLETION = ("--tyro-print-completion", "--tyro-write-completion")
_NONE = "none"  # printed for the default None
_EMPTY = '""'  # printed for an empty value
# Kind of a value by tyro's name of its type, and an example by a word in its help text.
_KINDS = {"FLOAT": "a number", "INT": "a whole number", "PATH": "a file or folder", "STR": "a text"}
_EXAMPLES = {"metres": " in metres, such as 1.75", "seconds": " of seconds, such as 0.5", "UDP": ", such as 39539"}


def run(application: SubcommandApp, description: str, given: Sequence[str]) -> Any:
    """Run a command and return its result. Raises BodysenseError for invalid arguments."""

    completes = len(given) > 1 and given[0] in _COMPLETION
    if completes and given[1] not in ("bash", "zsh"):
        raise BodysenseError(f"{given[0]} {given[1]}: completion is for bash and zsh; give one of them")

    def refuse(event: events.ParseErrorEvent) -> None:
        reason = _reason(event, application, given)
        if reason is not None:
            raise BodysenseError(reason)

    with _registry(), _readable_help(), events.on_parse_error(refuse):
        if completes:
            return _complete(application, description, given)
        return application.cli(prog=PROGRAM, description=description, args=given)


def _complete(application: SubcommandApp, description: str, given: Sequence[str]) -> None:
    """Print or write tyro's completion script; help texts are put on one line, because the script splits at lines."""
    text = io.StringIO()
    with redirect_stdout(text), suppress(SystemExit):
        application.cli(prog=PROGRAM, description=description, args=[_COMPLETION[0], given[1]])
    script = re.sub(r"(?m)^COMPLETION_SPEC = .*$", lambda line: line[0].replace(r"\n", " "), text.getvalue())
    if given[0] == _COMPLETION[1] and len(given) > 2 and given[2] != "-":
        with written_beside(given[2]) as beside:
            beside.write_text(script, encoding="utf-8")
    else:
        print(script)


def _registry() -> ConstructorRegistry:
    """Return tyro's rules for optional values, which do not accept 'None', and for paths."""
    registry = ConstructorRegistry()

    @registry.primitive_rule
    def optional(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        kind = _kind(info.type)
        if kind is None:
            return None
        rule = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kind, info.markers))
        if not isinstance(rule, PrimitiveConstructorSpec):
            return None
        return replace(
            rule,
            is_instance=lambda value: value is None or rule.is_instance(value),
            str_from_instance=lambda value: [_NONE] if value is None else rule.str_from_instance(value),
        )

    @registry.primitive_rule
    def path(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Path] | None:
        if info.type is not Path:
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar="PATH",
            instance_from_str=_path,
            is_instance=lambda value: isinstance(value, Path),
            str_from_instance=lambda value: [str(value)],
        )

    return registry


@contextmanager
def _readable_help() -> Iterator[None]:
    """Let tyro fill the lines of help texts, and list commands by the first paragraph of their help.

    By default it keeps the line breaks and indents of the source, and lists commands with their whole help.
    """
    make, prepare = FieldDefinition.make, LazyParserSpecification.__init__

    def filled(**field: Any) -> FieldDefinition:
        text = field.pop("helptext")
        return make(**field, helptext=lambda: _one_line(text() if callable(text) else text))

    def listed(listing: LazyParserSpecification, description: str, _factory: Any) -> None:
        prepare(listing, description.partition("\n\n")[0], _factory)

    FieldDefinition.make = staticmethod(filled)  # type: ignore[method-assign]
    LazyParserSpecification.__init__ = listed  # type: ignore[method-assign]
    try:
        yield
    finally:
        FieldDefinition.make = staticmethod(make)  # type: ignore[method-assign]
        LazyParserSpecification.__init__ = prepare  # type: ignore[method-assign]


def _one_line(text: object) -> str | None:
    """Return a text without line breaks; None for no text."""
    return None if text is None else " ".join(str(text).split())


def _path(words: list[str]) -> Path:
    """Return a path. Raises ValueError for an empty text, which Path would take for the current folder."""
    if not words[0]:
        raise ValueError("an empty path")
    return Path(words[0])


def _kind(hint: Any) -> Any:
    """Return T for T | None, and None for any other type."""
    arguments = get_args(hint)
    if get_origin(hint) is Literal:
        values = tuple(value for value in arguments if value is not None)
        return Literal[values] if len(values) < len(arguments) else None
    if get_origin(hint) not in (Union, UnionType) or NoneType not in arguments:
        return None
    return Union[tuple(kind for kind in arguments if kind is not NoneType)]  # noqa: UP007


def _reason(event: events.ParseErrorEvent, application: SubcommandApp, given: Sequence[str]) -> str | None:
    """Return a message about an error; None for unknown events of later versions, for which tyro prints a box."""
    if isinstance(event, events.MissingArgs):
        names = " and ".join(_name(one.arg) for one in event.missing_arguments)
        unknown = " ".join(word or _EMPTY for word in event.unrecognized_tokens)
        spare = f", and {unknown} is unknown" if unknown else ""
        verb = "is" if len(event.missing_arguments) == 1 else "are"
        return f"{names} {verb} missing{spare}{_help_hint(application, given)}"
    if isinstance(event, events.MissingSubcommand):
        group = _command(_help(application, given))
        return f"{f'{group}: ' if group else ''}give one of {', '.join(sorted(event.subcommand_spec.parser_from_name))}"
    if isinstance(event, events.BadValue):
        name = _name(event.argument)
        if event.reason == "too_few_values":
            return f"{name}: the value is missing; give {_expected_value(event.argument)}"
        return f"{name} {event.offending_value}: takes no value; leave {event.offending_value!r} out"
    if isinstance(event, events.InvalidChoice):
        choices = sorted(choice for choice in event.choices if choice != "None")
        near = did_you_mean(event.value, choices)
        asked = f"{near} Give" if near else "give"
        return f"{_name(event.argument)} {event.value or _EMPTY}: {asked} one of {', '.join(choices)}"
    if isinstance(event, events.UnrecognizedArgs):
        return _unknown(event.tokens, application, given)
    if isinstance(event, events.InstantiationFailure) and event.argument is not None:
        name = _name(event.argument)
        value = _value(name, given) or _EMPTY
        return f"{name} {value}: give {_expected_value(event.argument)}"
    if isinstance(event, events.InstantiationFailure):
        return " ".join(event.message.split())
    return None


def _name(argument: Any) -> str:
    """Return the option of an argument, or its metavar, such as PATH, for a positional one."""
    if argument.is_positional():
        return str(argument.lowered.metavar).strip("[]{}")
    return max(argument.lowered.name_or_flags, key=len)


def _expected_value(argument: Any) -> str:
    """Return a description of valid values of an argument, with an example if its help has a unit."""
    metavar, found = str(argument.lowered.metavar), argument.field.helptext
    text = str((found() if callable(found) else found) or "")
    kind = next((words for name, words in _KINDS.items() if name in metavar), f"one of {metavar.strip('{}')}")
    bounds = re.search(r"\((.*)\)", metavar)
    if bounds is not None:
        return f"{kind}, {bounds[1]}"
    example = next((more for word, more in _EXAMPLES.items() if word in text), "")
    return kind + (example if "number" in kind else "")


def _value(name: str, given: Sequence[str]) -> str:
    """Return the value that was given for an option."""
    for before, word in zip(["", *given], given, strict=False):
        if before == name:
            return word
        if word.startswith(f"{name}="):
            return word.partition("=")[2]
    return ""


def _unknown(tokens: Sequence[str], application: SubcommandApp, given: Sequence[str]) -> str:
    """Return a message about unknown words, with the nearest option or command."""
    text, first = _help(application, given), tokens[0]
    is_option, names = first.startswith("-"), re.findall(r"• ([a-z][a-z0-9-]*)", text)
    known = re.findall(r"--[a-z][a-z0-9-]*", text) if is_option else names
    near = difflib.get_close_matches(first.partition("=")[0], sorted(set(known)), 1)
    kind = "option" if is_option else "command" if names else "argument"
    return f"{first or _EMPTY}: unknown {kind}" + (
        f"; did you mean {near[0]}?" if near else _help_hint(application, given)
    )


def _help_hint(application: SubcommandApp, given: Sequence[str]) -> str:
    """Return a hint to the help of the command."""
    return f"; see {' '.join([PROGRAM, _command(_help(application, given))]).strip()} --help"


def _help(application: SubcommandApp, given: Sequence[str]) -> str:
    """Return the help of the command that was called, or of its group if there is no such command."""
    words = list(takewhile(lambda word: re.fullmatch(r"[a-z][a-z0-9-]*", word), given))[:_DEEPEST]
    for count in range(len(words), -1, -1):
        text = io.StringIO()
        try:
            with redirect_stdout(text):
                application.cli(prog=PROGRAM, args=[*words[:count], "--help"])
        except SystemExit:
            return text.getvalue()
        except BodysenseError:  # the last of the words is no command
            continue
    return ""


def _command(text: str) -> str:
    """Return the command of a help text; an empty text for the help of the program."""
    found = re.match(rf"usage: {PROGRAM} ([^\[{{]*)", text)
    return "" if found is None else found[1].strip()
