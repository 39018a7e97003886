"""Shadows on a floor, against rays that MuJoCo casts from the floor back to the light."""

import mujoco
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc

CASTERS = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "hfield")
LIGHTS = {
    "directional": '<light type="directional" pos="0 0 5" dir="0.3 0.2 -1" ambient="0 0 0" diffuse="1 1 1"/>',
    "spot": '<light type="spot" pos="0.6 -0.4 5" dir="-0.1 0.1 -1" cutoff="60" ambient="0 0 0" diffuse="1 1 1"/>',
    # all around: most of the floor is beside or behind the light's direction
    "sideways": '<light type="spot" pos="0.6 -0.4 3" dir="1 0 0.1" cutoff="180" ambient="0 0 0" diffuse="1 1 1"/>',
    "upwards": '<light type="spot" pos="0.6 -0.4 3" dir="0 0 1" cutoff="180" ambient="0 0 0" diffuse="1 1 1"/>',
}
DARK = '<visual><headlight active="0"/></visual>'
SHEET = "-0.5 -0.5 0  0.5 -0.5 0  0.5 0.5 0  -0.5 0.5 0  0 0 0.01"
AWAY = "".join(scenes.geom_xml(kind, f"away {kind}", 'pos="0 -90 0"') for kind in CASTERS)  # so that kernels are shared
FLOOR = '<geom name="floor" type="plane" size="9 9 1"/>'
EYE = {"width": 64, "height": 64, "position": (0.0, -3.0, 3.0), "rotation": scenes.looking((0, -3, 3), (0, 0, 0))}


def check(mjm: mujoco.MjModel) -> None:
    """The floor is black just where a ray to the light meets a caster; pixels on a shadow's edge may differ."""
    mjm.vis.map.shadowclip = 0.0  # as far as light goes
    mjd = scenes.forward(mjm)
    scene = wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1, mjd=mjd))
    camera = scenes.own_camera(outputs=("hdr", "points", "segmentation"), shadows=True, **EYE)
    images = scenes.look(scene, camera)
    floor = images["segmentation"][0].squeeze() == mjm.geom("floor").id
    points = images["points"][0][floor].astype(np.float64)
    dark = images["hdr"][0][floor].max(axis=-1) == 0.0
    distant = mjm.light_type[0] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    wanted, geom = np.zeros(len(points), bool), np.zeros(1, np.int32)
    for i, point in enumerate(points):
        to_light = -mjd.light_xdir[0] if distant else mjd.light_xpos[0] - point
        reach = np.inf if distant else np.linalg.norm(to_light)
        direction = to_light / np.linalg.norm(to_light)
        hit = mujoco.mj_ray(mjm, mjd, point + 1e-4 * direction, direction, None, 1, -1, geom)
        wanted[i] = 0.0 <= hit < reach
    assert wanted.sum() > 20
    assert (dark != wanted).sum() <= 2


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("kind", CASTERS)
def test_each_type_casts(device: wp.Device, kind: str, light: str) -> None:
    body = f'<body pos="0 0 1" euler="20 10 30">{scenes.geom_xml(kind)}</body>'
    check(scenes.compile_xml(LIGHTS[light] + FLOOR + body, assets=scenes.ASSETS, more=DARK))


@pytest.mark.parametrize("light", LIGHTS)
def test_more_casters_than_one_pass_lists(device: wp.Device, light: str) -> None:
    balls = "".join(
        f'<geom size="0.04" pos="{0.12 * (i % 20) - 1.2} {0.12 * (i // 20) - 1.0} {0.4 + 0.01 * (i % 7)}"/>'
        for i in range(300)
    )
    check(scenes.compile_xml(LIGHTS[light] + balls + FLOOR, more=DARK))


