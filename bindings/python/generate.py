"""Generates the modules of the package that repeat include/outcrop.h: structs, signatures, enumerations and values.

    python3 generate.py            writes outcrop/_abi.py, outcrop/_enums.py and outcrop/_values.py
    python3 generate.py --check    fails if one of them is not up to date

The header is generated too (cbindgen), so it is regular: each declaration has one comment before it, and stands alone.
"""

from __future__ import annotations

import re
import sys
import textwrap
from dataclasses import dataclass, field
from pathlib import Path

HERE = Path(__file__).resolve().parent
HEADER = HERE.parent.parent / "include" / "outcrop.h"
WIDTH = 118

SCALARS = {
    "uint8_t": ("c.c_uint8", "int", "0"), "uint32_t": ("c.c_uint32", "int", "0"),
    "int32_t": ("c.c_int32", "int", "0"), "uint64_t": ("c.c_uint64", "int", "0"),
    "int64_t": ("c.c_int64", "int", "0"), "size_t": ("c.c_size_t", "int", "0"),
    "float": ("c.c_float", "float", "0.0"), "double": ("c.c_double", "float", "0.0"),
}
# Value classes that the package extends under the same names.
EXTENDED = {"oc_build_report", "oc_hit"}
# Names of value classes that are not those of their structs.
RENAMED = {"oc_build_desc": "BuildOptions", "oc_frame_accuracy": "Accuracy"}


@dataclass
class Member:
    """A member of a struct, or an argument. `length` is 0 unless it is an array."""

    name: str
    type: str
    length: int
    doc: str


@dataclass
class Header:
    """All declarations, in the order of the header."""

    constants: list[tuple[str, int, str]] = field(default_factory=list)
    enums: dict[str, str] = field(default_factory=dict)
    callbacks: dict[str, tuple[str, list[Member]]] = field(default_factory=dict)
    structs: dict[str, tuple[str, list[Member]]] = field(default_factory=dict)
    handles: list[str] = field(default_factory=list)
    functions: dict[str, tuple[str, list[Member]]] = field(default_factory=dict)


def clean(comment: str) -> str:
    """Returns the text of a comment."""
    lines = [re.sub(r"^\s*\*? ?", "", line) for line in comment.strip().splitlines()]
    return "\n".join(line.rstrip() for line in lines).strip()


def declarator(text: str, doc: str = "") -> Member:
    """Parses one declarator, e.g. `const double *eye` or `float colour[4]`."""
    text = re.sub(r"\b(const|struct)\b", "", " ".join(text.split())).strip()
    text = re.sub(r"\*\s+(?=\*)", "*", text)
    found = re.fullmatch(r"(\w+)\s*(\**)\s*(\w+)(?:\[(\d+)\])?", text)
    if not found:
        raise SystemExit(f"{HEADER.name}: `{text}` is not understood")
    base, stars, name, length = found.groups()
    return Member(name, base + stars, int(length or 0), doc)


def arguments(text: str) -> list[Member]:
    """Parses the arguments of a function."""
    return [] if text.strip() == "void" else [declarator(one) for one in text.split(",")]


def parse(text: str) -> Header:
    """Parses the header."""
    header = Header()
    item = re.compile(
        r"/\*\*(?P<doc>(?:[^*]|\*(?!/))*)\*/\s*(?:"
        r"#define (?P<constant>OC_\w+) (?P<value>\d+)(?:ull)?\n"
        r"|typedef (?P<returns>[\w ]+?\s*\**)\(\*(?P<callback>\w+)\)\((?P<takes>[^)]*)\);"
        r"|typedef uint32_t (?P<enum>\w+);"
        r"|typedef struct (?P<struct>\w+) \{(?P<body>.*?)\n\} \w+;"
        r"|typedef struct (?P<handle>\w+) \w+;"
        r"|OC_API\s+(?P<result>[\w ]+?[\s*]+)(?P<function>oc_\w+)\((?P<parameters>[^)]*)\);)",
        re.S)
    for found in item.finditer(text):
        doc = clean(found["doc"])
        if found["constant"]:
            header.constants.append((found["constant"], int(found["value"]), doc))
        elif found["callback"]:
            header.callbacks[found["callback"]] = (found["returns"].strip(), arguments(found["takes"]))
        elif found["enum"]:
            header.enums[found["enum"]] = doc
        elif found["struct"]:
            body = re.finditer(r"/\*\*((?:[^*]|\*(?!/))*)\*/\s*([^;]+);", found["body"])
            header.structs[found["struct"]] = (doc, [declarator(one[2], clean(one[1])) for one in body])
        elif found["handle"]:
            header.handles.append(found["handle"])
        else:
            header.functions[found["function"]] = (found["result"].strip(), arguments(found["parameters"]))
    check(header, text)
    return header


