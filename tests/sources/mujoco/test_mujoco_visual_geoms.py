"""Sites, tendons, flexes and skins of MuJoCo, against ``mujoco.Renderer`` and in closed form."""

import functools

import mujoco
import mujoco_judge as judge
import numpy as np
import pytest
import scenes
import visual_geom_scenes
import warp as wp

import warpcam as wc
from warpcam.sources.mujoco import visual_geoms
from warpcam.sources.mujoco.model import VERSION

WRAPPED = VERSION >= visual_geoms.WRAPPED
ENDS = 40  # pixels: the ends of a line are closed, which MuJoCo leaves open

FROM_THE_FRONT = {"position": (0.0, -3.0, 0.0), "rotation": (0.7071, 0.7071, 0.0, 0.0)}


def looked_at(name: str, seed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    mjm, mjd = visual_geom_scenes.bent(name, seed)
    mjm.stat.center[:], mjm.stat.extent = 0.0, 1.2
    return mjm, mjd


@functools.cache
def drawn(name: str, seed: int) -> judge.Reference:
    """MuJoCo's own images of it."""
    return judge.draw(*looked_at(name, seed), camera=-1)


def as_classic(name: str, device: wp.Device) -> wc.Scene:
    mjm, first = looked_at(name, 0)
    return wc.from_mujoco(mjm, [first, looked_at(name, 1)[1]], device=device)


def as_warp(name: str, device: wp.Device) -> wc.Scene:
    mjm, first = looked_at(name, 0)
    second = looked_at(name, 1)[1]
    m, d = scenes.put(mjm, 2, mjd=first)
    for field in ("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "xpos", "xmat", "flexvert_xpos", "wrap_xpos",
                  "wrap_obj", "ten_wrapadr", "ten_wrapnum", "ten_length"):  # fmt: skip
        array = getattr(d, field)
        if array.size:
            host = array.numpy()
            host[1] = np.reshape(getattr(second, field), host.shape[1:])
            array.assign(host)
    return wc.from_mujoco_warp(mjm, m, d)


@pytest.mark.parametrize("source", [as_classic, as_warp], ids=["classic", "warp"])
@pytest.mark.parametrize("name", visual_geom_scenes.MODELS)
def test_ids_and_depth_are_those_of_mujocos_own_renderer(device: wp.Device, name: str, source: object) -> None:
    scene = source(name, device)
    for world in range(2):
        reference = drawn(name, world)
        judge.compare_with(reference, scene, name, world, ENDS if name == "line" else 0)
        assert set(np.unique(reference.pairs[..., 1])) - {-1, 5}, "nothing but geoms is in the image"


@pytest.mark.parametrize("name", visual_geom_scenes.MODELS)
def test_colours_are_those_of_mujocos_own_renderer(device: wp.Device, name: str) -> None:
    mjm, mjd = looked_at(name, 0)
    reference = drawn(name, 0)
    mjm.vis.quality.offsamples = 0
    with mujoco.Renderer(mjm, judge.SIZE, judge.SIZE) as renderer:
        renderer.update_scene(mjd)
        expected = renderer.render().astype(int)
    camera = wc.Camera(
        "free", width=judge.SIZE, height=judge.SIZE, outputs=("rgb", "segmentation"), shadows=True,
        lens=reference.camera.lens, position=reference.camera.position, rotation=reference.camera.rotation,
    )  # fmt: skip
    scene = wc.from_mujoco(mjm, mjd, device=device)
    seen = scenes.look(scene, camera)
    pairs = scene.objects[seen["segmentation"][0]]
    inside = ~judge.edge_band(reference.pairs @ (1, 2**16), reference.depth)
    inside &= (pairs == reference.pairs).all(axis=-1) & (pairs[..., 1] > int(mujoco.mjtObj.mjOBJ_GEOM))
    off = np.abs(seen["rgb"][0].astype(int) - expected).max(axis=-1)[inside]
    assert inside.sum() > 50
    assert np.quantile(off, 0.98) <= 10
    assert off.mean() < 2.0


@pytest.mark.parametrize("source", [as_classic, as_warp], ids=["classic", "warp"])
def test_what_a_limit_holds_has_the_limits_colour(device: wp.Device, source: object) -> None:
    """Blended by its impedance, in each world its own; not of what has a material or a colour, or hangs slack."""
    scene = source("held", device)
    camera = scenes.own_camera(**FROM_THE_FRONT, outputs=("albedo", "segmentation"), width=64, height=64)
    renderer = wc.Renderer(scene, [camera])
    renderer.render()
    seen = scenes.on_host(renderer.render()["eye"])  # once more: what is blended is not blended again
    shown = []
    for world in range(2):
        mjm, mjd = looked_at("held", world)
        drawn = mujoco.MjvScene(mjm, 100)
        mujoco.mjv_updateScene(mjm, mjd, mujoco.MjvOption(), None, mujoco.MjvCamera(), 7, drawn)
        expected = {
            geom.objid: geom.rgba[:3]
            for geom in drawn.geoms[: drawn.ngeom]
            if geom.objtype == mujoco.mjtObj.mjOBJ_TENDON
        }
        first = mjm.ngeom + mjm.nsite
        colors = np.array([seen["albedo"][world][seen["segmentation"][world] == first + i][0] for i in range(6)])
        assert np.abs(colors - 255.0 * np.array([expected[i] for i in range(6)])).max() <= 1.0
        shown.append(colors)
    assert (np.abs(shown[0][:, 0].astype(int) - 127)[:3] > 8).all() and (shown[0][1:3] != shown[1][1:3]).any(
        axis=1
    ).all()


def test_colours_of_held_tendons_follow_the_model(device: wp.Device) -> None:
    mjm, mjd = looked_at("held", 0)
    camera = scenes.own_camera(**FROM_THE_FRONT, outputs=("albedo",))
    renderer = wc.Renderer(wc.from_mujoco(mjm, mjd, device=device), [camera])
    blue = lambda: (scenes.on_host(renderer.render()["eye"])["albedo"] == (0, 0, 255)).all(axis=-1).sum()  # noqa: E731
    assert blue() == 0
    mjm.tendon_rgba[0] = (0.0, 0.0, 1.0, 1.0)
    assert blue() > 0
    mjm.tendon_rgba[0] = (0.5, 0.5, 0.5, 1.0)
    assert blue() == 0


@pytest.mark.parametrize("source", [as_classic, as_warp], ids=["classic", "warp"])
def test_limits_go_on_to_colour_where_colours_are_varied(device: wp.Device, source: object) -> None:
    """But for what is painted; and what is varied begins as what nothing holds."""
    scene = source("held", device)
    camera = scenes.own_camera(**FROM_THE_FRONT, outputs=("albedo", "segmentation"), width=64, height=64)
    renderer = wc.Renderer(scene, [camera])
    before = scenes.on_host(renderer.render()["eye"])
    colors = scene.vary("shape_colors")
    mjm = looked_at("held", 0)[0]
    first = mjm.ngeom + mjm.nsite
    own = np.flatnonzero(scene._parts.shape_ids[0] == first).tolist()
    assert (colors[:, own] == colors.new_tensor(visual_geoms.DEFAULT_COLOR)).all()
    after = scenes.on_host(renderer.render()["eye"])
    assert (after["albedo"] == before["albedo"]).all()
    colors[1, own] = colors.new_tensor((0.0, 0.0, 1.0, 1.0))
    after = scenes.on_host(renderer.render()["eye"])
    painted = before["segmentation"] == first
    painted[0] = False
    assert painted.any() and (after["albedo"][painted] == (0, 0, 255)).all()
    assert (after["albedo"][~painted] == before["albedo"][~painted]).all()


def test_tendons_take_no_columns_that_cannot_be_drawn(device: wp.Device) -> None:
    for slices, most in ((120, 8), (5, 5)):
        mjm, mjd = visual_geom_scenes.bent("wraps")
        mjm.vis.quality.numslices = slices
        scene = wc.from_mujoco(mjm, mjd, device=device, draw=("tendons",))
        wraps = 1 + 2
        straight = 2 + 4
        arcs = wraps * most if WRAPPED else wraps
        assert scene.tables().num_drawn == straight + arcs
    mjm, mjd = visual_geom_scenes.bent("tendons")
    scene = wc.from_mujoco(mjm, mjd, device=device, draw=("tendons",))
    assert scene.tables().num_drawn == 2 + (8 if WRAPPED else 1) + 2, "nothing beside a pulley"


def test_ids_count_on_from_the_geoms(device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent("tendons")
    scene = wc.from_mujoco(mjm, mjd, device=device)
    geom, site, tendon = (int(getattr(mujoco.mjtObj, f"mjOBJ_{kind}")) for kind in ("GEOM", "SITE", "TENDON"))
    assert scene.objects.tolist() == [
        *([index, geom] for index in range(mjm.ngeom)),
        *([index, site] for index in range(mjm.nsite)),
        *([index, tendon] for index in range(mjm.ntendon)),
        [-1, -1],
    ]
    seen = scenes.look(scene, scenes.own_camera(position=(0.0, -2.5, 0.0), rotation=(0.7071, 0.7071, 0.0, 0.0)))
    assert set(np.unique(seen["segmentation"])) >= {-1, 0, mjm.ngeom + mjm.nsite, mjm.ngeom + mjm.nsite + 1}


def test_bodies_of_sites(device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent("sites")
    scene = wc.from_mujoco(mjm, mjd, device=device)
    camera = scenes.own_camera(
        position=(0.0, -2.5, 0.0), rotation=(0.7071, 0.7071, 0.0, 0.0), outputs=("segmentation", "bodies")
    )
    seen = scenes.look(scene, camera)
    pairs = scene.objects[seen["segmentation"]]
    cube = (pairs == (mjm.site("cube").id, int(mujoco.mjtObj.mjOBJ_SITE))).all(axis=-1)
    assert cube.any() and (seen["bodies"][cube] == 1).all()
    assert (seen["bodies"][(pairs[..., 1] == int(mujoco.mjtObj.mjOBJ_SITE)) & ~cube] == 0).all()


def test_what_cannot_be_seen_costs_nothing(device: wp.Device) -> None:
    hidden = '<site size=".1" rgba="1 0 0 0"/><site size=".1" group="4"/>'
    plain = scenes.compile_xml('<geom size=".1"/>' + hidden)
    m, d = scenes.put(plain, 2)
    scene = wc.from_mujoco_warp(plain, m, d)
    tables = scene.tables()
    assert (tables.num_drawn, tables.num_shapes, scene.stages()) == (1, 1, ())
    assert scene.array("shape_positions") is d.geom_xpos
    mjm, mjd = visual_geom_scenes.bent("sites")
    assert wc.from_mujoco(mjm, mjd, device=device).tables().num_drawn == mjm.ngeom + 5


def test_what_is_drawn_is_chosen(device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent("tendons")
    camera = scenes.own_camera(position=(0.0, -2.5, 0.0), rotation=(0.7071, 0.7071, 0.0, 0.0))

    def kinds(**choice: object) -> set[int]:
        scene = wc.from_mujoco(mjm, mjd, device=device, **choice)
        return set(np.unique(scene.objects[scenes.look(scene, camera)["segmentation"], 1]))

    assert kinds() == {-1, 5, 6, 18}
    assert kinds(draw=("geoms",)) == {-1, 5}
    assert kinds(draw=("tendons",)) == {-1, 18}
    assert kinds(groups=(4,)) == {-1, 18}  # the wide tendon alone
    with pytest.raises(wc.WarpcamError, match="draw: 'site' came; allowed are geoms, sites, tendons, flexes, skins"):
        kinds(draw=("geoms", "site"))


def test_only_mujoco_has_kinds_of_objects(device: wp.Device) -> None:
    pxr = pytest.importorskip("pxr.Usd")
    stage = pxr.Stage.CreateInMemory()
    from pxr import UsdGeom

    UsdGeom.Cube.Define(stage, "/cube")
    with pytest.raises(wc.WarpcamError, match="only scenes of from_mujoco and from_mujoco_warp"):
        _ = wc.from_usd(stage, device=device).objects


def test_normals_where_a_texture_does_not_show(device: wp.Device) -> None:
    """On a flex that is a line, which is the only shape that bends: the trace itself writes them."""
    mjm, mjd = visual_geom_scenes.bent("line")
    camera = scenes.own_camera(position=(0.0, 0.0, 3.0), outputs=("segmentation", "normals"))
    seen = scenes.look(wc.from_mujoco(mjm, mjd, device=device), camera)
    line = seen["segmentation"] == mjm.ngeom
    assert line.any() and np.allclose(np.linalg.norm(seen["normals"][line], axis=-1), 1.0, atol=1e-5)
    assert np.allclose(seen["normals"][seen["segmentation"] == 0], (0.0, 0.0, 1.0), atol=1e-6)


def test_texture_coordinates_may_be_fewer_than_vertices(device: wp.Device) -> None:
    """Elements may share texture coordinates: each triangle shows the same picture."""
    corners = "-.5 -.5 0 .5 -.5 0 .5 .5 0 -.5 .5 0"
    cloth = f'''<deformable><flex name="soft" dim="2" radius=".02" body="world" material="checks" rgba=".5 .5 .5 1"
      vertex="{corners}" element="0 1 2 2 3 0" texcoord="0 0 1 0 1 1" elemtexcoord="0 1 2 0 1 2"/></deformable>'''
    mjm = scenes.compile_xml("", assets=visual_geom_scenes.PICTURE, more=cloth)
    camera = scenes.own_camera(
        position=(0.0, 0.0, 3.0), lens=wc.Orthographic(height=1.0), outputs=("albedo", "segmentation")
    )
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)
    assert (seen["segmentation"] == 0).all() and len(np.unique(seen["albedo"].reshape(-1, 3), axis=0)) > 10
    apart = ~np.eye(32, dtype=bool)[::-1]  # from the diagonal between the triangles
    turned = seen["albedo"][0, ::-1, ::-1].astype(int)
    assert np.abs(seen["albedo"][0].astype(int) - turned)[apart].max() <= 3


def test_a_world_is_moved_in_place(device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent("cloth")
    m, d = scenes.put(mjm, 2, mjd=mjd)
    renderer = wc.Renderer(
        wc.from_mujoco_warp(mjm, m, d),
        [scenes.own_camera(position=(0.0, 0.0, 3.0), outputs=("depth", "segmentation", "normals"))],
    )
    before = scenes.on_host(renderer.render()["eye"])
    cloth = before["segmentation"] == mjm.ngeom
    host = d.flexvert_xpos.numpy()
    host[1, :, 2] += 0.5
    d.flexvert_xpos.assign(host)
    after = scenes.on_host(renderer.render()["eye"])
    assert (after["depth"][0] == before["depth"][0]).all()
    both = cloth[1] & (after["segmentation"][1] == mjm.ngeom)
    assert both.any() and (after["depth"][1] < before["depth"][1])[both].mean() > 0.95


def test_arrays_that_are_replaced_are_read(device: wp.Device) -> None:
    """Give a field rows for each world after the scene was made, as mjlab does."""
    mjm = scenes.compile_xml('<geom size=".4" rgba="1 0 0 1"/><site size=".1" pos=".9 0 0" rgba="0 1 0 1"/>')
    m, d = scenes.put(mjm, 2)
    camera = scenes.own_camera(position=(0.0, 0.0, 3.0), outputs=("albedo", "segmentation"))
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera])
    assert (scenes.on_host(renderer.render()["eye"])["albedo"][:, 16, 16] == (255, 0, 0)).all()
    colors = np.array([[(0, 0, 1, 1)], [(1, 1, 0, 1)]], np.float32)
    m.geom_rgba = wp.array(colors, dtype=wp.vec4, device=d.geom_xpos.device)
    seen = scenes.on_host(renderer.render()["eye"])
    assert (seen["albedo"][:, 16, 16] == [(0, 0, 255), (255, 255, 0)]).all()
    assert (seen["albedo"][seen["segmentation"] == 1] == (0, 255, 0)).all() and (seen["segmentation"] == 1).any()


def test_the_kinematics_can_be_run_first(device: wp.Device) -> None:
    for source in ("classic", "warp"):
        mjm, mjd = visual_geom_scenes.bent("cloth")
        expected = scenes.look(wc.from_mujoco(mjm, mjd, device=device), scenes.own_camera(position=(0.0, 0.0, 3.0)))
        moved = mjd.qpos.copy()
        if source == "classic":
            mujoco.mj_resetData(mjm, mjd)
            mujoco.mj_forward(mjm, mjd)
            mjd.qpos[:] = moved
            scene = wc.from_mujoco(mjm, mjd, device=device)
        else:
            m, d = scenes.put(mjm, 1, mjd=scenes.forward(mjm))
            d.qpos.assign(moved[None].astype(np.float32))
            scene = wc.from_mujoco_warp(mjm, m, d)
        renderer = wc.Renderer(scene, [scenes.own_camera(position=(0.0, 0.0, 3.0))])
        assert (scenes.on_host(renderer.render()["eye"])["depth"] != expected["depth"]).any()
        seen = scenes.on_host(renderer.render(forward=True)["eye"])["depth"]
        assert np.isclose(seen, expected["depth"], atol=1e-4).mean() > 0.99


def test_a_tendon_is_a_capsule_between_its_points(device: wp.Device) -> None:
    world = '<site name="a" size=".001" pos="-1 0 0"/><site name="b" size=".001" pos="1 0 .5"/>'
    path = '<tendon><spatial width=".1"><site site="a"/><site site="b"/></spatial></tendon>'
    mjm = scenes.compile_xml(world, more=path)
    camera = scenes.own_camera(position=(0.0, 0.0, 3.0), lens=wc.Orthographic(height=3.0), outputs=("depth",))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["depth"][0]
    column, row = np.meshgrid((np.arange(32) + 0.5) * 3.0 / 32 - 1.5, 1.5 - (np.arange(32) + 0.5) * 3.0 / 32)
    start, along = np.array((-1.0, 0.0, 0.0)), np.array((2.0, 0.0, 0.5)) / np.sqrt(4.25)
    # A ray from above meets the side where x and y are at distance 0.1 from the axis.
    height = 0.25 * (column + 1.0) + np.sqrt(np.maximum(0.01 - row**2, 0.0)) * np.sqrt(1.0 + 0.25**2)
    hits = (np.abs(row) < 0.09) & (np.abs(column) < 0.9)
    assert start[0] == -1.0 and along[2] > 0.0
    assert np.allclose(seen[hits], 3.0 - height[hits], atol=1e-4)


def test_bounds_hold_what_is_soft(device: wp.Device) -> None:
    mjm, mjd = visual_geom_scenes.bent("solid")
    low, high = wc.from_mujoco(mjm, mjd, device=device, draw=("flexes",)).bounds()
    assert (low <= mjd.flexvert_xpos.min(axis=0) + 1e-6).all() and (low >= mjd.flexvert_xpos.min(axis=0) - 0.06).all()
    assert (high >= mjd.flexvert_xpos.max(axis=0) - 1e-6).all() and (high <= mjd.flexvert_xpos.max(axis=0) + 0.06).all()


def test_a_slack_string_hangs_in_a_catenary(device: wp.Device) -> None:
    """y = a cosh(x / a), whose length between -1 and 1 is 2 a sinh(1 / a)."""
    flatness = 0.7
    ends = '<site pos="-1 0 0" name="a" size=".001"/><site pos="1 0 0" name="b" size=".001"/>'
    string = f'<spatial width=".01" limited="true" range="0 {2.0 * flatness * np.sinh(1.0 / flatness)}">'
    path = f'<tendon>{string}<site site="a"/><site site="b"/></spatial></tendon>'
    mjm = scenes.compile_xml(ends, more=path)
    mjm.vis.quality.numslices = 99
    camera = scenes.own_camera(
        position=(0.0, -3.0, -0.5), rotation=(0.70710678, 0.70710678, 0.0, 0.0), lens=wc.Orthographic(height=3.0),
        width=300, height=300, outputs=("segmentation",),
    )  # fmt: skip
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), camera)["segmentation"][0]
    row, column = np.nonzero(seen == 2)
    x, z = (column + 0.5) * 0.01 - 1.5, 1.0 - (row + 0.5) * 0.01
    inside = np.abs(x) < 0.95
    assert inside.sum() > 100
    lowest = flatness * np.cosh(1.0 / flatness)
    assert np.abs(z - (flatness * np.cosh(x / flatness) - lowest))[inside].max() < 0.02
    assert np.abs(z[np.abs(x) < 0.05].mean() - (flatness - lowest)) < 0.005


