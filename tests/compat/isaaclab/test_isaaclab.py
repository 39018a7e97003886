"""Our renderer behind Isaac Lab's interface for renderers, as its wheel has it; physics and stage are stand-ins."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

HOW = "pip install isaaclab lazy_loader; without its other dependencies the interface for renderers can be imported"
pytest.importorskip("isaaclab.renderers", reason=HOW, exc_type=ImportError)
newton = pytest.importorskip("newton", reason="pip install 'warpcam[newton]'")

from isaaclab.renderers import BaseRenderer, RenderBufferKind  # noqa: E402

from warpcam.compat import isaaclab as ours  # noqa: E402
from warpcam.compat.isaaclab import renderer as module  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")  # Isaac Lab's and Newton's own

NUM_ENVS, WIDTH, HEIGHT = 2, 32, 24
EYE = (0.0, -3.0, 1.0)


class Mapper:
    """In place of Isaac Lab's, which reads labels from a stage."""

    def __init__(self, model: Any, *_: Any):
        self._model = model

    def build_mapping(self, kind: str, colorize: bool) -> None:
        pass

    def get_mapping(self, kind: str, colorize: bool) -> Any:
        ids = np.arange(2, 2 + self._model.shape_count).astype(np.uint32)
        table = wp.array(0xFF000000 + ids if colorize else ids, dtype=wp.uint32, device=self._model.device)
        return SimpleNamespace(
            shape_to_id=None if colorize else table,
            shape_to_color=table if colorize else None,
            info={"idToLabels": {}},
        )


def labels_of(renderer: Any) -> Mapper:
    if renderer._mapper is None:
        renderer._mapper = Mapper(renderer._backend.model)
    return renderer._mapper


