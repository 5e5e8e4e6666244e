"""`--help` folded to the terminal, with commands that can be pasted; what a slip is answered."""

import argparse
import re
import sys

from corridor.core.errors import did_you_mean

# Wider lines are tiring to read, whatever the terminal.
_WIDEST = 100
_COMMAND = "corridor "
# Two columns stand apart by two blanks or more.
_COLUMNS = re.compile(r"^( *\S.*?\S {2,}|\S {2,})(?=\S)")


class Parser(argparse.ArgumentParser):
    """argparse's parser that answers a slip in one sentence, with the nearest word it knows."""

    def __init__(self, **more):
        super().__init__(**{"formatter_class": Help, **more})

    def parse_args(self, args=None, namespace=None):
        """As argparse does; an option that is unknown is compared with those of its verb."""
        found, rest = self.parse_known_args(args, namespace)
        if rest:
            verb = _verb(self, sys.argv[1:] if args is None else args)
            word = rest[0].partition("=")[0]
            near = did_you_mean(word, verb._option_string_actions) if word[:1] == "-" else ""
            what = "is not an option here" if word[:1] == "-" else "is one word too many"
            verb.error(f"{word} {what}{near}")
        return found

    def error(self, message: str):
        """One sentence and the command that tells more; status 2."""
        chosen = re.search(r"^(.*): invalid choice: '([^']*)' \(choose from (.*)\)", message)
        if chosen:
            near = did_you_mean(chosen[2], re.findall(r"[\w-]+", chosen[3]))
            known = near or f": choose from {chosen[3]}"
            message = f"{chosen[1]}: {chosen[2]!r} is unknown{known}"
        if message.endswith("required: VERB") and self.prog == "corridor":
            message = "say what to do, for a first look `corridor check PROJECT`"
        print(f"error: {message}; see `{self.prog} --help`.", file=sys.stderr)
        raise SystemExit(2)


def _verb(parser: argparse.ArgumentParser, words: list[str]) -> argparse.ArgumentParser:
    """The parser of the verb, and of its kind, that some words name."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            named = next((word for word in words if word in action.choices), None)
            if named is not None:
                return _verb(action.choices[named], words[words.index(named) + 1 :])
    return parser


class Help(argparse.RawDescriptionHelpFormatter):
    """argparse's layout, in which what stands above and below the options is folded too."""

    def __init__(self, prog: str, **more):
        super().__init__(prog, **more)
        self._width = min(self._width, _WIDEST)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "".join(f"{indent}{line}".rstrip() + "\n" for line in folded(text, width))


def folded(text: str, width: int) -> list[str]:
    """Lines of a text, none wider than `width` characters where its words allow.

    Lines that begin at the same column are one paragraph. A line of two columns, two blanks or
    more apart, keeps them. A command (`corridor ...`) goes on behind a backslash.
    """
    out: list[str] = []
    first, hanging, words = "", -1, []

    def end():
        nonlocal hanging, words
        if words:
            out.extend(_filled(first, " " * hanging, words, width))
        hanging, words = -1, []

    for line in text.splitlines():
        at = len(line) - len(line.lstrip())
        columns = _COLUMNS.match(line)
        if not line.strip():
            end()
            out.append("")
        elif line[at:].startswith(_COMMAND) and at:
            end()
            # An option stays with its value.
            parts = re.split(r" (?=-)", line.strip())
            out.extend(_filled(" " * at, " " * (at + 4), parts, width, " \\"))
        elif columns:
            end()
            first, hanging = columns[0], len(columns[0])
            words = line[hanging:].split()
        elif words and at == hanging:
            words += line.split()
        else:
            end()
            first, hanging, words = " " * at, at, line.split()
    end()
    return out


def _filled(first: str, hanging: str, words: list[str], width: int, mark: str = "") -> list[str]:
    """Words in lines; mark: at the end of each but the last."""
    lines, line = [], first + words[0]
    for n, word in enumerate(words[1:], 2):
        spare = len(mark) if n < len(words) else 0
        if len(line) + 1 + len(word) + spare > width:
            lines.append(line + mark)
            line = hanging + word
        else:
            line += f" {word}"
    return [*lines, line]
