"""Bounded cache: built structures are found again by their content."""

import numpy as np

from warpcam.core.lru_cache import LruCache, key_of
from warpcam.textures.pack import TextureImage, pack_textures


def test_the_last_ones_are_kept() -> None:
    built: list[str] = []
    kept: LruCache[np.ndarray] = LruCache(200, lambda result: result.nbytes)

    def get(name: str, size: int = 100) -> np.ndarray:
        return kept.get(name.encode(), lambda: built.append(name) or np.zeros(size, np.uint8))

    first = get("a")
    get("b")
    assert get("a") is first and built == ["a", "b"]
    get("c")  # b was used longest ago
    get("a")
    get("b")
    assert built == ["a", "b", "c", "b"]
    get("large", 300)  # does not fit, and drives nothing out
    get("b")
    assert built == ["a", "b", "c", "b", "large"]


def test_what_two_threads_have_built_counts_once() -> None:
    kept: LruCache[np.ndarray] = LruCache(200, lambda result: result.nbytes)
    first, second = np.zeros(100, np.uint8), np.ones(100, np.uint8)
    for result in (first, second):  # neither found it
        kept.keep(b"a", result)
    kept.keep(b"b", first)
    assert kept.find(b"a") is second and kept.find(b"b") is first


def test_keys_tell_contents_apart() -> None:
    numbers = np.arange(6, dtype=np.int32)
    same = key_of(numbers, True, "a")
    assert same == key_of(numbers.copy(), True, "a")
    assert key_of(numbers[::2]) == key_of(numbers[::2].copy())
    others = [
        key_of(numbers.reshape(2, 3), True, "a"),
        key_of(numbers.view(np.uint32), True, "a"),
        key_of(numbers, False, "a"),
        key_of(numbers + 1, True, "a"),
        key_of(numbers, True, "b"),
    ]
    assert len({same, *others}) == 1 + len(others)


def test_mipmaps_are_those_of_means() -> None:
    """Sizes that halve evenly are counted in whole numbers; they come out as rounded means do."""
    pixels = np.random.default_rng(0).integers(0, 256, (16, 32, 3), dtype=np.uint8)
    packed = pack_textures([TextureImage("2d", pixels)], "cpu")
    texels = packed.texels.numpy().view(np.uint8).reshape(-1, 4)
    means = pixels.reshape(8, 2, 16, 2, 3).astype(float).mean(axis=(1, 3))
    assert (texels[512 : 512 + 128, :3].reshape(8, 16, 3) == np.rint(means)).all()


def test_one_image_on_six_faces() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    one = pack_textures([TextureImage("cube", pixels)], "cpu")
    six = pack_textures([TextureImage("cube", np.stack([pixels] * 6))], "cpu")
    assert (one.texels.numpy() == six.texels.numpy()).all()