def test_slider_cranks_of_each_world_with_mujoco_warp(device: wp.Device) -> None:
    """The second world's is too short, and has another colour."""
    mjm = scenes.compile_xml(
        """<body><joint type="slide" axis="1 0 0"/><geom size=".05"/><site name="a" zaxis="1 0 0" size=".001"/></body>
        <site name="b" pos="1 0 .3" size=".001"/><camera pos=".5 -2 .2" xyaxes="1 0 0 0 0 1" fovy="50"/>""",
        more='<statistic meansize=".4"/><actuator><general cranksite="b" slidersite="a" cranklength=".6"/></actuator>',
    )
    m, d = scenes.put(mjm, 2)
    sites = d.site_xpos.numpy()
    sites[1, mjm.site("b").id, 2] = 0.7
    d.site_xpos.assign(sites)
    scene = wc.from_mujoco_warp(mjm, m, d)
    camera = wc.Camera(0, width=64, height=64, outputs=("albedo", "segmentation"))
    image = wc.Renderer(scene, [camera]).render()[0]
    actuator = int(np.flatnonzero(scene.objects[:, 1] == int(mujoco.mjtObj.mjOBJ_ACTUATOR))[0])
    for world, wanted in enumerate((mjm.vis.rgba.slidercrank, mjm.vis.rgba.crankbroken)):
        there = image["segmentation"][world, ..., 0].cpu().numpy() == actuator
        colors = image["albedo"][world].cpu().numpy()[there].astype(int)
        assert len(colors) > 30
        assert (np.abs(colors - np.rint(255.0 * np.asarray(wanted)[:3])).max(axis=-1) <= 1).sum() > 10