@pytest.mark.parametrize("count", [3, 300])
def test_lights_add_up(device: wp.Device, count: int) -> None:
    """Light of several lights is the sum of each one's light, on all shapes."""
    casters = "".join(
        f'<body pos="{0.8 * i - 2.4} {0.3 * i - 1.0} 1" euler="20 {10 * i} 30">{scenes.geom_xml(kind)}</body>'
        for i, kind in enumerate(CASTERS)
    )
    balls = "".join(
        f'<geom size="0.04" pos="{0.12 * (i % 20) - 1.2} {0.12 * (i // 20) - 1.0} 2"/>' for i in range(count)
    )
    mjm = scenes.compile_xml("".join(LIGHTS.values()) + FLOOR + casters + balls, assets=scenes.ASSETS, more=DARK)
    camera = scenes.own_camera(outputs=("hdr",), shadows=True, **EYE)

    def lit_by(active: list[bool]) -> np.ndarray:
        mjm.light_active[:] = active
        return scenes.look(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1)), camera)["hdr"][0]

    number = mjm.nlight
    alone = [lit_by([light == one for light in range(number)]) for one in range(number)]
    np.testing.assert_allclose(lit_by([True] * number), np.sum(alone, axis=0), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("kind", [kind for kind in CASTERS if kind != "hfield"])
@pytest.mark.parametrize("light", ["directional", "spot"])
def test_what_lies_in_its_own_shadow_loses_the_ambient_part(device: wp.Device, kind: str, light: str) -> None:
    """In the map of the renderer a shape's dark side lies behind its lit one. Without shadows nothing is lost."""
    white = scenes.geom_xml(kind, more='rgba="1 1 1 1"')
    lamp = LIGHTS[light].replace('ambient="0 0 0"', 'ambient="0.25 0.25 0.25"')
    mjm = scenes.compile_xml(f'{lamp}<body pos="0 0 1">{white}</body>{AWAY}', assets=scenes.ASSETS, more=DARK)
    below = {**EYE, "position": (0.0, -0.2, -1.0), "rotation": scenes.looking((0, -0.2, -1), (0, -0.1, 1))}
    for shadows in (True, False):
        camera = scenes.own_camera(outputs=("hdr", "segmentation", "normals"), shadows=shadows, **below)
        images = scenes.look(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1)), camera)
        dark = (images["segmentation"][0] == mjm.geom(kind).id) & (images["normals"][0][..., 2] < -0.6)
        assert dark.sum() > 100
        light_left = images["hdr"][0][dark]
        assert (light_left == 0.0).all() if shadows else (light_left > 0.1).all()


def test_glass_keeps_the_ambient_part(device: wp.Device) -> None:
    """Glass casts shadows and receives none, not even its own."""
    lamp = LIGHTS["directional"].replace('ambient="0 0 0"', 'ambient="0.25 0.25 0.25"')
    mjm = scenes.compile_xml(lamp + '<geom type="box" size=".5 .5 .5" pos="0 0 1" rgba="1 1 1 .5"/>', more=DARK)
    below = {**EYE, "position": (0.0, -0.2, -1.0), "rotation": scenes.looking((0, -0.2, -1), (0, -0.1, 1))}
    plain, shaded = (
        scenes.look(
            wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1)),
            scenes.own_camera(outputs=("hdr",), shadows=shadows, **below),
        )["hdr"][0]
        for shadows in (False, True)
    )
    np.testing.assert_allclose(shaded, plain, atol=1e-6)
    assert plain[32, 32].min() > 0.15


@pytest.mark.parametrize("light", ["directional", "spot"])
@pytest.mark.parametrize("faces", ["0 1 4 1 2 4 2 3 4 3 0 4", "1 0 4 2 1 4 3 2 4 0 3 4"], ids=["up", "down"])
def test_an_open_mesh_casts_whichever_side_is_lit(device: wp.Device, faces: str, light: str) -> None:
    """The renderer draws both sides of a face into the maps of its lights. The sheet is flat but for its middle."""
    sheet = f'<mesh name="sheet" inertia="shell" vertex="{SHEET}" face="{faces}"/>'
    mjm = scenes.compile_xml(
        LIGHTS[light] + FLOOR + '<geom type="mesh" mesh="sheet" pos="0 0 1"/>', assets=sheet, more=DARK
    )
    camera = scenes.own_camera(outputs=("hdr", "points", "segmentation"), shadows=True, **EYE)
    images = scenes.look(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1)), camera)
    floor = images["segmentation"][0] == 0
    points = images["points"][0][floor].astype(np.float64)
    to_light = -np.array((0.3, 0.2, -1.0)) if light == "directional" else np.array((0.6, -0.4, 5.0)) - points
    crossed = points + to_light / to_light[..., 2:]  # at the sheet's height
    inside = 0.5 - np.abs(crossed[:, :2]).max(axis=1)  # how far within its rim [m]
    dark = images["hdr"][0][floor].max(axis=-1) == 0.0
    assert (inside > 0.02).sum() > 40
    assert dark[inside > 0.02].all() and not dark[inside < -0.02].any()