@pytest.fixture
def simulation(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Two environments with a ball each, at another place, and a floor."""
    builder = newton.ModelBuilder()
    builder.add_ground_plane()
    for world in range(NUM_ENVS):
        part = newton.ModelBuilder()
        body = part.add_body(xform=wp.transform(wp.vec3(0.4 * world, 0.0, 0.8), wp.quat_identity()), label="ball")
        part.add_shape_sphere(body, radius=0.35, color=(0.9, 0.3, 0.1), label="ball")
        builder.add_world(part)
    model = builder.finalize(device=device)
    state = model.state()
    backend = SimpleNamespace(model=model, state_0=state, geometry_offsets=None, create_visual_material_writer=None)
    provider = SimpleNamespace(create_mapping=lambda labels: labels, get_transforms=lambda *_, **__: False)
    sim = SimpleNamespace(
        backend=backend,
        get_or_create_backend=lambda cfg: backend,
        get_scene_data_provider=lambda: provider,
        get_clone_plan=lambda: None,
    )
    monkeypatch.setattr(module, "simulation", lambda: sim)
    monkeypatch.setattr(module, "_backend_cfg", lambda sim: None)
    monkeypatch.setattr(module.WarpcamRenderer, "_follow", lambda self: None)
    monkeypatch.setattr(module.WarpcamRenderer, "_labels", labels_of)
    return sim


def proxies(values: np.ndarray, dtype: Any, device: Any) -> Any:
    array = wp.array(values, dtype=dtype, device=device)
    return SimpleNamespace(warp=array, torch=wp.to_torch(array))


def frame(
    simulation: Any, kinds: list[str], spawn: Any = None, isp_cfg: Any = None, **settings: Any
) -> tuple[dict[str, np.ndarray], Any, Any, Any]:
    """Images of a new renderer, in buffers as Isaac Lab's camera makes them."""
    cfg = ours.WarpcamRendererCfg(**settings)
    renderer = cfg.class_type(cfg) if callable(cfg.class_type) else ours.WarpcamRenderer(cfg)
    assert isinstance(renderer, BaseRenderer)
    renderer.initialize()
    spawn = spawn or SimpleNamespace(clipping_range=(0.05, 50.0), distortion=None)
    camera = SimpleNamespace(
        width=WIDTH, height=HEIGHT, data_types=kinds, spawn=spawn, background_color=None, isp_cfg=isp_cfg
    )
    spec = SimpleNamespace(cfg=camera, device="cpu", num_instances=NUM_ENVS, camera_prim_paths=(), view_count=NUM_ENVS)
    renderer.prepare_stage(None, NUM_ENVS)
    renderer.prepare_cameras(None, spec)
    data = renderer.create_render_data(spec)
    device, buffers = simulation.backend.model.device, {}
    for kind, layout in renderer.supported_output_types().items():
        if kind in kinds:
            array = wp.zeros((NUM_ENVS, HEIGHT, WIDTH, layout.channels), dtype=layout.dtype, device=device)
            buffers[str(kind)] = SimpleNamespace(warp=array, torch=wp.to_torch(array))
    if "rgb" in buffers and "rgba" in buffers:
        buffers["rgb"] = SimpleNamespace(warp=buffers["rgba"].warp[:, :, :, :3], torch=None)
    renderer.set_outputs(data, buffers)
    look(renderer, data, device)
    output = SimpleNamespace(info={}, output=buffers)
    renderer.render(data)
    renderer.read_output(data, output)
    return {name: proxy.warp.numpy().copy() for name, proxy in buffers.items()}, renderer, data, output


def look(renderer: Any, data: Any, device: Any, wider: float = 1.0) -> None:
    """From ``EYE`` to the ball; along +x with z up is what Isaac Lab calls straight ahead."""
    w, x, y, z = scenes.looking(EYE, (0.0, 0.0, 0.8))
    forward = wp.quat(float(x), float(y), float(z), float(w)) * wp.quat_inverse(wp.quat(0.5, -0.5, -0.5, 0.5))
    focal = np.array([30.0, 30.0 / wider])
    matrices = np.zeros((NUM_ENVS, 3, 3), np.float32)
    matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 0, 2], matrices[:, 1, 2] = focal, focal, 15.0, 13.0
    matrices[:, 2, 2] = 1.0
    renderer.update_camera(
        data,
        proxies(np.tile(np.array(EYE, np.float32), (NUM_ENVS, 1)), wp.vec3, device),
        proxies(np.tile(np.array(list(forward), np.float32), (NUM_ENVS, 1)), wp.quat, device),
        proxies(matrices, wp.mat33, device),
    )


def nearly(found: np.ndarray, expected: np.ndarray, most: float) -> bool:
    return bool(np.isclose(found.astype(float), expected, rtol=1e-3, atol=most).mean() > 0.995)


def renderer_ids(data: Any) -> np.ndarray:
    return data.renderer.array("camera", "segmentation").numpy()[..., 0]


