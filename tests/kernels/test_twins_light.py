"""Light at single places and at packets of eight: both give the same; see test_twins.py."""

import numpy as np
import pytest
from twins import PACKET, POSE, ROWS, Family, Twin, both, columns, rotations, scene_types, sizes, units

SERIES = {"rtol": 5e-5, "atol": 5e-5}  # powers by series
HIGHLIGHT = {"rtol": 2e-4, "atol": 1e-4}  # the 128th power of what an inverse root has told, too

# A Gouraud triangle: places 0, 3, 6; normals 9, 12, 15; weights 18; mask of shadows 20. Four lights,
# of 25 numbers each, from 24 on.

LIGHTS = """
    const int flags[] = { AMBIENT, SPOT | FADES | AMBIENT, CASTS | AMBIENT, SPOT | CASTS };
    LightList list {};
    list.count = 4;
    list.dims = 1;
    list.near = 0.01f;
    list.colored = same(21) > 0.0f;
    list.ambient = { 0.25f, 0.25f, 0.25f };
    for (int n = 0; n < list.count; ++n) {
        const int c = 24 + 25 * n;
        const bool spot = flags[n] & SPOT;
        const auto row = [&](int c, float w) { return make_float3_int(same_vec(c), as_int(w)); };
        const Vec3 place = spot ? same_vec(c) : normalized(same_vec(c));
        list.lights[n] = { make_float3_int(place, 1 << n), row(c + 3, same(c + 6)),
                           row(c + 7, same(c + 10)), make_float3_int(same_vec(c + 11), flags[n]), row(c + 14, 2.0f),
                           row(c + 17, same(c + 20)) };
    }
    const ResolvedMaterial material { { 0.75f, 0.5f, 0.25f, -1 }, { 0.125f, same(22), same(23), 0 } };
    Camera camera {};
    for (int k = 0; k < 3; ++k)
        camera.rotation.at[k][k] = 1.0f;
"""


def lit(rng):
    place, normal = units(rng) * sizes(rng, least=1e-1, most=1e2), units(rng, (ROWS, 3))
    weights = rng.dirichlet(np.ones(3), ROWS)[:, :2]
    weights[: 4 * PACKET] = rng.integers(0, 2, (4 * PACKET, 1)) * [1.0, 0.0]
    gloss, exponent = rng.choice([0.0, 0.5, 1.0], ROWS), rng.choice([0.0, 1.0, 7.5, 64.0, 128.0], ROWS)
    parts = [place, place + units(rng), place + units(rng), normal, weights, rng.integers(0, 16, ROWS)]
    parts += [rng.choice([-1.0, 1.0], ROWS), gloss, exponent]
    for _ in range(4):
        cutoff = np.cos(rng.uniform(0.0, 1.5, ROWS))
        cutoff[rng.random(ROWS) < 0.5] = -2.0
        falloff = np.array([0.1, 0.0, 0.0]) + rng.uniform(0.0, 1.0, (ROWS, 3))
        parts += [units(rng) * sizes(rng, least=1e-1, most=1e2), units(rng), cutoff, falloff]
        parts += [rng.choice([0.0, 1.0, 12.5], ROWS), rng.uniform(0.0, 1.0, (ROWS, 9))]
        parts += [rng.choice([0.0, 0.5, 2.0], ROWS), np.zeros((ROWS, 4))]
    return columns(*parts)


GOURAUD = "gouraud; for (int n = 0; n < 3; ++n) { gouraud.place[n] = vec(3 * n); gouraud.normal[n] = vec(9 + 3 * n); }"
WEIGHTS = "gouraud.weight1 = in(18); gouraud.weight2 = in(19);"


def lighting(corners, shadows):
    weights = WEIGHTS if corners == 3 else "gouraud.weight1 = gouraud.weight2 = {};"
    return Twin(
        lit,
        setup=LIGHTS,
        one=f"GouraudTriangle {GOURAUD} {weights} "
        f"const LitColor lit = light_vertices<{corners}, {shadows}>(list, gouraud, material, (int)in(20)); close(lit);",
        eight=f"GouraudTriangle8 {GOURAUD} {weights} Lits lit;"
        f"illuminate_eight<{shadows}, true>(list, gouraud, {corners}, material, to_int(in(20)), lit); close(lit);",
        **HIGHLIGHT,
    )