@pytest.mark.parametrize("headlight", [False, True])
def test_lights_cast_that_give_light(device: wp.Device, headlight: bool) -> None:
    """The first eight lights that are on count, the headlight included, with the shadows of these."""
    balls = "".join(f'<geom size="0.2" pos="{0.7 * i - 1.4} {0.4 * i - 1.0} 0.6"/>' for i in range(5))
    on = [1, 4, 5, 9, 12, 13, 20, 33, 36, 39]

    def drawn(lights: list[int]) -> np.ndarray:
        xml = "".join(
            f'<light type="directional" pos="0 0 5" dir="{0.05 * i - 1} {0.4 - 0.02 * i} -1" diffuse="0.1 0.1 0.1" '
            f'active="{"true" if i in on else "false"}"/>'
            for i in lights
        )
        mjm = scenes.compile_xml(xml + FLOOR + balls, more="" if headlight else DARK)
        camera = scenes.own_camera(outputs=("hdr",), shadows=True, **EYE)
        return scenes.look(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1)), camera)["hdr"][0]

    kept = on[: 7 if headlight else 8]
    np.testing.assert_array_equal(drawn(list(range(40))), drawn(kept))
    assert (drawn(kept) != drawn(kept[:-1])).any()


@pytest.mark.parametrize("light", LIGHTS)
def test_turned_away_surfaces_keep_their_colors(device: wp.Device, light: str) -> None:
    """Alone in its world a convex shape looks the same with and without shadows: it has none on its lit side."""
    kinds = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
    bodies = "".join(f'<body pos="0 0 1" euler="20 10 30">{scenes.geom_xml(kind)}</body>' for kind in kinds)
    mjm = scenes.compile_xml(LIGHTS[light] + bodies, assets=scenes.ASSETS, more=DARK)
    m, d = scenes.put(mjm, len(kinds))
    positions = d.geom_xpos.numpy()
    positions[~np.eye(len(kinds), dtype=bool)] = (1e4, 1e4, 1.0)
    d.geom_xpos.assign(positions)
    scene = wc.from_mujoco_warp(mjm, m, d)
    with_shadows, without = (
        scenes.look(scene, scenes.own_camera(outputs=("hdr",), shadows=shadows, **EYE))["hdr"]
        for shadows in (True, False)
    )
    assert (without.max(axis=(1, 2, 3)) > 0.0).all()
    assert len({image.tobytes() for image in without}) == len(kinds)
    np.testing.assert_allclose(with_shadows, without, rtol=1e-5, atol=1e-6)


MAPPED = {
    # light, and which of the boxes at x = -2, 0, 2 cast a shadow onto the floor beneath them
    "all": ('type="directional" pos="0 0 5" dir="0 0 -1"', 4.0, (True, True, True)),
    "narrow": ('type="directional" pos="0 0 5" dir="0 0 -1"', 1.0, (False, True, False)),
    "aside": ('type="directional" pos="2 0 5" dir="0 0 -1"', 1.0, (False, False, True)),
    "below": ('type="directional" pos="0 0 0.9" dir="0 0 -1"', 4.0, (False, False, False)),
    "endless": ('type="directional" pos="0 0 0.9" dir="0 0 -1"', 0.0, (True, True, True)),
    "spot": ('type="spot" pos="0 0 5" dir="0 0 -1" cutoff="60" exponent="0"', 1.0, (True, True, True)),
    "narrow spot": ('type="spot" pos="0 0 5" dir="0 0 -1" cutoff="40" exponent="0"', 1.0, (False, True, False)),
}


