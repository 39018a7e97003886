"""Numbers of threads as places in arrays."""

import warp as wp


@wp.func_native("return (int)((unsigned int)number / (unsigned int)divisor);")
def times_in(number: wp.int32, divisor: wp.int32) -> wp.int32:
    """How many whole times the divisor is in a number, both of at least 0: a third of what a signed ``//`` takes."""
    ...


@wp.func
def row_and_column(index: wp.int32, width: wp.int32):
    """Place of an entry in an array of rows of that width."""
    row = times_in(index, width)
    return row, index - row * width


STRIP = wp.constant(4)  # rows of a strip
COLOR_STRIP = wp.constant(8)  # of colours, for which a thread has more to find out first
strip_vector = wp.types.vector(length=int(STRIP), dtype=wp.float32)  # a number for each row of a strip


def strips_of(width: int, height: int, rows: int = STRIP) -> int:
    """Strips of an image: pieces of its columns, of so many pixels or of what is left at the lower border."""
    return width * -(-height // int(rows))


@wp.func
def piece_of(index: wp.int32, size: wp.vec2i, rows: wp.int32):
    """World, column, first row and end of the rows of a strip of so many rows.

    Strips beside one another are of neighbouring columns. A thread of a strip reads what its world has once, and finds
    rows and columns without a division for each pixel.
    """
    strip, column = row_and_column(index, size[0])
    world, part = row_and_column(strip, times_in(size[1] + rows - 1, rows))
    return world, column, rows * part, wp.min(rows * part + rows, size[1])


@wp.func
def strip_of(index: wp.int32, size: wp.vec2i):
    """World, column, first row and end of the rows of a strip."""
    world, column, top, bottom = piece_of(index, size, STRIP)
    return world, column, top, bottom


@wp.func
def color_strip_of(index: wp.int32, size: wp.vec2i):
    """Those of a strip of colours."""
    world, column, top, bottom = piece_of(index, size, COLOR_STRIP)
    return world, column, top, bottom
