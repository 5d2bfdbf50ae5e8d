"""``python -m tools.stack_halves PICTURE OUTPUT``: put the right half of a picture below its left
half, for the narrow screens of telephones.
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image


def stacked(picture: Image.Image) -> Image.Image:
    """Return a picture of half the width and twice the height."""
    width, height = picture.width // 2, picture.height
    result = Image.new(picture.mode, (width, 2 * height))
    result.paste(picture.crop((0, 0, width, height)), (0, 0))
    result.paste(picture.crop((width, 0, 2 * width, height)), (0, height))
    return result


def main() -> None:
    """Write the stacked picture."""
    source, target = map(Path, sys.argv[1:])
    with Image.open(source) as picture:
        stacked(picture).save(target, optimize=True)


if __name__ == "__main__":
    main()