@pytest.mark.parametrize("name", MAPPED)
def test_shadows_end_where_the_renderers_maps_end(device: wp.Device, name: str) -> None:
    light, clip, wanted = MAPPED[name]
    boxes = "".join(f'<geom type="box" size="0.3 0.3 0.02" pos="{x} 0 1"/>' for x in (-2, 0, 2))
    dim = f'<light {light} ambient="0 0 0" diffuse="1 1 1" specular="0 0 0"/>'
    mjm = scenes.compile_xml(dim + FLOOR + boxes, more=DARK)
    mjm.stat.extent, mjm.vis.map.shadowclip = 1.0, clip
    mjm.vis.map.shadowscale = 0.75 if name == "spot" else 0.5
    scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device)
    for x, shaded in zip((-2.0, 0.0, 2.0), wanted, strict=True):
        middle = x * 1.25 if "spot" in name else x  # of the shadow: seen from under the boxes
        camera = scenes.own_camera(
            outputs=("hdr", "segmentation"),
            shadows=True,
            position=(middle, 0.0, 0.5),
            rotation=(1, 0, 0, 0),
            lens=wc.Pinhole(fovy=10.0),
            width=5,
            height=5,
        )
        images = scenes.look(scene, camera)
        assert (images["segmentation"] == 0).all()
        assert (images["hdr"].max() == 0.0) == shaded and (images["hdr"].min() > 0.0) == (not shaded), x


@pytest.mark.parametrize(("gap", "dark"), [(2.0e-5, False), (2.0e-2, True)])
@pytest.mark.parametrize("light", ["directional", "spot"])
def test_layers_of_one_surface_do_not_shade_each_other(device: wp.Device, light: str, gap: float, dark: bool) -> None:
    """Layers nearer to a surface than a part of a texel of the renderer's map, as the inner side of a mesh, cast no
    shadow on it.
    """
    sheet = "-9 -9 0  9 -9 0  0 9 0  0 0 9"
    mjm = scenes.compile_xml(
        LIGHTS[light] + FLOOR + '<geom type="mesh" mesh="sheet"/>',
        assets=f'<mesh name="sheet" vertex="{sheet}" face="0 2 1  0 1 3" inertia="shell"/>',
        more=DARK,
    )
    mjd = scenes.forward(mjm)
    low = mjm.mesh_vert @ mjd.geom_xmat[1].reshape(3, 3).T + mjd.geom_xpos[1]
    mjd.geom_xpos[1, 2] += gap - low[:3, 2].mean()
    mjm.stat.extent = 4.0
    camera = scenes.own_camera(outputs=("hdr", "segmentation"), shadows=True, **EYE)
    images = scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera)
    floor = images["segmentation"] == 0
    assert floor.sum() > 200
    assert (images["hdr"][floor].max(axis=-1) == 0.0).mean() == pytest.approx(float(dark), abs=0.3)


@pytest.mark.parametrize("crowd", [0, 400])
@pytest.mark.parametrize("light", ["directional", "spot"])
def test_what_stands_inside_of_glass_lies_in_its_shadow(device: wp.Device, light: str, crowd: int) -> None:
    """Glass casts whole shadows, in the renderer's maps also on what it holds: here on balls that light would reach."""
    kinds = [kind for kind in CASTERS if kind not in ("mesh", "hfield")]
    places, black = [1.4 * i - 2.8 for i in range(len(kinds))], 'material="black"'
    rooms = "".join(
        f'<body pos="{x} 0 1" euler="20 10 30">{scenes.geom_xml(kind, more=black)}'
        '<geom size=".08" rgba="1 1 1 1"/></body>'
        for x, kind in zip(places, kinds, strict=True)
    )
    alone = '<geom size=".08" pos="0 1 1" rgba="1 1 1 1"/>'
    far = "".join(f'<geom size="0.01" pos="0 {-80 - 0.1 * i} 0"/>' for i in range(crowd))
    mjm = scenes.compile_xml(
        LIGHTS[light] + FLOOR + rooms + alone + far,
        assets='<material name="black" rgba="0 0 0 .4" specular="0"/>',
        more=DARK,
    )
    mjm.vis.map.shadowclip = 0.0
    view = {"position": (0, 0, 3), "lens": wc.Orthographic(height=3.2), "width": 160, "height": 64}
    lit = {}
    for shadows in (True, False):
        camera = scenes.own_camera(outputs=("hdr",), shadows=shadows, **view)
        image = scenes.look(wc.from_mujoco_warp(mjm, *scenes.put(mjm, 1)), camera)["hdr"][0].max(axis=-1)
        lit[shadows] = [image[31:33, round(20 * x) + 80] for x in places], image[11:13, 80]
    assert np.min(lit[False][0]) > 0.02
    assert np.max(lit[True][0]) == 0.0
    assert np.min(lit[True][1]) > 0.2  # in the open
