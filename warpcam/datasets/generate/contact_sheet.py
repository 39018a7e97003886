"""Contact sheet: some images of a data set with their boxes, masks and classes drawn over them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from cmap import Colormap
from PIL import Image, ImageDraw

from warpcam.datasets.generate.frames import Frame
from warpcam.datasets.generate.shards import FinishedShard

FOLDER = "previews"
PER_SHARD = 8  # that a shard keeps
SHOWN, COLUMNS = 24, 6
WIDTH = 320  # of a preview [pixels]
GAP = 4
PAPER = (255, 255, 255)


class Previews:
    """Small images with labels, of frames evenly over a shard.

    Args:
        folder: Of the shard.
        frames: How many frames the shard has.
    """

    def __init__(self, folder: Path, frames: int):
        self._folder = folder / FOLDER
        self._folder.mkdir()
        self._places = {number * frames // PER_SHARD for number in range(PER_SHARD)}

    def add(self, place: int, frame: Frame) -> None:
        """Keep a frame if it is one of these."""
        if place in self._places:
            image = Image.fromarray(annotated(frame))
            height = max(1, round(WIDTH * image.height / image.width))
            image.resize(
                (WIDTH, height), Image.Resampling.BOX if image.width > WIDTH else Image.Resampling.NEAREST
            ).save(self._folder / f"{place:06d}.png")


def annotated(frame: Frame) -> np.ndarray:
    """Colours of a frame with tinted masks, visible boxes (solid), amodal boxes (thin, white) and classes."""
    colors = frame.colors.astype(np.float32)
    seen = [each for each in frame.instances if each.visible_pixels > 0]
    for each in seen:
        mask = frame.mask(each)
        colors[mask] = 0.6 * colors[mask] + 0.4 * np.array(class_color(each.category), np.float32)
    image = Image.fromarray(np.round(colors).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    for each in seen:
        left, top, right, bottom = each.amodal_box
        if each.amodal_box != each.visible_box:
            draw.rectangle((left, top, right - 1, bottom - 1), outline=(255, 255, 255))
        left, top, right, bottom = each.visible_box
        draw.rectangle((left, top, right - 1, bottom - 1), outline=class_color(each.category))
        draw.text((left + 2, top + 1), frame.classes[each.category], fill=class_color(each.category))
        for x, y, visible in each.keypoints:
            if visible > 0:
                filled = class_color(each.category) if visible == 2 else None
                draw.ellipse((x - 2, y - 2, x + 2, y + 2), outline=(255, 255, 255), fill=filled)
    return np.asarray(image)


def class_color(category: int) -> tuple[int, int, int]:
    """A bright colour; those of classes in a row are far apart."""
    red, green, blue, _ = Colormap("hsv")((0.13 + 0.618034 * category) % 1.0).rgba
    return round(255 * red), round(255 * green), round(255 * blue)


def write_contact_sheet(out: Path, shards: Sequence[FinishedShard]) -> None:
    """Write contact_sheet.png: previews evenly over all shards."""
    paths = [path for shard in shards for path in sorted((shard.path / FOLDER).iterdir())]
    count = min(SHOWN, len(paths))
    images = [Image.open(paths[number * len(paths) // count]).convert("RGB") for number in range(count)]
    columns = min(COLUMNS, count)
    width, height = images[0].size
    rows = -(-count // columns)
    sheet = Image.new("RGB", (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP), PAPER)
    for number, image in enumerate(images):
        sheet.paste(image, (number % columns * (width + GAP), number // columns * (height + GAP)))
    sheet.save(out / "contact_sheet.png", optimize=True)
