"""Numbers of threads as places in arrays."""

import warp as wp


@wp.func
def row_and_column(index: wp.int32, width: wp.int32):
    """Place of an entry in an array of rows of that width."""
    row = index // width
    return row, index - row * width


STRIP = wp.constant(4)  # rows of a strip
strip_vector = wp.types.vector(length=int(STRIP), dtype=wp.float32)  # a number for each row of a strip


def strips_of(width: int, height: int) -> int:
    """Strips of an image: pieces of its columns, of STRIP pixels or of what is left at the lower border."""
    return width * -(-height // int(STRIP))


@wp.func
def strip_of(index: wp.int32, size: wp.vec2i):
    """World, column, first row and end of the rows of a strip; those beside one another are of neighbouring columns.

    A thread of a strip reads what its world has once, and finds rows and columns without a division for each pixel.
    """
    strip, column = row_and_column(index, size[0])
    world, part = row_and_column(strip, (size[1] + STRIP - 1) // STRIP)
    return world, column, STRIP * part, wp.min(STRIP * part + STRIP, size[1])
