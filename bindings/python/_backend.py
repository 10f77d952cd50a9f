"""Builds the wheel (PEP 517). It carries the shared library, which cargo builds from this repository.

With OUTCROP_LIBRARY, that file is taken as it is and cargo does not run. The wheel fits any Python 3 of this platform:
its tag is py3-none-<platform>.
"""

from __future__ import annotations

import base64
import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LIBRARIES = {"darwin": "liboutcrop.dylib", "win32": "outcrop.dll"}
LIBRARY = LIBRARIES.get(sys.platform, "liboutcrop.so")
LICENSES = ("LICENSE-MIT", "LICENSE-APACHE", "THIRD_PARTY.txt")
SUMMARY = r'^description = "(.*)"$'


class UnsupportedOperation(Exception):
    """There is no source distribution: the sources are the repository."""


def get_requires_for_build_wheel(_settings: Any = None) -> list[str]:
    """Nothing is needed."""
    return []


def get_requires_for_build_editable(_settings: Any = None) -> list[str]:
    """Nothing is needed."""
    return []


def get_requires_for_build_sdist(_settings: Any = None) -> list[str]:
    """See `build_sdist`."""
    raise UnsupportedOperation("outcrop is built from its repository")


def build_sdist(_folder: str, _settings: Any = None) -> str:
    """There is none."""
    raise UnsupportedOperation("outcrop is built from its repository: pip install bindings/python, or pip wheel")


def build_wheel(folder: str, _settings: Any = None, _metadata: str | None = None) -> str:
    """Writes the wheel into the folder. Returns its name."""
    files = {f"outcrop/{path.name}": path.read_bytes() for path in sorted((HERE / "outcrop").iterdir())
             if path.suffix in (".py", ".typed")}
    files[f"outcrop/{LIBRARY}"] = library().read_bytes()
    return write_wheel(Path(folder), files)


def build_editable(folder: str, _settings: Any = None, _metadata: str | None = None) -> str:
    """Writes a wheel that refers to this folder. The library is that of OUTCROP_LIBRARY, or of the system."""
    return write_wheel(Path(folder), {"outcrop.pth": f"{HERE}\n".encode()})


def library() -> Path:
    """Returns the shared library."""
    chosen = os.environ.get("OUTCROP_LIBRARY")
    if chosen:
        path = Path(chosen).resolve()
        if not path.is_file():
            raise SystemExit(f"OUTCROP_LIBRARY: there is no file {path}")
        return path
    # Not the crate's own target/: the library there may have other features.
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "build" / "python" / "cargo")
    command = ["cargo", "build", "--manifest-path", str(ROOT / "Cargo.toml"), "--locked", "--release", "--lib",
               "--no-default-features", "--features", "reserve", "--target-dir", str(target)]
    try:
        subprocess.run(command, env={**os.environ, "CARGO_PROFILE_RELEASE_STRIP": "symbols"}, check=True)
    except FileNotFoundError:
        raise SystemExit("cargo is not found: install Rust (https://rustup.rs), or set OUTCROP_LIBRARY to the path of "
                         "a built shared library") from None
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"cargo failed with status {error.returncode}") from None
    return target / "release" / LIBRARY


def version() -> str:
    """Returns the version of the crate, which is that of the package."""
    found = re.search(r'^version = "(.*)"$', (ROOT / "Cargo.toml").read_text(encoding="utf-8"), re.M)
    assert found, "Cargo.toml has no version"
    return found[1]


def metadata() -> str:
    """Returns the METADATA file."""
    project = (HERE / "pyproject.toml").read_text(encoding="utf-8")
    description, python = re.search(SUMMARY, project, re.M), re.search(r'^requires-python = "(.*)"$', project, re.M)
    numpy = re.search(r'^dependencies = \["(.*)"\]$', project, re.M)
    assert description and python and numpy, "pyproject.toml has changed"
    lines = ["Metadata-Version: 2.1", "Name: outcrop", f"Version: {version()}", f"Summary: {description[1]}",
             "License: MIT OR Apache-2.0", f"Requires-Python: {python[1]}", f"Requires-Dist: {numpy[1]}",
             "Description-Content-Type: text/markdown", "", (HERE / "README.md").read_text(encoding="utf-8")]
    return "\n".join(lines)


def tag() -> str:
    """Returns the tag of the wheel."""
    return "py3-none-" + re.sub(r"[-.]", "_", sysconfig.get_platform())


def write_wheel(folder: Path, files: dict[str, bytes]) -> str:
    """Writes a wheel of the files and the metadata. The same files give the same bytes."""
    info = f"outcrop-{version()}.dist-info"
    wheel = f"Wheel-Version: 1.0\nGenerator: outcrop\nRoot-Is-Purelib: false\nTag: {tag()}\n"
    files = {**files, f"{info}/METADATA": metadata().encode(), f"{info}/WHEEL": wheel.encode()}
    files.update({f"{info}/licenses/{name}": (ROOT / name).read_bytes() for name in LICENSES})
    rows = []
    for name, content in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        rows.append(f"{name},sha256={digest},{len(content)}\n")
    files[f"{info}/RECORD"] = ("".join(rows) + f"{info}/RECORD,,\n").encode()
    name = f"outcrop-{version()}-{tag()}.whl"
    with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in files.items():
            entry = zipfile.ZipInfo(path)
            entry.external_attr = 0o644 << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return name
