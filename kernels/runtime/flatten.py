"""Images as native code takes them: with one dimension, whatever they have."""

import warp as wp

MOST = 2**31  # numbers that a dimension of Warp's has fewer of


def flatten(image: wp.array) -> wp.array:
    """Return the array's memory as one dimension, for native code, which indexes it in 64 bits.

    An image has fewer than 2^31 pixels, but with their channels it may have more numbers: then it is one of each pixel.
    """
    if image.size < MOST:
        return image.flatten()
    channels = image.shape[-1]
    return image.reshape((image.size // channels, channels))[:, 0]
