"""Checkerboards in place of Newton's: how they lie, who shows them, and Newton's own example."""

import importlib.util
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpcam as wc

newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")
import newton_scenes  # noqa: E402, newton may be missing
import scenes  # noqa: E402
from newton.sensors import SensorCamera as TheirCamera  # noqa: E402
from newton_scenes import pose  # noqa: E402

from warpcam.compat.newton import SensorCamera, SensorTiledCamera  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Newton's own

SIZE = (160, 120)
TURN = (0.3, 0.1, 0.4, 1.0)
WHITE = (1.0, 1.0, 1.0)
LINK = """<link name="fr3_link{0}"><visual><geometry><box size="0.1 0.1 0.3"/></geometry></visual><inertial><mass
value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="fr3_joint{0}" type="revolute"><parent link="fr3_link{1}"/><child link="fr3_link{0}"/><origin
xyz="0 0 0.3"/><axis xyz="0 1 0"/><limit lower="-2.9" upper="2.9" effort="1" velocity="1"/></joint>"""


def add_all(builder: Any) -> None:
    """One shape of each kind, in two rows on a floor, their axes askew."""
    ball = newton.Mesh.create_sphere(0.45, compute_inertia=False)
    bare = newton.Mesh(ball.vertices, ball.indices, compute_inertia=False)
    smooth = newton.Mesh(ball.vertices, ball.indices, normals=ball.normals, compute_inertia=False)
    waves = np.sin(np.linspace(0.0, 4.0, 10))[:, None] * np.cos(np.linspace(0.0, 4.0, 10))
    box = newton.Mesh.create_box(0.4, compute_inertia=False)  # with texture coordinates
    places = iter((1.2 * (index % 5) - 2.4, 1.4 * (index // 5) - 0.7, 0.9) for index in range(10))

    def at() -> dict[str, Any]:
        return {"xform": pose(*next(places), TURN), "color": WHITE}

    builder.add_shape_plane(width=6.0, length=4.0, color=WHITE)
    builder.add_shape_box(-1, hx=0.4, hy=0.3, hz=0.5, **at())
    builder.add_shape_sphere(-1, radius=0.45, **at())
    builder.add_shape_cylinder(-1, radius=0.4, half_height=0.4, **at())
    builder.add_shape_capsule(-1, radius=0.25, half_height=0.3, **at())
    builder.add_shape_cone(-1, radius=0.45, half_height=0.5, **at())
    builder.add_shape_ellipsoid(-1, rx=0.5, ry=0.3, rz=0.4, **at())
    builder.add_shape_mesh(-1, mesh=box, **at())
    builder.add_shape_mesh(-1, mesh=bare, scale=(1.0, 0.8, 1.2), **at())
    builder.add_shape_mesh(-1, mesh=smooth, **at())
    field = newton.Heightfield(0.5 * waves.astype(np.float32), 10, 10, hx=0.5, hy=0.5)
    builder.add_shape_heightfield(heightfield=field, **at())


def seen_by(sensor: Any, model: Any, state: Any, position: Any = (0.5, -5.0, 3.5)) -> tuple[np.ndarray, np.ndarray]:
    """Albedo as three channels, and shapes, (height, width)."""
    rays = type(sensor).compute_camera_rays_pinhole(*SIZE, camera_fov=0.9, device=model.device)
    w, x, y, z = (float(part) for part in scenes.looking(position, (0.0, 0.0, 0.6)))
    views = wp.array([wp.transform(wp.vec3(*position), wp.quat(x, y, z, w))], dtype=wp.transformf, device=model.device)
    albedo, shapes = sensor.allocate_image_albedo(1, *SIZE), sensor.allocate_image_shape_index(1, *SIZE)
    model.bvh_refit_shapes(state)
    sensor.update(state, views, rays, albedo_image=albedo, shape_index_image=shapes)
    packed = albedo.numpy()[0]
    return np.stack([packed >> shift & 255 for shift in (0, 8, 16)], axis=-1).astype(int), shapes.numpy()[0]


@pytest.mark.parametrize("mode", [0, 1], ids=["cubic", "triplanar"])
def test_it_lies_as_newton_lays_it(device: wp.Device, mode: int) -> None:
    builder = newton.ModelBuilder()
    add_all(builder)
    model, state = newton_scenes.finalize(builder, device)
    config = TheirCamera.RenderConfig(enable_textures=True, texture_projection_mode=mode)
    found = []
    for kind in (TheirCamera, SensorCamera):
        sensor = kind(model, default_render_config=config)
        sensor.assign_checkerboard_material(shape_indices=np.arange(model.shape_count))
        found.append(seen_by(sensor, model, state))
    (theirs, shapes), (mine, same) = found
    for shape in range(model.shape_count):
        there = (shapes == shape) & (same == shape)
        difference = np.abs(mine - theirs).max(axis=-1)[there]
        assert there.sum() > 60, shape
        # Squares are half a metre: few pixels are at their edges, and half of them differ where it lies another way.
        assert (difference <= 24).mean() > 0.85, (shape, (difference <= 24).mean())
        assert np.ptp(theirs[there]) > 20, shape


def test_a_projection_counts_after_an_image_without_textures(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.8, xform=pose(0.0, 0.0, 0.6), color=WHITE)
    model, state = newton_scenes.finalize(builder, device)
    seen = []
    for hides in (False, True):
        config = TheirCamera.RenderConfig(enable_textures=True)
        sensor = SensorCamera(model, default_render_config=config)
        sensor.assign_checkerboard_material(shape_indices=[0], checker_size=8)
        cubic = seen_by(sensor, model, state)[0]
        if hides:
            config.enable_textures = False
            assert set(np.unique(seen_by(sensor, model, state)[0])) == {0, 255}
        config.enable_textures, config.texture_projection_mode = True, 1
        seen.append(seen_by(sensor, model, state)[0])
        assert (seen[-1] != cubic).any()
    assert (seen[0] == seen[1]).all()


def test_each_call_is_the_whole_selection(device: wp.Device) -> None:
    """Others show no texture, not even their own; load_textures=False leaves only those out."""
    builder = newton.ModelBuilder()
    mesh = newton.Mesh.create_box(0.4, compute_inertia=False)
    mesh.texture, mesh.roughness, mesh.metallic = np.full((4, 4, 3), (200, 40, 10), np.uint8), 0.25, 0.75
    builder.add_shape_mesh(-1, mesh=mesh, xform=pose(-0.6, 0.0, 0.6), color=WHITE)
    builder.add_shape_sphere(-1, radius=0.5, xform=pose(0.6, 0.0, 0.6), color=WHITE)
    model, state = newton_scenes.finalize(builder, device)
    greys, own, plain = {128, 191}, {200, 40, 10}, {255}

    def colors(sensor: Any) -> list[set[int]]:
        albedo, shapes = seen_by(sensor, model, state, (0.3, -2.0, 1.2))
        return [set(np.unique(albedo[shapes == shape])) for shape in (0, 1)]

    config = TheirCamera.RenderConfig(enable_textures=True)
    sensor = SensorCamera(model, default_render_config=config, physical=True)
    assert colors(sensor) == [own, plain]
    sensor.create_default_light(direction=(0.0, 0.0, -1.0))
    sensor.set_ambient_light((0.5, 0.25, 0.125))
    sky = sensor.scene.array("sky").numpy()
    sensor.assign_checkerboard_material(shape_indices=[1])
    first, second = colors(sensor)
    assert first == plain and greys <= second
    sensor.assign_checkerboard_material(shape_indices=np.array([0], np.uint32))
    first, second = colors(sensor)
    assert greys <= first and second == plain
    # As rough as it was, and lit as before.
    scene = sensor.scene
    material = scene.array("shape_materials").numpy()[0, np.flatnonzero(scene.columns[0] == 0)[0]]
    assert scene.array("material_roughness").numpy()[0, material] == np.float32(0.25)
    assert scene.array("material_metallic").numpy()[0, material] == np.float32(0.75)
    assert (scene.array("sky").numpy() == sky).all() and scene.array("light_active").numpy()[:, 0].all()
    assert (scene.array("light_directions").numpy() == (0.0, 0.0, -1.0)).all()
    sensor.assign_checkerboard_material(shape_indices=range(2), resolution=8, checker_size=8)
    assert colors(sensor) == [{128}, {128}]
    config.enable_textures = False
    assert colors(sensor) == [plain, plain]

    config.enable_textures = True
    sensor = SensorCamera(model, default_render_config=config, load_textures=False)
    assert colors(sensor) == [plain, plain]
    sensor.assign_checkerboard_material(shape_indices=[1])
    assert colors(sensor)[0] == plain and greys <= colors(sensor)[1]


@pytest.mark.parametrize("kind", [SensorCamera, SensorTiledCamera])
def test_textures_that_are_not_loaded_are_not_read(device: wp.Device, kind: Any, caplog: Any) -> None:
    """Their files may be missing, and settings that are shared with other sensors stay as they are."""
    builder = newton.ModelBuilder()
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    coordinates = np.zeros((3, 2), np.float32)
    mesh = newton.Mesh(corners, [0, 1, 2], uvs=coordinates, texture="missing.png", compute_inertia=False)
    builder.add_shape_mesh(-1, mesh=mesh)
    config = kind.RenderConfig(enable_textures=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", DeprecationWarning)  # of the older class
        sensor = kind(builder.finalize(device=device), default_render_config=config, load_textures=False)
    assert not caplog.records and sensor.default_render_config is config and config.enable_textures


def test_it_stays_when_fewer_shapes_are_drawn(device: wp.Device) -> None:
    """Some of the shapes have materials of their own."""
    builder = newton.ModelBuilder()
    for index in range(3):
        mesh = newton.Mesh.create_sphere(0.3, num_latitudes=5, num_longitudes=6, compute_inertia=False)
        mesh.roughness = 0.2 + 0.2 * index
        if index == 2:
            builder.begin_world()
        builder.add_shape_mesh(-1, mesh=mesh, xform=pose(index - 1.0, 0.0, 0.0))
    builder.end_world()
    model, state = newton_scenes.finalize(builder, device)
    sensor = SensorCamera(model)
    sensor.assign_checkerboard_material(shape_indices=[1, 2], resolution=8, checker_size=1)
    views = wp.array([wp.transform((0.0, 0.0, 4.0), wp.quat_identity())], dtype=wp.transformf, device=device)
    rays = SensorCamera.compute_camera_rays_pinhole(48, 24, camera_fov=0.5, device=device)
    images, shape = [], sensor.allocate_image_shape_index(1, 48, 24)
    for everywhere in (True, False, True):
        config = SensorCamera.RenderConfig(enable_textures=True, enable_global_world=everywhere)
        albedo = sensor.allocate_image_albedo(1, 48, 24)
        sensor.update(state, views, rays, albedo_image=albedo, shape_index_image=shape, render_config=config)
        images.append(albedo.numpy())
        assert set(np.unique(shape.numpy())) == ({0, 1, 2, 0xFFFFFFFF} if everywhere else {2, 0xFFFFFFFF})
    there = shape.numpy() == 2
    assert len(np.unique(images[0][there])) > 1 and (images[1][there] == images[0][there]).all()
    assert (images[2] == images[0]).all()


def test_the_light_is_the_default_one_again(device: wp.Device) -> None:
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y)
    builder.add_shape_sphere(-1, radius=0.5)
    sensor = SensorCamera(builder.finalize(device=device))
    usual = sensor.scene.array("light_directions").numpy()
    sensor.create_default_light(direction=(1.0, 0.0, 0.0))
    sensor.create_default_light()
    np.testing.assert_allclose(sensor.scene.array("light_directions").numpy(), usual, atol=1e-6)


def test_the_older_sensor_has_it_too(device: wp.Device) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.5, color=WHITE)
    sensor = SensorTiledCamera(builder.finalize(device=device))
    with pytest.warns(DeprecationWarning, match=r"assign_checkerboard_material\(\) changed .*enable_textures"):
        sensor.utils.assign_checkerboard_material(shape_indices=[0])
    assert sensor.default_render_config.enable_textures
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sensor.utils.assign_checkerboard_material(shape_indices=[0])  # it is set already
    assert sensor.scene.array("shape_materials").numpy()[0, 0] > 0
    sensor.utils.assign_checkerboard_material(shape_indices=[])
    assert sensor.scene.array("shape_materials").numpy()[0, 0] == 0
    with pytest.warns(DeprecationWarning, match="to_all_shapes is deprecated"):
        sensor.utils.assign_checkerboard_material_to_all_shapes()
    assert sensor.scene.array("shape_materials").numpy()[0, 0] > 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"shape_indices": [3]}, "out-of-range shape index: 3; the model has 1 shapes"),
        ({"shape_indices": [-1]}, "out-of-range shape index: -1"),
        ({"shape_indices": [0.5]}, "shape_indices must be whole numbers, got float64"),
        ({"shape_indices": [0], "resolution": 0}, "resolution must be a whole number of at least 1, got 0"),
        ({"shape_indices": [0], "checker_size": 2.5}, "checker_size must be a whole number of at least 1, got 2.5"),
    ],
)
def test_what_cannot_be_is_named(device: wp.Device, settings: dict[str, Any], message: str) -> None:
    builder = newton.ModelBuilder()
    builder.add_shape_sphere(-1, radius=0.5)
    sensor = SensorCamera(builder.finalize(device=device))
    with pytest.raises(wc.WarpcamError, match=message):
        sensor.assign_checkerboard_material(**settings)


