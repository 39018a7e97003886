"""Pairs of native functions, one for single places and one for packets of eight, run side by side on a CPU."""

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp
from native_kernel import native_kernel

from warpcam.kernels import types
from warpcam.kernels.flags import GeometryFlag, SceneFlag
from warpcam.textures.pack import TextureImage, pack_textures

PACKET = 8
PACKETS = 256
COLUMNS = 32  # of results
FACES = 6  # of the mesh
ROWS = PACKET * PACKETS

Array = npt.NDArray[Any]

READ = """
    using namespace warpcam;
    const auto number = [&](int k, int c) { return wp::index(given, SIMD_WIDTH * i + k, c); };
    const auto same = [&](int c) { return number(0, c); };
    const auto same_vec = [&](int c) { return Vec3 { same(c), same(c + 1), same(c + 2) }; };
    const auto write_eight = [&](auto& to, int& column, auto value) {
        constexpr int COUNT = sizeof(value) / sizeof(Float8);
        Float8 words[COUNT];
        if constexpr (__is_same(decltype(value), Int8))
            words[0] = to_floats(value);
        else
            __builtin_memcpy(words, &value, sizeof value);
        for (int c = 0; c < COUNT; ++c, ++column)
            for (int k = 0; k < SIMD_WIDTH; ++k)
                wp::index(to, SIMD_WIDTH * i + k, column) = words[c][k];
    };
    const auto write_one = [&](auto& to, int& column, int k, auto value) {
        constexpr int COUNT = (sizeof(value) + 3) / 4;
        float words[COUNT];
        if constexpr (__is_same(decltype(value), bool))
            words[0] = value ? -1.0f : 0.0f;
        else if constexpr (__is_same(decltype(value), int))
            words[0] = (float)value;
        else
            __builtin_memcpy(words, &value, sizeof value);
        for (int c = 0; c < COUNT; ++c, ++column)
            wp::index(to, SIMD_WIDTH * i + k, column) = words[c];
    };
"""
CASE = """
    if (which == {which}) {{
        {setup}
        {{
            int exact_column = 0, close_column = 0;
            const auto in = [&](int c) {{
                Float8 value;
                for (int k = 0; k < SIMD_WIDTH; ++k)
                    value[k] = number(k, c);
                return value;
            }};
            const auto vec = [&](int c) {{ return Vec3x8 {{ in(c), in(c + 1), in(c + 2) }}; }};
            const auto exact = [&](auto value) {{ write_eight(exact_eight, exact_column, value); }};
            const auto close = [&](auto value) {{ write_eight(close_eight, close_column, value); }};
            {eight}
        }}
        for (int k = 0; k < SIMD_WIDTH; ++k) {{
            int exact_column = 0, close_column = 0;
            const auto in = [&](int c) {{ return number(k, c); }};
            const auto vec = [&](int c) {{ return Vec3 {{ in(c), in(c + 1), in(c + 2) }}; }};
            const auto exact = [&](auto value) {{ write_one(exact_one, exact_column, k, value); }};
            const auto close = [&](auto value) {{ write_one(close_one, close_column, k, value); }};
            {one}
        }}
    }}
"""
# A pose: rotation 9, centre of projection 18, size 21.
POSE = """
    const auto row = [&](int c, float w) { return make_float3_int(same_vec(c), as_int(w)); };
    const ShapeFromCamera pose { row(9, same(18)), row(12, same(19)), row(15, same(20)),
                                 make_float3_int(same_vec(21), TYPE + 16) };
"""


@dataclass(frozen=True)
class Twin:
    """A pair of functions and what it is called with.

    The snippets read inputs with ``in(column)`` and ``vec(first column)``, what all places of a packet share with
    ``same(column)`` and ``same_vec(first column)``, and write results with ``exact()`` and ``close()``.

    Attributes:
        inputs: (place, column), from a random generator; places come in packets of eight.
        one: C++ that computes the results of place ``k``.
        eight: C++ that computes those of a packet.
        setup: C++ in front of both.
        rtol: How far results written with ``close()`` may be apart, as a part of the larger one.
        atol: The same, in their own unit.
    """

    inputs: Callable[[np.random.Generator], Array]
    one: str
    eight: str
    setup: str = ""
    rtol: float = 0.0
    atol: float = 0.0


@dataclass(frozen=True)
class Tables:
    """Tables that twins look up."""

    meshes: types.Meshes
    fields: types.HeightFields
    textures: types.Textures