def check(header: Header, text: str) -> None:
    """Fails if the expressions above have overlooked a declaration."""
    counts = {
        r"^OC_API": len(header.functions), r"^typedef struct \w+ \{": len(header.structs),
        r"^typedef uint32_t \w+;": len(header.enums), r"^#define OC_\w+ \d": len(header.constants),
        r"^typedef [^;{]*\(\*": len(header.callbacks), r"^typedef struct \w+ \w+;": len(header.handles),
    }
    for expression, count in counts.items():
        there = len(re.findall(expression, text, re.M))
        if there != count:
            raise SystemExit(f"{HEADER.name}: {there} declarations `{expression}`, but {count} were understood")


def camel(name: str) -> str:
    """Returns the name of the class of a struct or of an enumeration."""
    return RENAMED.get(name) or "".join(word.title() for word in name.split("_")[1:])


def prefix(enum: str) -> str:
    """Returns the prefix of the constants of an enumeration: OC_LIGHT_ of oc_light_kind."""
    return re.sub(r"_(level|flags|axis|kind)$", "", enum).upper() + "_"


def base_of(enum: str) -> str:
    """Returns the base class of an enumeration."""
    return "IntFlag" if enum.endswith("_flags") or enum == "oc_want" else "IntEnum"


def enum_of(constant: str, header: Header) -> str | None:
    """Returns the enumeration that a constant belongs to."""
    fitting = [enum for enum in header.enums if constant.startswith(prefix(enum))]
    return max(fitting, key=lambda enum: len(prefix(enum)), default=None)


def in_python(doc: str, header: Header) -> str:
    """Replaces C names by those of the package."""
    for enum in sorted(header.enums, key=lambda enum: -len(prefix(enum))):
        doc = re.sub(rf"\b{prefix(enum)}(constants|flags)?(?=[ ,.]|$)", f"{camel(enum)} ", doc)
        doc = re.sub(rf"\b{prefix(enum)}(\w+)", rf"{camel(enum)}.\1", doc)
    doc = re.sub(r"(\w) +(constants|flags)", r"\1 \2", doc).replace(" ,", ",")
    for struct in sorted(header.structs, key=len, reverse=True):
        doc = re.sub(rf"\b{struct}\b", camel(struct), doc)
    return doc.replace("\\", "\\\\")


def docstring(doc: str, header: Header, indent: str) -> str:
    """Returns a docstring of the width of the package."""
    paragraphs: list[str] = []
    for block in in_python(doc, header).split("\n\n"):
        for one in re.split(r"\n(?=- )", block):
            hanging = indent + ("  " if one.startswith("- ") else "")
            paragraphs.append(textwrap.fill(" ".join(one.split()), WIDTH - 4, initial_indent=indent,
                                            subsequent_indent=hanging, break_long_words=False))
        paragraphs.append("")
    text = "\n".join(paragraphs).strip()
    return f'{indent}"""{text}"""' if "\n" not in text else f'{indent}"""{text}\n{indent}"""'


def c_type(name: str, header: Header) -> str:
    """Returns the ctypes type of a C type."""
    if name in SCALARS:
        return SCALARS[name][0]
    if name in header.enums:
        return "c.c_uint32"
    if name in header.callbacks:
        return name
    if name == "void":
        return "None"
    if name == "char*":
        return "c.c_char_p"
    if name.endswith("*"):
        return "c.c_void_p"
    raise SystemExit(f"{HEADER.name}: the type `{name}` is not understood")