def seen_aside(corners):
    """Rays that begin where the camera is not."""
    twin = lighting(corners, "true")
    one = twin.one.replace("(int)in(20))", "(int)in(20), same_vec(24))")
    eight = twin.eight.replace(", lit);", ", lit, broadcast(same_vec(24)));")
    return Twin(twin.inputs, setup=twin.setup, one=one, eight=eight, **HIGHLIGHT)


def corner(grey):
    total, many = ("float", "Float8") if grey else ("Vec3", "Vec3x8")
    return Twin(
        lit,
        setup=LIGHTS + "constexpr int STRIDE = 9; float values[SIMD_WIDTH * STRIDE] {};",
        one=f"light_corner<{total}, true, true>(list, vec(0), vec(9), material, 3, values);"
        "for (int n = 0; n < STRIDE; ++n) close(values[n]);",
        eight=f"light_eight_corners<{many}, true>(list, vec(0), vec(9), material, 3, STRIDE, SIMD_WIDTH, values);"
        "for (int n = 0; n < STRIDE; ++n) {"
        "Float8 all; for (int k = 0; k < SIMD_WIDTH; ++k) all[k] = values[k * STRIDE + n]; close(all); }",
        **HIGHLIGHT,
    )


GRID = """
    struct : LitVertexGrid<256, true, true> {} grid {};
    grid.grey = same(4) > 0.0f;
    grid.few = same(5) > 0.0f;
    grid.each = grid.few ? GREY_VERTEX_LIGHTS : 3;
    grid.stride = grid.grey ? grid.each : 9;
    grid.columns = 5;
    grid.rows = 4;
    grid.casting = 2;
    grid.bits[1] = 1;
    grid.bits[2] = 2;
    grid.u = grid.v = cell_axis(cells_between(4.0f * same(6), same(6)));
    for (int n = 0; n < 180; ++n)
        grid.values[n] = 0.125f * (float)(n * 37 % 19);
"""


def grid_places(rng):
    size = sizes(rng, least=0.1, most=10.0)
    shared = np.repeat(size[::PACKET], PACKET, axis=0)
    few = rng.integers(0, 2, ROWS)
    shadow = rng.integers(0, 4, ROWS)
    return columns(
        rng.uniform(-4.0, 4.0, (ROWS, 3)) * shared, shadow, np.maximum(few, rng.integers(0, 2, ROWS)), few, size
    )


LIGHT = Family(
    "shading_pass/shading_pass.h",
    {
        f"{corners} corners, shadows {shadows}": lighting(corners, shadows)
        for corners in (1, 3)
        for shadows in ("false", "true")
    }
    | {f"{corners} corners of rays that begin apart": seen_aside(corners) for corners in (1, 3)}
    | {"corner of a plane": corner(False), "grey corner of a plane": corner(True)}
    | {
        "own shadow": Twin(
            lit,
            setup=LIGHTS,
            one="exact(own_shadow(list, camera, vec(0), vec(9)));",
            eight="exact(own_shadow(list, camera, vec(0), vec(9)));",
        ),
        "light from corners": Twin(
            grid_places,
            setup=GRID,
            one="const GridInterpolation on = on_corners(grid, vec(0), true); exact(on.inside);"
            "if (on.inside) { close(light_from_corners(grid, on, (int)in(3))); }",
            eight="const OnCornersOfEight on = on_corners(grid, vec(0)); exact(on.inside);"
            "close(select(on.inside, light_from_corners(grid, on, to_int(in(3))), broadcast({ 0.0f, 0.0f, 0.0f })));",
            rtol=1e-5,
            atol=1e-5,
        ),
    },
)


# Surfaces under area lights: place 0; normal 3; direction to the eye 6; of a pose rotation 9, centre of projection 18,
# size 21; ray 24; color 27; mask of shadows 30; of a material 31; of three area lights, 23 numbers each, from 40 on.