class Family:
    """Twins that are compiled together."""

    def __init__(self, header: str, twins: Mapping[str, Twin]):
        self.twins = twins
        self._which = {name: which for which, name in enumerate(twins)}
        code = READ + "".join(
            CASE.format(which=which, setup=twin.setup, one=twin.one, eight=twin.eight)
            for which, twin in enumerate(twins.values())
        )

        @wp.func_native(code)
        def run(
            which: wp.int32,
            i: wp.int32,
            meshes: types.Meshes,
            fields: types.HeightFields,
            textures: types.Textures,
            given: wp.array2d(dtype=wp.float32),
            exact_one: wp.array2d(dtype=wp.float32),
            exact_eight: wp.array2d(dtype=wp.float32),
            close_one: wp.array2d(dtype=wp.float32),
            close_eight: wp.array2d(dtype=wp.float32),
        ): ...

        @native_kernel(header)
        def run_twins(
            which: wp.int32,
            meshes: types.Meshes,
            fields: types.HeightFields,
            textures: types.Textures,
            given: wp.array2d(dtype=wp.float32),
            exact_one: wp.array2d(dtype=wp.float32),
            exact_eight: wp.array2d(dtype=wp.float32),
            close_one: wp.array2d(dtype=wp.float32),
            close_eight: wp.array2d(dtype=wp.float32),
        ):
            run(
                which, wp.tid(), meshes, fields, textures, given, exact_one, exact_eight, close_one, close_eight
            )  # fmt: skip

        self._kernel = run_twins

    def check(self, name: str) -> None:
        """Fails where the two functions differ by more than their twin allows."""
        twin, looked_up = self.twins[name], tables()
        given = np.ascontiguousarray(twin.inputs(np.random.default_rng(len(name))), np.float32)
        results = [wp.zeros((len(given), COLUMNS), dtype=wp.float32, device="cpu") for _ in range(4)]
        inputs = [
            looked_up.meshes,
            looked_up.fields,
            looked_up.textures,
            wp.array(given, dtype=wp.float32, device="cpu"),
        ]
        wp.launch(self._kernel, len(given) // PACKET, [self._which[name], *inputs, *results], device="cpu")
        exact_one, exact_eight, close_one, close_eight = (each.numpy() for each in results)
        assert exact_one.any() or close_one.any()
        np.testing.assert_array_equal(exact_eight, exact_one)
        np.testing.assert_allclose(close_eight, close_one, rtol=twin.rtol, atol=twin.atol)


def scene_types(*names: str) -> str:
    """The C++ type of shape types and features by their names in flags.py."""
    flags = (GeometryFlag, SceneFlag)
    shapes, features = (sum(int(kind[name]) for name in names if name in kind.__members__) for kind in flags)
    return f"SceneTypes<{shapes}, {features}>"


def columns(*parts: Array) -> Array:
    """The inputs of all places, column after column."""
    return np.concatenate([np.reshape(part, (ROWS, -1)) for part in parts], axis=1)


def units(rng: np.random.Generator, shape: tuple[int, ...] = (ROWS,)) -> Array:
    """Unit vectors, of which some lie along an axis or in a plane of two, and have zeros of both signs."""
    v = rng.normal(size=(*shape, 3))
    v[rng.random(v.shape) < 0.1] = 0.0
    v[rng.random(v.shape) < 0.5] *= -1.0
    v[(v == 0.0).all(axis=-1), 2] = 1.0
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def sizes(rng: np.random.Generator, count: int = 1, least: float = 1e-3, most: float = 1e3) -> Array:
    """Lengths from tiny to huge."""
    return np.exp(rng.uniform(np.log(least), np.log(most), (ROWS, count)))


def rotations(rng: np.random.Generator) -> Array:
    """Rows of rotation matrices; the first packets have the identity."""
    q, _ = np.linalg.qr(rng.normal(size=(ROWS, 3, 3)))
    q[: 4 * PACKET] = np.eye(3)
    return q


def both(inputs: Callable[[np.random.Generator], Array], code: str, setup: str = "", **tolerance: float) -> Twin:
    """A pair whose calls differ in names alone, which stand in double braces: ``{{one|eight}}``."""
    one, eight = code, code
    for pair in set(re.findall(r"\{\{(.*?)\}\}", code)):
        names = pair.split("|")
        one, eight = (text.replace(f"{{{{{pair}}}}}", name) for text, name in zip((one, eight), names, strict=True))
    return Twin(inputs, setup=setup, one=one, eight=eight, **tolerance)


@functools.cache
def tables() -> Tables:
    """A mesh of six faces, one of them without area; a height field of 4 x 5 samples; an image and a cube."""
    rng = np.random.default_rng(1)

    def put(values, dtype):
        return wp.array(values, dtype=dtype, device="cpu")

    meshes = types.Meshes()
    rows = rng.uniform(-1.0, 1.0, (FACES, 3, 4)).astype(np.float32)
    rows[2, :, :3] = rows[2, 0, :3]
    marks = np.stack([rng.permutation(FACES), rng.integers(0, FACES, FACES), rng.integers(0, 2, FACES)], axis=1)
    rows[:, :, 3] = marks.astype(np.int32).view(np.float32)
    meshes.faces = put(rows.reshape(-1, 4), wp.vec4)
    meshes.face_start, meshes.corner_start = put([0], wp.int32), put([0], wp.int32)
    meshes.bounds_min, meshes.bounds_max = put([[-1.0, -1.0, -1.0]], wp.vec3), put([[1.0, 1.0, 1.0]], wp.vec3)
    normals = units(rng, (FACES, 3))
    normals[1] = 0.0
    meshes.normals = put(normals.reshape(-1, 3).astype(np.float32), wp.vec3)
    meshes.uvs = put(rng.uniform(-2.0, 2.0, (3 * FACES, 2)).astype(np.float32), wp.vec2)
    meshes.has_uvs = put([1], wp.int32)
    fields = types.HeightFields()
    fields.size = put([[1.0, 0.5, 1.0, 0.25]], wp.vec4)
    fields.rows, fields.columns, fields.height_start = (put([n], wp.int32) for n in (4, 5, 0))
    fields.heights = put(rng.random(20).astype(np.float32), wp.float32)
    image = rng.integers(0, 256, (12, 20, 3), dtype=np.uint8)
    cube = rng.integers(0, 256, (6, 16, 16, 3), dtype=np.uint8)
    textures = pack_textures([TextureImage("2d", image), TextureImage("cube", cube)], "cpu")
    return Tables(meshes, fields, textures)