def listed(items: list[str], indent: str) -> str:
    """Returns items in as few lines as possible. No item is broken."""
    text = ", ".join(item.replace(" ", "\0") for item in items)
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent,
                         break_long_words=False, break_on_hyphens=False).replace("\0", " ")


HEAD = '"""{about}\n\nThis file is generated from include/outcrop.h: run `python3 generate.py`.\n"""\n\n'


def abi(header: Header) -> str:
    """Returns the module of structs and signatures."""
    out = [HEAD.format(about="Structs, callbacks and functions of the C API, under their own names."),
           "from __future__ import annotations\n\nimport ctypes as c\nfrom typing import Any, Callable\n\n"]
    for name, value, doc in header.constants:
        if enum_of(name, header) is None:
            out.append(f"{name} = {value}\n{docstring(doc, header, '')}\n")
    out.append("\n# Callbacks.\n")
    for name, (returns, takes) in header.callbacks.items():
        all_types = [c_type(returns, header)] + [c_type(one.type, header) for one in takes]
        out.append(f"{name} = c.CFUNCTYPE({', '.join(all_types)})\n")
    out.append('\n\nclass Sized(c.Structure):\n'
               '    """A struct that begins with `struct_size`. The constructor sets it and zeroes the rest."""\n\n'
               '    def __init__(self, **members: Any) -> None:\n'
               '        super().__init__(struct_size=c.sizeof(type(self)), **members)\n')
    for name, (doc, members) in header.structs.items():
        base = "Sized" if members[0].name == "struct_size" else "c.Structure"
        fields = [f'("{one.name}", {c_type(one.type, header)}{f" * {one.length}" if one.length else ""})'
                  for one in members]
        first = doc.split("\n\n")[0]
        out.append(f"\n\nclass {name}({base}):\n{docstring(first, header, '    ')}\n\n"
                   f"    _fields_ = [\n{listed(fields, '        ')},\n    ]\n")
    out.append('\n\nSTRUCTS: list[type[c.Structure]] = [\n' + listed(list(header.structs), "    ") + ",\n]\n"
               '"""All structs, in the order of the header."""\n')
    out.append('\n\nclass Functions:\n    """The functions of the C API, as attributes. The loader sets them."""\n\n')
    for name, (returns, _) in header.functions.items():
        result = {"void": "None", "char *": "bytes", "const char *": "bytes"}.get(returns, "int")
        out.append(f"    {name}: Callable[..., {result}]\n")
    out.append("\n\nSIGNATURES: dict[str, tuple[Any, list[Any]]] = {\n")
    for name, (returns, takes) in header.functions.items():
        result = c_type(re.sub(r"const|\s", "", returns), header)
        types = [c_type(one.type, header) for one in takes]
        line = f'    "{name}": ({result}, [{", ".join(types)}]),\n'
        out.append(line if len(line) <= WIDTH else f'    "{name}": ({result}, [\n{listed(types, " " * 8)},\n    ]),\n')
    out.append('}\n"""Result and arguments of each function."""\n')
    out.append("\nFALLIBLE = frozenset([\n" + listed(
        [f'"{n}"' for n, (returns, _) in header.functions.items() if returns == "oc_status"], "    ") + ",\n])\n"
        '"""Functions that return a status."""\n')
    out.append(buffers(header))
    return "".join(out)


# Elements of a pixel in the comments of the OC_BUFFER_ constants: numpy's type of each.
ELEMENTS = {"byte": "u1", "float": "f4", "uint64_t": "u8", "uint32_t": "u4"}


def buffers(header: Header) -> str:
    """Returns the table of the elements of each buffer, which the comments of the constants begin with."""
    rows = []
    for name, value, doc in header.constants:
        if enum_of(name, header) == "oc_buffer":
            found = re.match(r"(\d) (\w+?)s?[:.]", doc)
            if not found or found[2] not in ELEMENTS:
                raise SystemExit(f"{HEADER.name}: the comment of {name} does not begin with its elements: {doc}")
            rows.append(f'    {value}: ("{ELEMENTS[found[2]]}", {found[1]}),\n')
    return ("\nBUFFERS: dict[int, tuple[str, int]] = {\n" + "".join(rows) + "}\n"
            '"""Type and number of the elements of a pixel, by buffer."""\n')