def test_newtons_own_pictures(device: wp.Device) -> None:
    """Compare with the pictures that Newton's tests compare its older camera with, on a GPU alone."""
    tests = pytest.importorskip("newton.tests.test_sensor_tiled_camera", reason="this version's wheel has no tests")
    folder = Path(tests.__file__).parent / "golden_data" / "test_sensor_tiled_camera"
    if not hasattr(tests.TestSensorTiledCamera, "_render_checkerboard_projection"):
        pytest.skip("this version of Newton has no such pictures")
    case, theirs = tests.TestSensorTiledCamera(), tests.SensorTiledCamera
    tests.SensorTiledCamera = SensorTiledCamera
    try:
        for kind in ("primitive", "uvless_mesh"):
            for mode in SensorTiledCamera.TextureProjectionMode:
                with wp.ScopedDevice(device):
                    mine = case._render_checkerboard_projection(kind, mode)
                golden = np.load(folder / f"projection_{kind}_{mode.name.lower()}.npy")
                channels = [image.view(np.uint8).reshape(64, 64, 4).astype(int) for image in (mine, golden)]
                difference = np.abs(channels[0] - channels[1]).max(axis=-1)
                assert (difference <= 16).mean() > 0.7, (kind, mode, (difference <= 16).mean())
    finally:
        tests.SensorTiledCamera = theirs


