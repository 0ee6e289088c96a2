#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes src/splatd/types.py: a TypedDict for each object of protocol/view.schema.json.

Usage: generate_types.py [--check]      --check compares, and fails if the file is out of date
"""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path

HERE = Path(__file__).parent
SCHEMA = HERE / "../../protocol/view.schema.json"
OUT = HERE / "src/splatd/types.py"
HEAD = '''# SPDX-License-Identifier: Apache-2.0
"""Types of the view, for type checkers and editors. generate_types.py writes this file from protocol/view.schema.json.

All members of a patch may be missing. None stands for the default of the volume. Vectors of the world are in the order
x, y, z, unlike the arrays of this package.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypedDict
'''
PLAIN = {"number": "float", "integer": "int", "string": "str", "boolean": "bool", "null": "None"}


def class_name(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


class Writer:
    def __init__(self, schema: dict) -> None:
        self.definitions = schema["$defs"]
        self.written: dict[str, str] = {}

    def type_of(self, name: str, schema: dict) -> str:
        """The annotation of a member with this schema. The class of a nested object gets the member's `name`."""
        if "$ref" in schema:
            key = schema["$ref"].rsplit("/", 1)[1]
            return self.type_of(key, self.definitions[key])
        if "const" in schema:
            return f"Literal[{schema['const']!r}]"
        if "enum" in schema:
            values = ", ".join(repr(value) for value in schema["enum"] if value is not None)
            return f"Literal[{values}]" + (" | None" if None in schema["enum"] else "")
        for key in ("anyOf", "oneOf"):
            if key in schema:
                return " | ".join(self.type_of(name, one) for one in schema[key])
        types = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
        return " | ".join(self.plain(name, kind, schema) for kind in types)

    def plain(self, name: str, kind: str, schema: dict) -> str:
        if kind == "array":
            return f"Sequence[{self.type_of(name.removesuffix('s'), schema['items'])}]"
        return self.typed_dict(class_name(name), schema) if kind == "object" else PLAIN[kind]

    def typed_dict(self, name: str, schema: dict) -> str:
        if name in self.written:
            return name
        self.written[name] = ""  # keeps its place in front of the classes that use it
        required = schema.get("required", [])
        members = {
            key: (self.type_of(key, one), one) for key, one in schema["properties"].items() if not one.get("deprecated")
        }
        text = []
        if required:
            self.written[f"_{name}"] = self.body(f"_{name}(TypedDict)", "", {key: members[key] for key in required})
            text.append(f"class {name}(_{name}, total=False):")
        else:
            text.append(f"class {name}(TypedDict, total=False):")
        rest = {key: value for key, value in members.items() if key not in required}
        self.written[name] = self.body(text[0][6:-1], schema.get("description", ""), rest)
        # A class that others use comes before them.
        self.written[name] = self.written.pop(name)
        return name

    @staticmethod
    def body(head: str, description: str, members: dict) -> str:
        lines = [f"class {head}:"]
        if description:
            lines += textwrap.wrap(f'"""{description}"""', 116, initial_indent="    ", subsequent_indent="    ") + [
                ""
            ] * bool(members)
        for key, (annotation, schema) in members.items():
            lines += textwrap.wrap(
                f"#: {schema.get('description', '')}", 116, initial_indent="    ", subsequent_indent="    #: "
            )
            lines.append(f"    {key}: {annotation}")
        if not members and not description:
            lines.append("    pass")
        return "\n".join(lines)


def generate() -> str:
    schema = json.loads(SCHEMA.read_text())
    writer = Writer(schema)
    writer.typed_dict("ViewPatch", schema)
    return HEAD + "".join(f"\n\n{text}\n" for text in writer.written.values() if text)


def main() -> int:
    text = generate()
    if "--check" not in sys.argv:
        OUT.write_text(text)
        return 0
    if OUT.read_text() == text:
        return 0
    print(f"{OUT} does not follow {SCHEMA}: run {__file__}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
