"""The generated modules are those of the header, and every function of the header is used."""

from __future__ import annotations

import ctypes
import re
import subprocess
import sys
from typing import Any

from conftest import INCLUDE, PACKAGE

from outcrop import _abi

# Functions that the package does not call, and why.
NOT_CALLED = {
    "oc_init": "the structs set their own size",
    "oc_status_name": "Status has the names",
    "oc_model_open": "oc_model_load does the same, and Ctrl-C can end it",
    "oc_model_open_io": "oc_model_load does the same, and Ctrl-C can end it",
    "oc_context_retain": "Python counts the references",
    "oc_build_retain": "Python counts the references",
    "oc_job_retain": "Python counts the references",
    "oc_model_retain": "Python counts the references",
    "oc_scene_retain": "Python counts the references",
    "oc_frame_retain": "Python counts the references",
    "oc_mapping_retain": "Python counts the references",
    "oc_part_reader_retain": "Python counts the references",
    "oc_part_set_retain": "Python counts the references",
    "oc_cursor_retain": "Python counts the references",
}


def test_modules_are_up_to_date() -> None:
    subprocess.run([sys.executable, "-B", str(PACKAGE / "generate.py"), "--check"], check=True)


def test_structs_are_those_of_the_compiler() -> None:
    asserts = ["#include <outcrop.h>", "#include <stddef.h>"]
    for struct in _abi.STRUCTS:
        name = struct.__name__
        asserts.append(f'_Static_assert(sizeof({name}) == {ctypes.sizeof(struct)}, "{name}");')
        members: list[Any] = list(struct._fields_)
        for field, _ in members:
            offset = getattr(struct, field).offset
            asserts.append(f'_Static_assert(offsetof({name}, {field}) == {offset}, "{name}.{field}");')
    assert len(asserts) > 150
    command = ["cc", "-std=c11", "-fsyntax-only", "-x", "c", "-I", str(INCLUDE), "-"]
    subprocess.run(command, input="\n".join(asserts) + "\n", text=True, check=True)


def test_every_function_is_called() -> None:
    header = (INCLUDE / "outcrop.h").read_text(encoding="utf-8")
    declared = set(re.findall(r"^(?:OC_API\s+)?[\w ]+[ *](oc_\w+)\(", header, re.M)) & set(_abi.SIGNATURES)
    assert declared == set(_abi.SIGNATURES)
    sources = "".join(path.read_text(encoding="utf-8") for path in (PACKAGE / "outcrop").glob("*.py")
                      if path.name != "_abi.py")
    called = set(re.findall(r"\b(?:lib|library)\.(oc_\w+)", sources))
    assert called <= declared
    assert declared - called == set(NOT_CALLED), "call them, or say here why not"


def test_modules_are_short() -> None:
    for path in [*PACKAGE.glob("*.py"), *(PACKAGE / "outcrop").glob("*.py"), *(PACKAGE / "tests").glob("*.py")]:
        lines = path.read_text(encoding="utf-8").splitlines()
        is_generated = path.name in ("_abi.py", "_enums.py", "_values.py")
        assert is_generated or len(lines) <= 600, path
        assert max(map(len, lines)) <= 120, path