def test_all_data_types(simulation: Any) -> None:
    offered = [str(kind) for kind in ours.WarpcamRendererCfg().supported_output_types()]
    wanted = [kind for kind in offered if not kind.startswith("simple_shading")]
    images, renderer, data, output = frame(simulation, wanted)
    model = simulation.backend.model
    scene = wc.from_newton(model, simulation.backend.state_0)
    camera = wc.Camera(
        "eye", width=WIDTH, height=HEIGHT, lens=wc.Pinhole(fx=30.0, cx=15.0, cy=13.0), position=EYE,
        rotation=scenes.looking(EYE, (0.0, 0.0, 0.8)), near=0.05, far=50.0, background=(0xEE / 255.0,) * 3,
        outputs=("rgb", "hdr", "depth", "distance", "normals", "segmentation", "albedo"),
    )  # fmt: skip
    direct = {name: image.cpu().numpy() for name, image in wc.Renderer(scene, [camera]).render()["eye"].items()}
    # The camera's axes are turned on the way, and with them the last digits.
    assert nearly(images["rgba"][..., :3], direct["rgb"], 1.0) and nearly(images["rgb"], direct["rgb"], 1.0)
    assert (images["rgba"][..., 3] == 255).all() and (images["albedo"][..., 3] == 255).all()
    assert nearly(images["albedo"][..., :3], direct["albedo"], 1.0)
    for theirs, mine in (
        ("rgb_hdr", "hdr"), ("depth", "depth"), ("distance_to_image_plane", "depth"), ("normals", "normals"),
        ("distance_to_camera", "distance"),
    ):  # fmt: skip
        assert nearly(images[theirs], direct[mine], 1e-3), theirs
    shapes = renderer_ids(data)
    assert nearly(shapes, direct["segmentation"][..., 0], 0.0)
    assert len(np.unique(shapes)) > 2
    names = output.info["instance_id_segmentation_fast"]["idToLabels"]
    for shape in np.unique(shapes[shapes >= 0]):
        color = tuple(int(part) for part in images["instance_id_segmentation_fast"][shapes == shape][0])
        assert names[color] == model.shape_label[shape]
        packed = images["semantic_segmentation"].view(np.uint32)[..., 0][shapes == shape]
        assert (packed == 0xFF000002 + int(shape)).all()
    assert (images["instance_segmentation"][shapes < 0] == 0).all()
    assert renderer.supported_output_types()[RenderBufferKind.RGBA].channels == 4


def test_ids_clipping_and_lenses_of_each_environment(simulation: Any) -> None:
    settings = {"colorize_instance_id_segmentation": False, "colorize_semantic_segmentation": False}
    kinds = ["depth", "distance_to_camera", "instance_id_segmentation_fast", "semantic_segmentation"]
    for behaviour, beyond in (("max", 50.0), ("zero", 0.0), ("none", np.inf)):
        images, renderer, data, _ = frame(simulation, kinds, depth_clipping_behavior=behaviour, **settings)
        miss = images["instance_id_segmentation_fast"] == 0
        assert miss.any() and (images["depth"][miss] == beyond).all()
        assert (images["distance_to_camera"][miss] == beyond).all()
    assert images["instance_id_segmentation_fast"].dtype == np.int32
    np.testing.assert_array_equal(images["instance_id_segmentation_fast"], images["semantic_segmentation"])
    before = [(image == 3 + world).sum() for world, image in enumerate(images["instance_id_segmentation_fast"])]
    look(renderer, data, simulation.backend.model.device, wider=2.0)
    renderer.render(data)
    after = data.renderer.array("camera", "segmentation").numpy()
    assert (after[0] == 1).sum() == before[0] and (after[1] == 2).sum() < 0.5 * before[1]


def test_frames_follow_the_state(simulation: Any) -> None:
    images, renderer, data, output = frame(simulation, ["depth"])
    state = simulation.backend.state_0
    moved = state.body_q.numpy()
    moved[:, 2] += 0.3
    state.body_q.assign(moved)
    renderer.render(data)
    assert (output.output["depth"].warp.numpy() != images["depth"]).any()
    renderer.cleanup(data)
    renderer.close()


def test_motion_vectors(simulation: Any) -> None:
    """Positive towards the left and the top, in pixels."""
    _, renderer, data, output = frame(simulation, ["motion_vectors", "distance_to_camera"])
    renderer.render(data)
    assert (output.output["motion_vectors"].warp.numpy() == 0.0).all()
    state = simulation.backend.state_0
    moved = state.body_q.numpy()
    moved[:, 0] += 0.05
    moved[:, 2] += 0.05
    state.body_q.assign(moved)
    renderer.render(data)
    vectors = torch.as_tensor(output.output["motion_vectors"].warp.numpy())
    moving = vectors.abs().amax(dim=-1) > 0.1
    assert moving.any() and (vectors[moving][:, 0] < 0.0).all() and (vectors[moving][:, 1] > 0.0).all()
    moved[:, 0] += 0.05
    state.body_q.assign(moved)
    renderer.reset(data, [1])
    renderer.render(data)
    after = output.output["motion_vectors"].warp.numpy()
    assert (after[0] != 0.0).any() and (after[1] == 0.0).all()