@pytest.mark.parametrize("tilt", [0.0, 3e-4, 1.5e-3, 2e-3, 5e-3])
def test_tendons_that_hang_down_are_as_those_that_stand(tilt: float, device: wp.Device) -> None:
    sites = f'<site name="up" pos="{tilt} {0.5 * tilt} 1"/><site name="low"/>'
    eye = (0.2, -1.5, 0.6)
    camera = scenes.own_camera(
        outputs=("depth", "normals"), position=eye, rotation=scenes.looking(eye, (0.0, 0.0, 0.5))
    )
    seen = []
    for first, second in (("up", "low"), ("low", "up")):
        path = f'<tendon><spatial width=".1"><site site="{first}"/><site site="{second}"/></spatial></tendon>'
        mjm = scenes.compile_xml(sites, more=path)
        scene = wc.from_mujoco(mjm, scenes.forward(mjm), device=device, draw=("tendons",))
        seen.append(scenes.look(scene, camera))
    down, up = seen
    hit = np.isfinite(up["depth"]) & np.isfinite(down["depth"])
    assert hit.sum() > 50
    assert (np.isfinite(up["depth"]) == np.isfinite(down["depth"])).mean() > 0.998
    assert np.abs(down["depth"][hit] - up["depth"][hit]).max() < 1e-4
    np.testing.assert_allclose(np.linalg.norm(down["normals"][hit], axis=-1), 1.0, atol=1e-5)
    assert np.abs(down["normals"][hit] - up["normals"][hit]).max() < 5e-3
