"""Formulas that exist for single places and for packets of eight: both give the same.

Where both are one sequence of operations, results are equal bit for bit. They differ on a CPU where a packet divides by
a length with an estimate and one of Newton's steps (inverse_root), or takes powers, logarithms and arc tangents by
series of its own.
"""

import numpy as np
import pytest
from twins import FACES, PACKET, POSE, ROWS, Family, Twin, columns, rotations, scene_types, sizes, units

UNIT = {"rtol": 2e-6, "atol": 1e-6}  # one inverse root, or a few
SUM = {"rtol": 5e-6, "atol": 3e-6}  # of unit vectors, which may nearly cancel each other
TYPES = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "CONE", "BARREL", "PLANE")

# Rays into shapes: origin 0, direction 3, size 6.


def rays(rng):
    """Rays into unit shapes: from near, far and inside, along axes and faces, past edges; of tiny and huge length."""
    target = rng.uniform(-1.2, 1.2, (ROWS, 3))
    away = units(rng) * sizes(rng, least=1e-2, most=1e6)
    origin = target + away
    direction = -away * sizes(rng, least=1e-6, most=1e6)
    origin[:256] = np.round(origin[:256])  # on faces, edges and corners
    origin[256:320], direction[256:320] = (-3.0, 1.0, 0.0), (1.0, 0.0, 0.0)  # touching the side
    origin[256:320] += 1e-6 * rng.integers(-2, 3, (64, 1))
    origin[320:384] *= 0.0
    direction[384:448] *= 1e-18
    size = sizes(rng, 2, 1e-3, 1e3)
    size[:, 1] += size[:, 0]
    size[:400] *= rng.integers(0, 2, (400, 1))
    return columns(origin, direction, size)


def entry(kind):
    return Twin(
        rays,
        setup="const Float3Int size { same(6), same(7), 0.0f, 0 };",
        one=f"exact({kind.title()}Traits::intersect(size, vec(0), vec(3)));",
        eight=f"exact({kind.title()}Traits::intersect(size, vec(0), vec(3)));",
    )


