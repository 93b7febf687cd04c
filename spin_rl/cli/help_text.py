"""What `--help` prints, taken from the comments of a command's file in conf/ without composing it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from spin_rl.paths import CONF_DIR

_GROUP = re.compile(r"  - (?:optional )?(?P<key>\w+): (?P<value>[^\s#$]+)\s*(?:# ?(?P<meaning>.*))?")
_KEY = re.compile(r"(?P<key>\w+): +(?P<value>[^\s#][^#]*?)\s+# ?(?P<meaning>.*)")
_WIDEST_SETTING = 22


def is_asked_for(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for help."""
    return not {"--help", "-h"}.isdisjoint(arguments)


def of(name: str) -> str:
    """Return the help of a command: what it is for, examples, groups and keys with their meanings.

    Args:
        name: The command's file in conf/. Its first block of comments is the introduction; groups are its
            defaults, keys what it has at the top with a comment in the same line.
    """
    lines = (CONF_DIR / f"{name}.yaml").read_text().splitlines()
    start = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    introduction = [line[1:].removeprefix(" ") for line in lines[:start]]
    groups = [match for line in lines if (match := _GROUP.fullmatch(line))]
    keys = [match for line in lines if (match := _KEY.fullmatch(line))]
    parts = [introduction]
    if groups:
        rows = [_row(match, match["meaning"] or _files(match["key"])) for match in groups]
        parts.append(["Groups, files of conf/ to choose from (group=file):", *rows])
    if keys:
        rows = [_row(match, match["meaning"]) for match in keys]
        parts.append(["Keys (key=value; those of a group are group.key=value):", *rows])
        more = f"All keys: spin-{name} --cfg=job. Several runs, one after the other: spin-{name} -m seed=1,2"
        parts.append([more])
    return "\n\n".join("\n".join(part) for part in parts)


def _row(match: re.Match[str], meaning: str) -> str:
    setting = f"{match['key']}={match['value']}"
    if len(setting) > _WIDEST_SETTING:
        setting = match["key"]
    return f"  {setting:<{_WIDEST_SETTING}}  {meaning}".rstrip()


def _files(group: str) -> str:
    return " | ".join(sorted(file.stem for file in (CONF_DIR / group).glob("*.yaml")))