LAMPS = """
    AreaLights list {};
    list.count = 3;
    list.sky.uneven = 1;
    list.sky.gain = { 0.5f, 1.0f, 2.0f };
    for (int n = 0; n < SKY_TERMS; ++n)
        list.sky.terms[n] = (n == 0 ? 1.0f : 0.2f) * same_vec(40 + 5 * n);
    for (int n = 0; n < list.count; ++n) {
        const int c = 40 + 23 * n;
        const auto row = [&](int c, float w) { return make_float3_int(same_vec(c), as_int(w)); };
        AreaLight& area_light = list.area_lights[n];
        area_light.place = make_float3_int(n == 2 ? normalized(same_vec(c)) : same_vec(c), 1 << n);
        area_light.axis = row(c + 3, same(c + 6));
        area_light.across = make_float3_int(normalized(cross(same_vec(c + 3), { 0.3f, 0.5f, 0.7f })), FORM);
        area_light.size = make_float3_int(same_vec(c + 7), 0);
        area_light.falloff = row(c + 10, same(c + 13));
        area_light.diffuse = make_float3_int(same_vec(c + 14), n == 2 ? AMBIENT : SPOT);
        area_light.specular = make_float3_int(same_vec(c + 17), 0);
        area_light.ambient = make_float3_int(same_vec(c + 20), 0);
    }
    Camera camera {};
    for (int k = 0; k < 3; ++k)
        camera.rotation.at[k][(k + 1) % 3] = 1.0f;
    camera.scale_x = camera.scale_y = 0.01f;
    struct {
        int skybox;
    } background { 1 };
"""
MATERIAL = """
    ShapeAppearance<KINDS, ShadingNeeds<RGB, HAS_MATERIALS | HAS_TEXTURES | HAS_MAPS | PHYSICAL>> look {};
    look.pose = pose;
    look.material = { make_float3_int(same_vec(31), -1), { same(34), same(35), 0.04f, 0 },
                    make_float3_int(same_vec(36), 0), 0 };
    look.layout.extent = pose.size;
    look.layout.repeat[0] = 2.0f;
    look.layout.repeat[1] = 3.0f;
    look.layout.own = 1;
    struct {
        decltype((meshes)) meshes;
        decltype((textures)) textures;
        decltype((background)) background;
    } scene { meshes, textures, background };
"""