def map_places(rng):
    """Place 0; of the map position 3, direction 6, across 9, size 12."""
    across = np.cross(direction := units(rng), units(rng))
    place = units(rng) * sizes(rng, least=1e-4, most=1e4)
    size = np.concatenate([sizes(rng), sizes(rng, least=1e-3, most=1.0), rng.random((ROWS, 1))], axis=1)
    size[:64, 0] = 0.0
    source, edge = units(rng), slice(ROWS // 2, None)  # places on the edges of maps
    source[edge], direction[edge], across[edge], size[edge, 0] = 0.0, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), 1.0
    place[edge] = rng.choice([-1.0, -0.9999, 0.0, 0.9999, 1.0, 1.0001], (ROWS // 2, 3)) * [1.0, 1.0, 2.0]
    return columns(place, source, direction, across, size)


def map_place(distant):
    found = f"float along; exact(has_place(map, {distant}, vec(0), along)); exact(along);"
    return Twin(
        map_places,
        setup="const MapSize size { same(12), same(13), same(14) };"
        "const ShadowMap map = shadow_map(same_vec(3), same_vec(6), same_vec(9), size);",
        one=found,
        eight=found.replace("float", "Float8"),
    )


RAYS = Family("geometry/intersect.h", {f"intersect {kind}": entry(kind) for kind in TYPES})
MAPS = Family("lights/shadow_extent.h", {"of a spot": map_place("false"), "of a distant light": map_place("true")})

# Hits: place in the shape's frame 0, ray 3, face 6; of a pose rotation 9, centre of projection 18, size 21.

MESH_POSE = """
    const ShapeFromCamera pose { row(9, same(18)), row(12, same(19)), row(15, same(20)),
                      make_float3_int({ as_float(0), as_float(0), 0.0f }, TYPE + 16) };
"""
SURFACE = """
    int faces[SIMD_WIDTH];
    for (int k = 0; k < SIMD_WIDTH; ++k)
        faces[k] = (int)number(k, 6);
"""
EIGHT = (
    SURFACE + "SurfaceInteraction8 surface; surface.local = vec(0);"
    "find_surface<KINDS>(pose, meshes, fields, faces, vec(3), surface);"
)
ONE = "const SurfaceInteraction surface = surface_at<KINDS>(pose, meshes, fields, (int)in(6), vec(0), vec(3));"
NORMAL = "close(surface.normal); exact(surface.part);"
WEIGHTS = "exact(surface.weight1); exact(surface.weight2);"
EDGES = "exact(surface.triangle.origin); exact(surface.triangle.edge1); exact(surface.triangle.edge2);"
ON_TOP = "exact(surface.part == 1 ? surface.weight1 : 0.0f); exact(surface.part == 1 ? surface.weight2 : 0.0f);"
CORNERS = "exact(surface.corner); exact(surface.flat); "


def hits(rng):
    """Hits on, in and near shapes of all sizes, among them corners, edges, axes and centres."""
    size = sizes(rng, 3)
    size[:PACKET] = 1.0
    shared = np.repeat(size[::PACKET], PACKET, axis=0)
    local = rng.uniform(-1.1, 1.1, (ROWS, 3)) * shared
    on = rng.random((ROWS, 3)) < 0.4
    local[on] = (shared * rng.choice([-1.0, 0.0, 1.0], (ROWS, 3)))[on]
    face = rng.integers(0, FACES, ROWS)
    return columns(local, units(rng), face, 0 * local[:, :2], rotations(rng), local + units(rng), size)


def with_kinds(text, shape, kinds):
    return text.replace("KINDS", scene_types(shape, *kinds)).replace("TYPE", shape)


def surface(shape, *kinds, results=NORMAL, inputs=hits):
    setup = POSE if shape != "MESH" or "PER_SHAPE_SCALE" in kinds else POSE.splitlines()[1] + MESH_POSE
    return Twin(
        inputs,
        setup=with_kinds(setup, shape, kinds),
        one=with_kinds(ONE + results, shape, kinds),
        eight=with_kinds(EIGHT + results, shape, kinds),
        **UNIT,
    )


def ground(rng):
    """Hits on a height field of 2 x 1 m; faces beyond its triangles are its sides and its base."""
    hit = hits(rng)
    hit[:, :3] = rng.uniform([-1.0, -0.5, -0.3], [1.0, 0.5, 1.0], (ROWS, 3))
    hit[:, 6] = rng.integers(-2, 2 * 3 * 4 + 3, ROWS)
    return hit


SMOOTH = """
    const float repeat[] = { 0.0f, 2.0f };
    struct { ShapeFromCamera pose; PlaneGrid cells; } look { pose, plane_cells(pose, repeat, 3.0f) };
"""
FACET_ONE = """
    GouraudTriangle gouraud;
    gouraud_at<KINDS>(look, meshes, surface, vec(24), gouraud);
    close(smooth_normal<KINDS>(pose, meshes, surface));
"""
FACET_EIGHT = """
    GouraudTriangle8 gouraud;
    gouraud_at<KINDS>(look, meshes, surface, vec(24), gouraud);
    close(smooth_normal<KINDS>(pose, meshes, surface));
"""
FACET = """
    exact(gouraud.weight1);
    exact(gouraud.weight2);
    for (int n = 0; n < 3; ++n) {
        exact(gouraud.place[n]);
        close(gouraud.normal[n]);
    }
"""


def gouraud(shape, *kinds, inputs=hits):
    mesh = shape == "MESH" and "PER_SHAPE_SCALE" not in kinds
    setup = (POSE.splitlines()[1] + MESH_POSE if mesh else POSE) + SMOOTH
    return Twin(
        lambda rng: columns(inputs(rng), units(rng) * sizes(rng)),
        setup=with_kinds(setup, shape, kinds),
        one=with_kinds(ONE + FACET_ONE + FACET, shape, kinds),
        eight=with_kinds(EIGHT + FACET_EIGHT + FACET, shape, kinds),
        **SUM,
    )


MESHES = {
    "mesh": ("MESH",),
    "mesh with backs": ("MESH", "TWO_SIDED"),
    "scaled mesh": ("MESH", "PER_SHAPE_SCALE"),
    "scaled mesh whose normals are scaled last": ("MESH", "PER_SHAPE_SCALE", "LIT_NORMALS"),
}
SURFACES = Family(
    "shading_pass/shading_pass.h",
    {f"surface of {kind}": surface(kind) for kind in TYPES if kind != "PLANE"}
    | {
        f"surface of {name}": surface(*kinds, results=CORNERS + EDGES + WEIGHTS + NORMAL)
        for name, kinds in MESHES.items()
    }
    | {
        "surface of height field": surface("HEIGHT_FIELD", results=NORMAL + ON_TOP, inputs=ground),
        "surface of scaled height field": surface("HEIGHT_FIELD", "PER_SHAPE_SCALE", inputs=ground),
    }
    | {f"Gouraud triangle of {kind}": gouraud(kind) for kind in ("SPHERE", "BOX", "PLANE")}
    | {f"Gouraud triangle of {name}": gouraud(*kinds) for name, kinds in MESHES.items()}
    | {
        "Gouraud triangle of height field": gouraud("HEIGHT_FIELD", inputs=ground),
        "directions": Twin(
            hits,
            setup=POSE.replace("TYPE", "BOX"),
            one="exact(pose.local(vec(3))); exact(pose.seen(vec(3)));",
            eight="exact(pose.local(vec(3))); exact(pose.seen(vec(3)));",
        ),
    },
)


@pytest.mark.parametrize("name", RAYS.twins)
def test_rays(name):
    RAYS.check(name)


@pytest.mark.parametrize("name", MAPS.twins)
def test_shadow_maps(name):
    MAPS.check(name)


@pytest.mark.parametrize("name", SURFACES.twins)
def test_surfaces(name):
    SURFACES.check(name)
