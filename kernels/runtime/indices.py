"""Numbers of threads as places in arrays."""

import warp as wp


@wp.func
def row_and_column(index: wp.int32, width: wp.int32):
    """Place of an entry in an array of rows of that width."""
    row = index // width
    return row, index - row * width