def calibrated(model: str, **numbers: Any) -> Any:
    """A camera's spawn with a calibration of an image twice the size."""
    pixels = {"fx": 50.0, "fy": 52.0, "cx": 31.0, "cy": 23.0, "image_size": (2 * WIDTH, 2 * HEIGHT)}
    terms = dict.fromkeys(("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4"), 0.0)
    settings = {"model": model, "apply_lens_distortion": True, "max_fov": np.pi} | pixels | terms | numbers
    return SimpleNamespace(clipping_range=(0.05, 50.0), distortion=SimpleNamespace(**settings))


def test_calibrated_lenses_are_newtons(simulation: Any) -> None:
    """The rays are those of the helpers that Isaac Lab's own Newton renderer calls."""
    from warpcam.compat.isaaclab.lenses import lens_of

    utils = newton.sensors.SensorTiledCamera(simulation.backend.model).utils
    pixels = {"image_width": 2.0 * WIDTH, "image_height": 2.0 * HEIGHT}
    for model, helper, numbers in (
        ("opencvFisheye", utils.compute_camera_rays_fisheye_opencv, {"k1": 0.05, "k2": -0.01}),
        ("opencvPinhole", utils.compute_camera_rays_pinhole_opencv, {"k1": -0.1, "p1": 0.01, "s2": 0.002, "k4": 0.01}),
    ):
        theirs = helper(WIDTH, HEIGHT, 50.0, 52.0, 31.0, 23.0, **numbers, **pixels).numpy()
        theirs = theirs.reshape(HEIGHT, WIDTH, -1, 2, 3)[:, :, 0, 1]
        mine = lens_of(calibrated(model, **numbers), WIDTH, HEIGHT).rays(WIDTH, HEIGHT, 1, "lens")[0]
        np.testing.assert_allclose(mine / np.linalg.norm(mine, axis=-1, keepdims=True), theirs, atol=1e-4)
        plain = lens_of(calibrated(model, apply_lens_distortion=False, **numbers), WIDTH, HEIGHT)
        assert np.abs(plain.rays(WIDTH, HEIGHT, 1, "lens")[0] - mine).max() > 1e-3


def test_fisheye_cameras(simulation: Any) -> None:
    kinds = ["rgba", "depth", "distance_to_camera"]
    narrow = frame(simulation, kinds)[0]
    wide = frame(simulation, kinds, calibrated("opencvFisheye", fx=18.0, fy=18.0))[0]
    ball = [np.isclose(one["rgba"][0, ..., :3].astype(int).argmax(axis=-1), 0).sum() for one in (narrow, wide)]
    assert 0 < ball[1] != ball[0]
    hit = np.isfinite(wide["depth"])
    assert hit.any() and (wide["depth"][hit] <= wide["distance_to_camera"][hit] * (1.0 + 1e-6)).all()
    numbers = {f"fisheye_polynomial_{base}": 0.0 for base in "acdef"} | {"fisheye_polynomial_b": 0.02}
    polynomial = SimpleNamespace(
        clipping_range=(0.05, 50.0), distortion=None, projection_type="fisheyePolynomial", fisheye_nominal_width=64.0,
        fisheye_nominal_height=48.0, fisheye_optical_centre_x=32.0, fisheye_optical_centre_y=24.0,
        fisheye_max_fov=100.0, **numbers,
    )  # fmt: skip
    equal = SimpleNamespace(
        **{**vars(calibrated("opencvFisheye", fx=50.0, fy=50.0, cx=32.0, cy=24.0, max_fov=np.radians(100.0)))}
    )
    seen = [frame(simulation, kinds, spawn)[0] for spawn in (polynomial, equal)]
    for kind in kinds:
        np.testing.assert_allclose(seen[0][kind], seen[1][kind], atol=1e-4, err_msg=kind)
    _, renderer, data, _ = frame(simulation, kinds, polynomial)
    with pytest.raises(wc.WarpcamError, match=r"set_intrinsic_matrices: .*projection_type is 'fisheyePolynomial'"):
        renderer.update_camera_intrinsics(data, *[wp.zeros(NUM_ENVS, dtype=wp.mat33)] * 2)
    polynomial.projection_type = "fisheyeSpherical"
    with pytest.raises(wc.WarpcamError, match="projection_type is 'fisheyeSpherical'; allowed are 'pinhole'"):
        frame(simulation, kinds, polynomial)
    with pytest.raises(wc.WarpcamError, match="motion_vectors are not offered for fisheye"):
        frame(simulation, ["motion_vectors"], equal)