def lamplit(rng):
    eye = units(rng)
    normal = units(rng) + 1.2 * eye
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[: ROWS // 8] *= -1.0
    size = sizes(rng, 3, 0.5, 2.0)
    parts = [eye * -sizes(rng, least=0.1, most=1e2), normal, eye, rotations(rng), units(rng), size, -eye]
    parts += [rng.random((ROWS, 3)), rng.integers(0, 8, ROWS), rng.random((ROWS, 3)), rng.random(ROWS)]
    parts += [rng.choice([0.0, 0.5, 1.0], ROWS), rng.random((ROWS, 3)), np.zeros(ROWS)]
    for _ in range(3):
        cutoff = np.cos(rng.uniform(0.5, 3.0, ROWS))
        cutoff[rng.random(ROWS) < 0.5] = -2.0
        parts += [units(rng) * sizes(rng, least=1.0, most=1e2), units(rng), cutoff, sizes(rng, 3, 1e-2, 1e1)]
        parts += [rng.uniform(0.1, 1.0, (ROWS, 3)), rng.choice([0.0, 1.0, 3.5], ROWS), rng.random((ROWS, 9))]
    return columns(*parts)


def sample_of(form):
    return Twin(
        lamplit,
        setup=LAMPS.replace("FORM", form),
        one="const auto sample = sample_light(list.area_lights[0], vec(0)); const bool some = sample.share > 1.0e-2f;"
        "close(sample.share); close(some ? sample.sine_squared : 0.0f);"
        "close(some ? sample.to_light : Vec3 { 0.0f, 0.0f, 0.0f });",
        eight="const auto sample = sample_light(list.area_lights[0], vec(0)); const Int8 some = sample.share > 1.0e-2f;"
        "close(sample.share); close(some ? sample.sine_squared : (Float8)0.0f);"
        "close(select(some, sample.to_light, broadcast({ 0.0f, 0.0f, 0.0f })));",
        **SERIES,
    )


REACHED = (
    "Visibility<FLAGS, {0}> reached {{}};"
    "const auto hide = [](auto& found, auto shadow) {{ if constexpr (sizeof(found) > 1) found = shadow; }};"
    "hide(reached.shadow, {1});"
)


def whole(form, flags, tolerance=5e-4):
    """All of a pixel's physically based light."""
    kind = "BOX"
    head = f"using KINDS = {scene_types(kind)}; constexpr int FLAGS = {flags};"
    return Twin(
        lamplit,
        setup=head + POSE.replace("TYPE", kind) + LAMPS.replace("FORM", form) + MATERIAL,
        one=REACHED.format("Vec3", "(int)in(30)")
        + "const SurfaceInteraction surface = surface_at<KINDS>(pose, meshes, fields, 0, vec(0), vec(24));"
        "close(shade_physically<KINDS, PINHOLE, FLAGS>(look, list, scene, camera, 0.0f, 0.0f, surface, vec(0), vec(24),"
        "1.0f, vec(27), reached));",
        eight=REACHED.format("Vec3x8", "to_int(in(30))") + "int faces[SIMD_WIDTH] {}; SurfaceInteraction8 surface;"
        "surface.local = vec(0);"
        "find_surface<KINDS>(pose, meshes, fields, faces, vec(24), surface);"
        "const auto steps = [&](Vec3x8& right, Vec3x8& down) {"
        "    right = broadcast(pose.local(step_right<PINHOLE>(camera, 0.0f, 0.0f, 1.0f)));"
        "    down = broadcast(pose.local(step_down<PINHOLE>(camera, 0.0f, 0.0f, 1.0f)));"
        "};"
        "Vec3x8 light; shade_eight_physically<KINDS, FLAGS>(look, list, scene, camera.rotation, steps, surface, vec(0),"
        "-normalized(vec(0)), vec(24), vec(27), reached, light); close(light);",
        rtol=tolerance,
        atol=tolerance,
    )


FORMS = ("POINT", "SPHERE", "DISK", "RECTANGLE", "CYLINDER")
BSDF = "const auto bsdf = make_bsdf(vec(27), in(34), in(35), same(36));"
PHYSICAL = Family(
    "shading_pass/shading_pass.h",
    {f"light of a {form.lower()}": sample_of(f"FORM_{form}") for form in FORMS}
    | {f"{form.lower()}s on a box": whole(f"FORM_{form}", "0") for form in FORMS}
    | {
        "with shadows": whole("FORM_SPHERE", "HAS_SHADOWS"),
        "with maps": whole("FORM_SPHERE", "HAS_MAPS", 1e-2),  # small highlights, by normals from an image
        "with a sky": whole("FORM_SPHERE", "HAS_SKYBOX | HAS_SHADOWS"),
        "display colors": both(lamplit, "close(srgb_to_linear(vec(27))); close(linear_to_srgb(vec(36)));", **SERIES),
        "bsdf": both(
            lamplit,
            BSDF
            + "exact(bsdf.matt); exact(bsdf.straight); exact(bsdf.grazing); exact(bsdf.roughness); close(bsdf.square);",
            rtol=1e-6,
        ),
        "microfacets": both(
            lamplit,
            "exact(ggx_ndf(vec(3), vec(6), in(34))); exact(smith_visibility(in(34), in(35), in(36)));",
        ),
        "reflection of a light": both(
            lamplit,
            BSDF + "close(reflection_of(bsdf, vec(3), vec(9), vec(6), in(37), in(38)));",
            rtol=1e-4,
            atol=1e-5,
        ),
        "reflection of all around": both(
            lamplit, BSDF + "close(environment_brdf(bsdf, in(37), vec(27), vec(31)));", **SERIES
        ),
        "cosine over a light": both(lamplit, "close(clipped_cosine(in(3), in(34) * in(34)));", **SERIES),
        "sky": both(
            lamplit,
            "exact(irradiance_sh(list.sky, vec(3), in(34), in(35)));"
            "exact(sky_along<false>(list.sky, textures, background, vec(3), in(34)));"
            "close(sky_along<true>(list.sky, textures, background, vec(3), in(34)));",
            setup=LAMPS.replace("FORM", "FORM_POINT"),
            rtol=2e-3,
            atol=1e-3,
        ),
    },
)


@pytest.mark.parametrize("name", LIGHT.twins)
def test_light(name):
    LIGHT.check(name)


@pytest.mark.parametrize("name", PHYSICAL.twins)
def test_physically_based_light(name):
    PHYSICAL.check(name)
