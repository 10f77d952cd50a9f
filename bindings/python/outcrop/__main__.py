"""python -m outcrop demo: builds a small machine, writes a picture of it, and picks a part."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import __version__, library_path
from ._demo import demo


def main() -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(prog="python -m outcrop", description="outcrop for Python",
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"outcrop {__version__}, {library_path}")
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("demo", help="builds a small machine, writes a picture of it, and picks a part")
    one.add_argument("-o", "--output", type=Path, default=Path("outcrop-demo.png"), help="picture (PNG)")
    one.add_argument("--size", default="1024x768", help="width and height in pixels")
    one.add_argument("--no-viewer", action="store_true", help="does not open the picture")
    arguments = parser.parse_args()
    try:
        width, height = map(int, arguments.size.split("x"))
    except ValueError:
        parser.error(f"--size {arguments.size}: expected a size like 1024x768")
    demo(arguments.output, width, height, not arguments.no_viewer)


if __name__ == "__main__":
    main()
