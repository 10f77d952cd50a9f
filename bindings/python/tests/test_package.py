"""The wheel, the types, the demo, the examples and the snippets of the README."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import numpy
import pytest
from conftest import PACKAGE, need

import outcrop

PICK = """
import numpy, outcrop, sys
assert outcrop.__file__.startswith(sys.prefix) and outcrop.library_path.startswith(sys.prefix), outcrop.library_path
with outcrop.Context() as context:
    context.build("a.oc", outcrop.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], name="plate"))
    with context.open("a.oc") as model, context.scene(model) as scene:
        picture = context.render(scene, outcrop.Camera(eye=(0.2, 0.2, 3), at=(0.2, 0.2, 0), up=(0, 1, 0)), 64, 64)
        print(model.part(picture.pick(32, 32).part).name)
        del picture
"""


def run(*command: str | Path, **environment: str) -> str:
    """Runs a command in a plain environment. Returns its output."""
    done = subprocess.run([str(word) for word in command], env={**{"PATH": os.environ["PATH"]}, **environment},
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def environment(folder: Path, packages: Path | None) -> Path:
    """Makes a bare virtual environment. It sees the packages of a folder. Returns its Python."""
    need("ensurepip")
    venv.create(folder, with_pip=True)
    if packages is not None:
        site = next(folder.glob("lib/python*/site-packages"))
        (site / "numpy-of-the-tests.pth").write_text(f"{packages}\n")
    return folder / "bin" / "python"


def test_wheel_installs_in_a_bare_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    numpy_at = Path(numpy.__file__).resolve().parent.parent
    python = environment(tmp_path / "venv", numpy_at)
    library = Path(outcrop.library_path).resolve()
    assert library.is_file(), "OUTCROP_LIBRARY names no file"
    run(python, "-m", "pip", "wheel", "-q", "--no-index", "--no-deps", "-w", tmp_path / "dist", PACKAGE,
        OUTCROP_LIBRARY=str(library))
    (wheel,) = (tmp_path / "dist").iterdir()
    assert re.fullmatch(r"outcrop-\d+\.\d+\.\d+-py3-none-\w+\.whl", wheel.name)
    with zipfile.ZipFile(wheel) as archive:
        names = {name.split("/", 1)[1] for name in archive.namelist()}
    assert {"__init__.py", "py.typed", "liboutcrop.so", "METADATA", "RECORD", "licenses/LICENSE-MIT"} <= names
    run(python, "-m", "pip", "install", "-q", "--no-index", "--no-deps", "--find-links", tmp_path / "dist", "outcrop")
    (tmp_path / "pick.py").write_text(PICK)
    monkeypatch.chdir(tmp_path)
    assert run(python, "pick.py", PATH="") == "plate\n"
    # The variable overrides the library of the wheel.
    shutil.copy(library, tmp_path / "other.so")
    shown = run(python, "-m", "outcrop", "--version", PATH="", OUTCROP_LIBRARY=str(tmp_path / "other.so"))
    assert shown == f"outcrop {outcrop.__version__}, {tmp_path / 'other.so'}\n"


def test_cargo_builds_the_library_of_the_wheel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import _backend

    cargo = tmp_path / "bin" / "cargo"
    cargo.parent.mkdir()
    cargo.write_text('#!/bin/sh\necho "$@" >"$LOG"\nmkdir -p "$CARGO_TARGET_DIR/release"\n'
                     f'echo library >"$CARGO_TARGET_DIR/release/{_backend.LIBRARY}"\n')
    cargo.chmod(0o755)
    monkeypatch.delenv("OUTCROP_LIBRARY", raising=False)
    monkeypatch.setenv("PATH", f"{cargo.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("CARGO_TARGET_DIR", str(tmp_path / "target"))
    monkeypatch.setenv("LOG", str(tmp_path / "log"))
    name = _backend.build_wheel(str(tmp_path))
    first = (tmp_path / name).read_bytes()
    with zipfile.ZipFile(tmp_path / name) as archive:
        assert archive.read("outcrop/" + _backend.LIBRARY) == b"library\n"
    assert "--release --lib --no-default-features --features reserve" in (tmp_path / "log").read_text()
    assert _backend.build_wheel(str(tmp_path)) == name and (tmp_path / name).read_bytes() == first
    cargo.write_text("#!/bin/sh\nexit 101\n")
    with pytest.raises(SystemExit, match="cargo failed with status 101"):
        _backend.build_wheel(str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit, match="cargo is not found.*OUTCROP_LIBRARY"):
        _backend.build_wheel(str(tmp_path))
    monkeypatch.setenv("OUTCROP_LIBRARY", str(tmp_path / "missing.so"))
    with pytest.raises(SystemExit, match="there is no file"):
        _backend.build_wheel(str(tmp_path))


def test_a_missing_or_wrong_library_is_an_import_error(tmp_path: Path) -> None:
    (tmp_path / "text.so").write_text("no library")
    subprocess.run(["cc", "-shared", "-o", tmp_path / "empty.so", "-x", "c", "/dev/null"], check=True)
    for path in [tmp_path / "missing.so", tmp_path / "text.so", tmp_path / "empty.so"]:
        code = "try:\n import outcrop\nexcept ImportError as error:\n print(error)"
        text = run(sys.executable, "-B", "-c", code, PYTHONPATH=str(PACKAGE), OUTCROP_LIBRARY=str(path))
        assert f"the shared library {path} cannot be loaded" in text and "OUTCROP_LIBRARY names another" in text


def test_types_are_strict(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    need("mypy")
    monkeypatch.chdir(PACKAGE)
    run(sys.executable, "-m", "mypy", "--cache-dir", tmp_path)


def test_demo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    text = run(sys.executable, "-B", "-m", "outcrop", "demo", "-o", "a.png", "--size", "320x240", "--no-viewer",
               PYTHONPATH=str(PACKAGE), OUTCROP_LIBRARY=outcrop.library_path)
    assert "wrote a.png (320 x 240 pixels, DONE)" in text and "at pixel 160, 120: shaft" in text
    assert (tmp_path / "a.png").stat().st_size > 5000 and [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_notebook_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    runpy.run_path(str(PACKAGE / "examples" / "notebook.py"))
    assert "500000 triangles" in capsys.readouterr().out


def test_snippets_of_the_readme_run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
                                    tmp_path: Path) -> None:
    text = (PACKAGE / "README.md").read_text(encoding="utf-8")
    snippets = re.findall(r"^## (.*?)\n.*?^```python\n(.*?)^```", text, re.M | re.S)
    assert len(snippets) == 11
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for title, code in snippets:
        exec(compile(code, title, "exec"), names)
    output = capsys.readouterr().out
    assert "tetra intersects the box" in output and "expected shape (N, 3)" in output
    names.clear()