def test_newtons_own_example(device: wp.Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only its import and its images' size are changed, and its robot is one that needs no download."""
    pytest.importorskip("pxr", reason="pip install usd-core")
    file = Path(newton.__file__).parent / "examples" / "sensors" / "example_sensor_camera.py"
    text = file.read_text() if file.is_file() else ""
    line = "from newton.sensors import SensorCamera\n"
    if line not in text:
        pytest.skip("this version of Newton has no such example, or another one")
    program = tmp_path / "example_sensor_camera.py"
    text = text.replace(line, "from warpcam.compat.newton import SensorCamera\n")
    program.write_text(text.replace(" = 256\n", " = 64\n"))  # sooner done
    parts = [LINK.format(index) for index in range(8)] + [JOINT.format(index, index - 1) for index in range(1, 8)]
    (tmp_path / "urdf").mkdir()
    (tmp_path / "urdf" / "fr3_franka_hand.urdf").write_text(f'<robot name="fr3">{"".join(parts)}</robot>')
    monkeypatch.setattr(newton.utils, "download_asset", lambda name: tmp_path)
    spec = importlib.util.spec_from_file_location("example_sensor_camera", program)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        Path(module.newton.examples.get_asset("bunny.usd")).open("rb").close()
        viewer = module.newton.viewer.ViewerNull(num_frames=1)
    except (ImportError, OSError) as error:
        pytest.skip(f"Newton's examples need what is not installed: pip install 'newton[examples]' ({error})")
    with wp.ScopedDevice(device):
        example = module.Example(viewer, SimpleNamespace(ply=None, min_response=0.1))
        assert type(example.sensor_camera) is SensorCamera
        example.step()
        example.render()
        example.test_final()