def test_polynomials_are_of_nominal_pixels() -> None:
    from warpcam.compat.isaaclab.lenses import lens_of

    polynomial = (0.0, 0.016, 3e-4, -4e-6, 0.0, 1e-9)
    numbers = {f"fisheye_polynomial_{base}": value for base, value in zip("abcdef", polynomial, strict=True)}
    spawn = SimpleNamespace(
        distortion=None, projection_type="fisheyePolynomial", fisheye_nominal_width=90.0, fisheye_nominal_height=48.0,
        fisheye_optical_centre_x=44.0, fisheye_optical_centre_y=25.0, fisheye_max_fov=110.0, **numbers,
    )  # fmt: skip
    rays = lens_of(spawn, WIDTH, HEIGHT).rays(WIDTH, HEIGHT, 1, "lens")[0]
    column, row = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH * 90.0, (np.arange(HEIGHT) + 0.5) / HEIGHT * 48.0)
    x, y = column - 44.0, 25.0 - row
    radius = np.hypot(x, y)
    angle = np.polynomial.polynomial.polyval(radius, polynomial)
    expected = np.stack([np.sin(angle) * x / radius, np.sin(angle) * y / radius, -np.cos(angle)], axis=-1)
    seen = angle <= np.radians(55.0)
    assert 0.3 < seen.mean() < 1.0
    np.testing.assert_allclose(rays, np.where(seen[..., None], expected, 0.0), atol=1e-9)


def hang_cloth(simulation: Any) -> None:
    """In place of what there is, in each environment a red and a blue triangle."""
    builder = newton.ModelBuilder()
    for _ in range(NUM_ENVS):
        part = newton.ModelBuilder()
        part.add_cloth_mesh(
            pos=wp.vec3(0.0, 0.0, 0.8), rot=wp.quat_identity(), scale=1.0, vel=wp.vec3(0.0), density=1.0,
            vertices=[wp.vec3(x, 0.0, z) for x in (-0.5, 0.5) for z in (-0.5, 0.5)], indices=[0, 2, 1, 1, 2, 3],
        )  # fmt: skip
        builder.add_world(part)
    model = builder.finalize(device=simulation.backend.model.device)
    model.tri_color.assign(np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0)] * NUM_ENVS, np.float32))
    simulation.backend.model, simulation.backend.state_0 = model, model.state()


@pytest.mark.parametrize("colorize", [True, False])
def test_what_is_no_shape_has_a_name(simulation: Any, colorize: bool) -> None:
    hang_cloth(simulation)
    kind = "instance_id_segmentation_fast"
    images, *_, output = frame(simulation, [kind], colorize_instance_id_segmentation=colorize)
    names, pixels = output.info[kind]["idToLabels"], images[kind].reshape(-1, 4 if colorize else 1).tolist()
    assert {names[tuple(pixel) if colorize else pixel[0]] for pixel in pixels} == {"BACKGROUND", "UNLABELLED"}


def test_colours_of_cloth_are_no_textures(simulation: Any) -> None:
    """Each triangle has its own, whether textures are shown or not."""
    hang_cloth(simulation)
    images = [frame(simulation, ["albedo"], enable_textures=shown)[0]["albedo"] for shown in (True, False)]
    np.testing.assert_array_equal(*images)
    assert {(255, 0, 0, 255), (0, 0, 255, 255)} <= set(map(tuple, images[0].reshape(-1, 4).tolist()))


