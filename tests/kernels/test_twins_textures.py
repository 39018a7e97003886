"""Textures at single places and at packets of eight: both give the same; see test_twins.py."""

import numpy as np
import pytest
from twins import POSE, ROWS, Family, Twin, both, columns, rotations, scene_types, sizes, units

# Textures: place in the shape's frame 0, ray 3, face 6, pose 9, steps to the next pixels 24 and 27.

LAYOUT = """
    TextureLayout layout {};
    layout.extent = { same(21), same(22), same(23), METRES };
    layout.repeat[0] = 2.0f;
    layout.repeat[1] = 3.0f;
    layout.start[0] = 0.25f;
    layout.start[1] = 0.5f;
    layout.own = OWN;
    const Image image = load_image(textures, IMAGE), cube = load_image(textures, 1);
    const unsigned* const texels = textures.texels.data;
"""


def textured(rng):
    reach = sizes(rng, least=1e-4, most=1.0)
    local = rng.uniform(-1.0, 1.0, (ROWS, 3))
    local[:128] = np.round(local[:128])
    parts = [local, units(rng), rng.integers(0, 6, ROWS), np.zeros((ROWS, 2)), rotations(rng), units(rng)]
    parts += [sizes(rng, 3, 0.1, 10.0), units(rng) * reach, units(rng) * reach]
    return columns(*parts)


def footprint(kinds, own=0):
    shape = kinds[0]
    head = f"using KINDS = {scene_types(*kinds)};"
    pose = POSE.replace("same_vec(21), TYPE", "MESH_SIZE, TYPE") if shape == "MESH" else POSE
    pose = pose.replace("MESH_SIZE", "{ 0.0f, 0.0f, 0.0f }").replace("TYPE", shape)
    step = "exact" if shape == "PLANE" else "close"
    results = f"{step}(at.u); {step}(at.v);"
    return Twin(
        textured,
        setup=head + pose + LAYOUT.replace("METRES", "0").replace("OWN", str(own)).replace("IMAGE", "0"),
        one="const SurfaceInteraction surface = surface_at<KINDS>(pose, meshes, fields, (int)in(6), vec(0), vec(3));"
        "const Footprint at = footprint_2d<KINDS>(pose, layout, meshes, surface, vec(3), vec(24), vec(27));"
        f"{results} close(at.right.x); close(at.right.y); close(at.down.x); close(at.down.y);",
        eight="int faces[SIMD_WIDTH]; for (int k = 0; k < SIMD_WIDTH; ++k) faces[k] = (int)number(k, 6);"
        "SurfaceInteraction8 surface; surface.local = vec(0);"
        "find_surface<KINDS>(pose, meshes, fields, faces, vec(3), surface);"
        "Footprints at; footprints_2d<KINDS>(pose, layout, meshes, surface, vec(3), vec(24), vec(27), at);"
        f"{results} close(at.right_u); close(at.right_v); close(at.down_u); close(at.down_v);",
        rtol=3e-4,  # near a pole an angle has few digits
        atol=1e-5,
    )


def direction(shape, metres):
    kinds = scene_types(shape)
    return Twin(
        textured,
        setup=POSE.replace("TYPE", shape) + LAYOUT.replace("METRES", metres).replace("OWN", "0").replace("IMAGE", "1"),
        one=f"const SurfaceInteraction surface = surface_at<{kinds}>(pose, meshes, fields, 0, vec(0), vec(3));"
        f"const CubeMapping at = map_cube<{kinds}>(pose, layout, surface); exact(at.direction); exact(at.scale);",
        eight=f"int faces[SIMD_WIDTH] {{}}; SurfaceInteraction8 surface;"
        f"surface.local = vec(0);"
        f"find_surface<{kinds}>(pose, meshes, fields, faces, vec(3), surface);"
        f"Vec3x8 scale; exact(cube_directions<{kinds}>(pose, layout, surface, scale)); exact(scale);",
    )


FLAT = LAYOUT.replace("METRES", "0").replace("OWN", "0").replace("IMAGE", "0")
TEXTURES = Family(
    "shading_pass/shading_pass.h",
    {
        "footprint on a plane": footprint(("PLANE",)),
        "footprint on a box": footprint(("BOX",)),
        "footprint on a sphere": footprint(("SPHERE",)),
        "footprint on a projected box": footprint(("BOX", "PROJECTED")),
        "footprint on a height field": footprint(("HEIGHT_FIELD",)),
        "footprint on a mesh": footprint(("MESH",), own=1),
        "footprint on a mesh from above": footprint(("MESH",)),
    }
    | {
        f"cube around a {shape.lower()}, metres {metres}": direction(shape, metres)
        for shape in ("SPHERE", "CAPSULE", "BOX", "PLANE")
        for metres in ("0", "1")
    }
    | {
        "steps on surfaces": both(textured, "exact(slide(vec(24), vec(3), vec(12)));"),
        "faces of a cube": both(
            textured,
            "const auto face = {{cube_face|cube_faces}}(vec(0)); exact(face);"
            "exact({{to_face|to_faces}}(face, vec(3))); exact({{from_face|from_faces}}(face, vec(3)));",
        ),
        "texels of a cube": both(
            textured,
            "exact({{cube_texel|cube_texels}}({{9|(Int8)9}}, {{16|(Int8)16}}, {{(int)|to_int}}(in(6)),"
            "{{(int)|to_int}}(8.0f + 8.5f * in(0)), {{(int)|to_int}}(8.0f + 8.5f * in(1))));",
        ),
        "level of detail": both(
            textured,
            "close({{level_of_detail|levels_of_detail}}(1e3f * in(21), 1e2f * in(22), 6));",
            rtol=1e-6,
            atol=2e-6,
        ),
        "image": Twin(
            textured,
            setup=FLAT,
            one="close(sample_2d(texels, image, in(0), in(1), Float2 { in(24), in(25) }, Float2 { in(27), in(28) }));",
            eight="close(sample_2d(texels, Levels(image, 1),"
            "Footprints { in(0), in(1), in(24), in(25), in(27), in(28) }));",
            atol=2e-4,  # weights are rounded to 16 bits in the one, and not in the other
        ),
        "cube": Twin(
            textured,
            setup=FLAT,
            one="close(sample_cube(texels, cube, vec(0), vec(24), vec(27)));",
            eight="Vec3x8 color; sample_cubes(texels, Levels(cube, 6), vec(0), vec(24), vec(27), color); close(color);",
            atol=2e-4,
        ),
    },
)


@pytest.mark.parametrize("name", TEXTURES.twins)
def test_textures(name):
    TEXTURES.check(name)