def enums(header: Header) -> str:
    """Returns the module of enumerations."""
    out = [HEAD.format(about="Enumerations of the C API."), "from __future__ import annotations\n\nimport enum\n"]
    for enum, doc in header.enums.items():
        out.append(f"\n\nclass {camel(enum)}(enum.{base_of(enum)}):\n{docstring(doc, header, '    ')}\n\n")
        for name, value, text in header.constants:
            if enum_of(name, header) == enum:
                member = name[len(prefix(enum)):]
                out.append(f"    {member} = {value}\n{docstring(text, header, '    ')}\n")
    out.append("\n\n__all__ = [\n" + listed([f'"{camel(enum)}"' for enum in header.enums], "    ") + ",\n]\n")
    return "".join(out)


def is_value(members: list[Member], name: str) -> bool:
    """Returns true if the struct becomes a value class: it has no pointer but strings."""
    return name in RENAMED or not any(one.type.endswith(("*", "_fn")) and one.type != "char*" for one in members)


def is_shown(member: Member) -> bool:
    """Returns true if the member becomes one of the value class."""
    hidden = member.name == "struct_size" or member.name.startswith("reserved")
    return not hidden and not member.type.endswith("_fn") and member.type != "void*"


def python_type(member: Member, header: Header) -> tuple[str, str]:
    """Returns the type and the default of a member of a value class."""
    if member.type == "char*":
        return "str | None", "None"
    if member.length:
        zero = SCALARS[member.type][2]
        listed = f"({', '.join([zero] * member.length)})"
        return "Vector", listed if member.length <= 12 else f"({zero},) * {member.length}"
    if member.type in header.enums:
        enum = camel(member.type)
        first = min(value for name, value, _ in header.constants if enum_of(name, header) == member.type)
        is_flags = base_of(member.type) == "IntFlag"
        return enum, f"{enum}({0 if is_flags else first})"
    _, kind, zero = SCALARS[member.type]
    return kind, zero


def values(header: Header) -> str:
    """Returns the module of value classes."""
    chosen = {name: (doc, [one for one in members if is_shown(one)])
              for name, (doc, members) in header.structs.items() if is_value(members, name)}
    used = sorted({camel(one.type) for _, members in chosen.values() for one in members if one.type in header.enums})
    about = "Structs without pointers, as dataclasses. A member that is 0 has its documented default."
    out = [HEAD.format(about=about),
           "from __future__ import annotations\n\nfrom dataclasses import dataclass\n\nfrom . import _abi\n"
           "from ._enums import (\n" + listed(used, "    ") + ",\n)\nfrom ._value import Value, Vector\n"]
    for name, (doc, members) in chosen.items():
        out.append(f"\n\n@dataclass\nclass {camel(name)}(Value):\n{docstring(doc, header, '    ')}\n\n"
                   f"    _struct = _abi.{name}\n\n")
        for one in members:
            kind, default = python_type(one, header)
            out.append(f"    {one.name}: {kind} = {default}\n{docstring(one.doc, header, '    ')}\n")
    exported = [f'"{camel(name)}"' for name in chosen if name not in EXTENDED]
    out.append("\n\n__all__ = [\n" + listed(exported, "    ") + ",\n]\n")
    return "".join(out)


def main() -> None:
    """Writes or checks the modules."""
    header = parse(HEADER.read_text(encoding="utf-8"))
    stale = []
    for name, text in [("_abi", abi(header)), ("_enums", enums(header)), ("_values", values(header))]:
        path = HERE / "outcrop" / f"{name}.py"
        if "--check" in sys.argv[1:]:
            stale += [] if path.exists() and path.read_text(encoding="utf-8") == text else [path.name]
        else:
            path.write_text(text, encoding="utf-8")
    if stale:
        raise SystemExit(f"{', '.join(stale)}: not up to date with {HEADER.name}; run `python3 generate.py`")


if __name__ == "__main__":
    main()