def test_everything_is_in_focus(simulation: Any, caplog: Any) -> None:
    spawn = SimpleNamespace(clipping_range=(0.05, 50.0), distortion=None, f_stop=0.0, focus_distance=1.0)
    assert np.isfinite(frame(simulation, ["depth"], spawn)[0]["depth"]).any() and "f_stop" not in caplog.text
    spawn.f_stop = 2.8
    assert np.isfinite(frame(simulation, ["depth"], spawn)[0]["depth"]).any()
    assert "CameraCfg.spawn.f_stop is 2.8, which is not drawn: everything is in focus" in caplog.text


def test_a_camera_for_its_pose_alone(simulation: Any) -> None:
    """A camera need not have images, as with Isaac Lab's own renderer."""
    images, renderer, data, output = frame(simulation, [])
    assert images == {} and output.info == {} and data.renderer is None
    renderer.reset(data, [1])
    renderer.update_camera_intrinsics(data, wp.zeros(NUM_ENVS, dtype=wp.mat33), None)


@pytest.mark.parametrize("authored", ["model", "schema", "projection"])
def test_a_lens_that_only_the_stage_knows_is_told(simulation: Any, authored: str, caplog: Any) -> None:
    pytest.importorskip("pxr")
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    prim = UsdGeom.Camera.Define(stage, "/eye").GetPrim()
    spec = SimpleNamespace(cfg=SimpleNamespace(spawn=None), camera_prim_paths=("/eye",))
    renderer = ours.WarpcamRenderer(ours.WarpcamRendererCfg())
    renderer.prepare_cameras(stage, spec)
    assert not caplog.records
    token = Sdf.ValueTypeNames.Token
    if authored == "model":
        prim.CreateAttribute("omni:lensdistortion:model", token).Set("opencvFisheye")
    elif authored == "schema":
        schemas = Sdf.TokenListOp.CreateExplicit(["OmniLensDistortionOpenCvFisheyeAPI"])
        prim.SetMetadata("apiSchemas", schemas)
    else:
        prim.CreateAttribute("cameraProjectionType", token).Set("fisheyePolynomial")
    renderer.prepare_cameras(stage, spec)
    assert "camera /eye has the lens" in caplog.text and "say it in CameraCfg.spawn" in caplog.text
    caplog.clear()
    spec.cfg.spawn = SimpleNamespace(distortion=SimpleNamespace() if authored != "projection" else None)
    renderer.prepare_cameras(stage, spec)
    assert not caplog.records


def test_it_is_known_by_name_and_refuses_by_name(simulation: Any) -> None:
    cfg = ours.WarpcamRendererCfg()
    assert cfg.renderer_type == "warpcam"
    with pytest.raises(wc.WarpcamError, match="not initialized"):
        ours.WarpcamRenderer(cfg).create_render_data(SimpleNamespace())
    images, renderer, data, _ = frame(simulation, ["depth"])
    del images
    buffer = SimpleNamespace(warp=wp.zeros((NUM_ENVS, HEIGHT, WIDTH, 3)))
    with pytest.raises(wc.WarpcamError, match="simple_shading_full_mdl: the camera was made without it"):
        renderer.set_outputs(data, {"simple_shading_full_mdl": buffer})


def test_only_cameras_take_a_renderer() -> None:
    sensors = pytest.importorskip("isaaclab.sensors", reason=HOW, exc_type=ImportError)
    kinds = {name: getattr(sensors, name) for name in dir(sensors) if name.endswith("Cfg")}
    taking = {name for name, kind in kinds.items() if "renderer_cfg" in getattr(kind, "__dataclass_fields__", {})}
    assert taking == {"CameraCfg", "TiledCameraCfg"} and "RayCasterCfg" in kinds
