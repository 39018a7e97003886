"""Labels of several worlds and cameras: groups of shapes, boxes, poses, chosen worlds, captures, bad arguments."""

import gc
import re
from typing import Any

import label_reference
import mujoco
import newton
import newton_scenes
import numpy as np
import pytest
import scenes
import small_scene
import splat_scenes
import torch
import warp as wp
from allocation_ledger import Ledger

import warpcam as wc

WORLDS = 3
OUTPUTS = ("segmentation", "bodies", "semantics", "depth")
BODIES = """
<geom type="plane" size="0 0 1"/>
<camera name="above" pos="0 0 6"/>
<body name="group" pos=".3 .2 1" euler="20 30 40">
  <geom type="capsule" size=".2 .3" pos=".5 .1 0" euler="30 60 10"/>
  <geom type="ellipsoid" size=".1 .2 .4" pos="-.2 .3 .1" euler="80 20 30"/>
  <geom type="cylinder" size=".2 .3" pos="0 -.4 .2" euler="10 50 70"/>
</body>
<body name="block" pos="-1 0 1"><geom type="box" size=".1 .2 .3" euler="0 0 30"/><geom size=".2" pos="0 0 .4"/></body>
<body name="wedge" pos="1 -1 1"><geom type="mesh" mesh="mesh" euler="0 30 0"/></body>
<body name="hidden" pos="0 0 2"><geom size=".3" rgba="1 1 1 0"/></body>
"""


def says(text: str) -> Any:
    return pytest.raises(wc.WarpcamError, match=re.escape(text))


def drawn(device: wp.Device, worlds: int = WORLDS, **options: Any) -> wc.Renderer:
    scene = small_scene.scene_of(device, worlds)
    settings = {"outputs": OUTPUTS} | options
    cameras = [small_scene.camera("top", 80, 72, **settings), small_scene.camera("side", **settings)]
    renderer = wc.Renderer(scene, cameras)
    renderer.render()
    return renderer


def own_images(renderer: wc.Renderer, output: str) -> dict[Any, np.ndarray]:
    return {key: images[output][..., 0].cpu().numpy().copy() for key, images in renderer.images.items()}


def test_bodies_of_worlds_in_two_cameras(device: wp.Device) -> None:
    scene = small_scene.scene_of(device, WORLDS)
    alone = label_reference.AloneImages(scene)
    cameras = [
        small_scene.camera("top", 80, 72, outputs=OUTPUTS),
        small_scene.camera("side", outputs=OUTPUTS, exclude_bodies=(2,)),
    ]
    renderer = wc.Renderer(scene, cameras)
    renderer.render()
    images = own_images(renderer, "bodies")
    labels = wc.labels(renderer)
    assert labels.output == "bodies" and labels.ids.tolist() == [[0, 1, 2]] * WORLDS
    read = {key: label_reference.on_host(found) for key, found in labels.read().items()}
    owners = scene.shape_bodies()[0]
    masks = alone.masks(renderer, [np.flatnonzero(owners == body) for body in range(3)], "bodies")
    slack = 0 if device.is_cpu else 1
    for key, found in read.items():
        seen = np.stack([images[key] == body for body in range(3)])
        for kind, expected in (("amodal", masks[key]), ("visible", seen)):
            boxes, pixels = label_reference.extents(expected)
            assert np.abs(found[f"{kind}_pixels"] - pixels.T).max() <= slack
            assert np.abs(found[f"{kind}_boxes"] - boxes.swapaxes(0, 1)).max() <= slack
    assert read["side"]["amodal_pixels"][:, 2].max() == 0 < read["top"]["amodal_pixels"][:, 2].min()
    assert len(np.unique(read["top"]["visible_boxes"][:, 1], axis=0)) == WORLDS
    assert labels.read()["top"].visible_boxes is labels.cameras["top"].visible_boxes


def test_poses_and_boxes_follow_bodies(device: wp.Device) -> None:
    mjm = scenes.compile_xml(BODIES, assets=scenes.ASSETS)
    scene = wc.from_mujoco(mjm, (mjd := scenes.forward(mjm)), device=device)
    renderer = wc.Renderer(scene, [small_scene.camera("above", outputs=("bodies",))])
    renderer.render()
    found = label_reference.on_host(wc.labels(renderer, amodal=False).read()["above"])
    assert (found["amodal_boxes"] == -1).all() and (found["amodal_pixels"] == -1).all()
    assert np.isnan(found["visibility"]).all() and not found["truncated"].any()
    camera = mjd.cam_xmat[0].reshape(3, 3)
    for body in range(mjm.nbody):
        position = camera.T @ (mjd.xpos[body] - mjd.cam_xpos[0])
        np.testing.assert_allclose(found["positions"][0, body], position, atol=1e-5)
        matrix = scenes.matrix(found["rotations"][0, body])
        np.testing.assert_allclose(matrix, camera.T @ mjd.xmat[body].reshape(3, 3), atol=1e-5)
        assert found["rotations"][0, body, 0] >= 0.0
    centers, halves = found["box_centers"][0], found["half_extents"][0]
    for name in ("group", "block"):
        points = np.concatenate([surface(mjm, geom) for geom in geoms_of(mjm, name)])
        body = mjm.body(name).id
        low, high = points.min(axis=0), points.max(axis=0)
        np.testing.assert_allclose(centers[body], 0.5 * (low + high), atol=2e-3)
        np.testing.assert_allclose(halves[body], 0.5 * (high - low), atol=2e-3)
    wedge = mjm.body("wedge").id
    (geom,) = geoms_of(mjm, "wedge")
    corners = mjm.mesh_vert @ scenes.matrix(mjm.geom_quat[geom]).T + mjm.geom_pos[geom]
    np.testing.assert_allclose(centers[wedge], 0.5 * (corners.min(axis=0) + corners.max(axis=0)), atol=1e-5)
    np.testing.assert_allclose(halves[wedge], 0.5 * (corners.max(axis=0) - corners.min(axis=0)), atol=1e-5)
    assert np.isinf(halves[0]).all() and np.isnan(found["corners"][0, 0]).all()
    ids = wc.labels(renderer, amodal=False).ids[0].tolist()
    hidden = ids.index(mjm.body("hidden").id)
    assert np.isnan(halves[hidden]).all() and found["visible_pixels"][0, hidden] == 0


def test_a_mesh_that_is_turned_on_its_body_stays_in_its_box(device: wp.Device) -> None:
    mjm = scenes.compile_xml(BODIES, assets=scenes.ASSETS)
    with wp.ScopedDevice(device):
        m, d = scenes.put(mjm, 2)
    scene = wc.from_mujoco_warp(mjm, m, d)
    renderer = wc.Renderer(scene, [small_scene.camera("above", outputs=("bodies",))])
    labels, wedge, (geom,) = wc.labels(renderer, amodal=False), mjm.body("wedge").id, geoms_of(mjm, "wedge")
    turned = scenes.matrix((0.9, 0.3, -0.2, 0.1))
    scenes.write(d.geom_xmat, (1, geom), turned)
    renderer.render()
    found = label_reference.on_host(labels.read()["above"])
    axes = d.xmat.numpy()[:, wedge].reshape(2, 3, 3)
    for world in range(2):
        places = mjm.mesh_vert @ d.geom_xmat.numpy()[world, geom].reshape(3, 3).T + d.geom_xpos.numpy()[world, geom]
        corners = (places - d.xpos.numpy()[world, wedge]) @ axes[world] - found["box_centers"][world, wedge]
        gap = found["half_extents"][world, wedge] - np.abs(corners).max(axis=0)
        assert (gap > -1e-5).all() and (world == 1 or (gap < 1e-5).all())


def geoms_of(mjm: mujoco.MjModel, body: str) -> np.ndarray:
    return np.flatnonzero(mjm.geom_bodyid == mjm.body(body).id)


def surface(mjm: mujoco.MjModel, geom: int) -> np.ndarray:
    """Points all over a geom's surface, in the body's frame."""
    around, up = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 181), np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181))
    ball = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], -1).reshape(-1, 3)
    size, kind = mjm.geom_size[geom], mujoco.mjtGeom(mjm.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        points = size[0] * ball + np.sign(ball[:, 2:]) * (0.0, 0.0, size[1])
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        ring = np.stack([np.cos(around[0]), np.sin(around[0]), np.ones(181)], axis=-1) * (size[0], size[0], size[1])
        points = np.concatenate([ring, ring * (1.0, 1.0, -1.0)])
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        points = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * size
    else:
        points = ball * (size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[0])
    return points @ scenes.matrix(mjm.geom_quat[geom]).T + mjm.geom_pos[geom]


def test_chosen_worlds_alone_are_labelled(device: wp.Device) -> None:
    renderer = drawn(device)
    labels = wc.labels(renderer, cameras=["top"])
    before = label_reference.on_host(labels.read()["top"])
    assert set(labels.cameras) == {"top"}
    shapes = renderer.scene.array("shape_positions")
    scenes.write(shapes, (slice(None), 0, 1), shapes.numpy()[:, 0, 1] + 0.7)
    renderer.render()
    after = label_reference.on_host(labels.read(worlds=[1])["top"])
    assert (after["visible_boxes"][1] != before["visible_boxes"][1]).any()
    for name, values in after.items():
        np.testing.assert_array_equal(values[[0, 2]], before[name][[0, 2]], err_msg=name)
    whole = label_reference.on_host(labels.read()["top"])
    mask = torch.zeros(WORLDS, dtype=torch.uint8, device=labels.ids.device)
    np.testing.assert_array_equal(label_reference.on_host(labels.read(mask)["top"])["corners"], whole["corners"])
    assert (whole["amodal_boxes"][0] != before["amodal_boxes"][0]).any()


def test_what_is_no_number_costs_its_instance(device: wp.Device) -> None:
    renderer = drawn(device)
    labels = wc.labels(renderer, by="shape")
    before = label_reference.on_host(labels.read()["top"])
    scenes.write(renderer.scene.array("shape_positions"), (1, 0), np.nan)
    renderer.render()
    after = label_reference.on_host(labels.read()["top"])
    for name, values in after.items():
        np.testing.assert_array_equal(values[[0, 2]], before[name][[0, 2]], err_msg=name)
    assert not after["visible_pixels"][1].any() and not after["visibility"][1].any()
    for name in ("amodal_boxes", "amodal_pixels", "truncated"):
        assert not after[name][1, 0].any()
        np.testing.assert_array_equal(after[name][1, 1:], before[name][1, 1:])
    for name in ("positions", "rotations", "box_centers", "half_extents", "corners", "centers", "depths"):
        assert np.isnan(after[name][1, 0]).all(), name


def test_some_ids_and_groups_of_shapes(device: wp.Device) -> None:
    renderer = drawn(device, worlds=2)
    scene = renderer.scene
    all_of = label_reference.on_host(wc.labels(renderer, by="shape").read()["top"])
    some = wc.labels(renderer, by="shape", ids=[2, 0])
    assert some.ids.tolist() == [[0, 2]] * 2
    for name, values in label_reference.on_host(some.read()["top"]).items():
        np.testing.assert_array_equal(values, all_of[name] if "key" in name else all_of[name][:, [0, 2]], err_msg=name)
    with says("labels: by='semantic': no shape of the scene is part of such an instance"):
        wc.labels(renderer, by="semantic")
    scene._parts.__dict__["shape_semantics"] = np.array((7, 0, 7), np.int32)  # of the ball and the box below
    scene._labels["semantics"].assign(np.array([[7, 0, 7]], np.int32))
    renderer.render()
    group = wc.labels(renderer, by="semantic")
    assert group.ids.tolist() == [[7]] * 2
    found = label_reference.on_host(group.read()["top"])
    image = own_images(renderer, "semantics")["top"]
    np.testing.assert_array_equal(found["visible_pixels"][:, 0], (image == 7).sum(axis=(1, 2)))
    assert (found["amodal_pixels"][:, 0] >= all_of["amodal_pixels"][:, 2]).all()
    # the group is on two bodies: its frame is the world's
    height = renderer.camera("top").near.new_tensor(5.0).item()
    np.testing.assert_allclose(found["positions"][:, 0], [(0.0, 0.0, -height)] * 2, atol=1e-6)


def test_worlds_of_newton_have_ids_of_their_own(device: wp.Device) -> None:
    one = newton.ModelBuilder()
    one.add_shape_sphere(one.add_body(xform=newton_scenes.pose(0.0, 0.0, 1.0)), radius=0.3)
    one.add_shape_box(one.add_body(xform=newton_scenes.pose(0.5, 0.0, 0.5)), hx=0.2, hy=0.2, hz=0.2)
    mesh, scale, turn = newton_scenes.tetrahedron(), np.array((-1.0, 1.3, 0.7)), np.array((0.3, -0.2, 0.4, 0.8))
    body = one.add_body(xform=newton_scenes.pose(-0.6, 0.0, 0.5, (0.1, 0.5, 0.2, 0.8)))
    one.add_shape_mesh(body, mesh=mesh, scale=tuple(scale), xform=newton_scenes.pose(0.1, 0.0, 0.0, turn))
    other = newton.ModelBuilder()
    other.add_shape_box(other.add_body(xform=newton_scenes.pose(-0.5, 0.0, 0.5)), hx=0.2, hy=0.3, hz=0.2)
    both = newton.ModelBuilder()
    both.add_world(one)
    both.add_world(other)
    scene = wc.from_newton(*newton_scenes.finalize(both, device))
    renderer = wc.Renderer(scene, [newton_scenes.eye(outputs=("bodies", "instances"))])
    renderer.render()
    image, things = (own_images(renderer, output)["eye"] for output in ("bodies", "instances"))
    labels = wc.labels(renderer)
    assert labels.ids.tolist() == [[0, 1, 2], [3, -1, -1]]
    found = label_reference.on_host(labels.read()["eye"])
    expected = [[(image[0] == body).sum() for body in range(3)], [(image[1] == 3).sum(), 0, 0]]
    assert found["visible_pixels"].tolist() == expected and min(expected[0]) > 20
    assert found["amodal_pixels"][1].tolist() == expected[1]
    instances = wc.labels(renderer, by="instance")
    of_things = label_reference.on_host(instances.read()["eye"])
    for world, ids in enumerate(instances.ids.tolist()):
        seen = [(things[world] == thing).sum() if thing >= 0 else 0 for thing in ids]
        assert of_things["visible_pixels"][world].tolist() == seen and sum(seen) == sum(expected[world])
    np.testing.assert_allclose(found["half_extents"][:, 0], [(0.3, 0.3, 0.3), (0.2, 0.3, 0.2)], atol=1e-6)
    corners = (mesh.vertices * scale) @ scenes.matrix(turn[[3, 0, 1, 2]]).T + (0.1, 0.0, 0.0)
    low, high = corners.min(axis=0), corners.max(axis=0)
    np.testing.assert_allclose(found["half_extents"][0, 2], 0.5 * (high - low), atol=1e-5)
    np.testing.assert_allclose(found["box_centers"][0, 2], 0.5 * (high + low), atol=1e-5)
    assert all(np.isnan(found[name][1, 1]).all() for name in ("positions", "rotations", "corners", "depths"))


@pytest.mark.parametrize(("width", "height"), [(40, 32), (1024, 24)])
def test_more_shapes_and_pixels_than_are_listed_at_once(width: int, height: int, device: wp.Device) -> None:
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (1100, 3))
    places[-1] = 1.4, 0.0, 0.0  # apart from the others: it makes the box wider
    balls = "".join(f'<geom size=".1" pos="{x:.3f} {y:.3f} {z:.3f}"/>' for x, y, z in places)
    mjm = scenes.compile_xml(f'<camera name="top" pos="0 0 4"/>{balls}')
    camera = small_scene.camera("top", width, height, outputs=("bodies",))
    renderer = wc.Renderer(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), [camera])
    image = renderer.render()["top"]["bodies"].cpu().numpy()
    found = label_reference.on_host(wc.labels(renderer).read()["top"])
    boxes, pixels = label_reference.extents(image[None, ..., 0] == 0)
    assert found["amodal_pixels"][0, 0] == pixels[0, 0] and 100 < pixels[0, 0] < image.size
    np.testing.assert_array_equal(found["amodal_boxes"][0, 0], boxes[0, 0])


def test_reads_allocate_and_compile_nothing(
    device: wp.Device, loads: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer = drawn(device)
    labels = wc.labels(renderer, masks=True, keypoints={"ball": (1, (0.0, 0.0, 0.6))})
    labels.read()
    loads.clear()
    slot = "current_allocator" if device.is_cuda else "default_allocator"
    ledger = Ledger(getattr(device, slot))
    monkeypatch.setattr(device, slot, ledger)
    places = [value.data_ptr() for found in labels.cameras.values() for value in vars(found).values()]
    for _ in range(2):
        read = labels.read()
        assert [value.data_ptr() for found in read.values() for value in vars(found).values()] == places
    gc.collect()
    assert ledger.held == 0 and loads == []


def test_labels_of_a_captured_graph(device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("needs CUDA")
    renderer = drawn(device)
    labels = wc.labels(renderer, keypoints={"ball": (1, (0.0, 0.0, 0.6))})
    with wp.ScopedCapture(device=device) as capture:
        renderer.render()
        labels.read()
    shapes = renderer.scene.array("shape_positions")
    scenes.write(shapes, (slice(None), 0, 1), shapes.numpy()[:, 0, 1] + 0.7)
    wp.capture_launch(capture.graph)
    replayed = {key: label_reference.on_host(found) for key, found in labels.cameras.items()}
    renderer.render()
    for key, found in labels.read().items():
        for name, values in label_reference.on_host(found).items():
            np.testing.assert_array_equal(replayed[key][name], values, err_msg=name)


def test_bad_arguments(device: wp.Device) -> None:
    renderer = drawn(device, worlds=1, outputs=("bodies", "rgb"))
    with says("labels: renderer must be a Renderer, got str"):
        wc.labels("top")  # type: ignore[arg-type]
    with says("labels: by must be one of 'body', 'shape', 'instance', 'semantic', got 'geom'"):
        wc.labels(renderer, by="geom")  # type: ignore[arg-type]
    with says("labels: camera 'top' needs the output 'segmentation', it has bodies, rgb"):
        wc.labels(renderer, by="shape")
    with says("labels: ids has 9; by='body' there are 0, 1, 2"):
        wc.labels(renderer, ids=[1, 9])
    for ids in ([], 1, "1", [0.5], [True]):
        with says(f"labels: ids must be whole numbers, (n,) with n >= 1, or None, got {ids!r}"):
            wc.labels(renderer, ids=ids)  # type: ignore[arg-type]
    with says("labels: cameras has 'front', the renderer has 'top', 'side'"):
        wc.labels(renderer, ["front"])
    with says("labels: cameras has 'top' more than once"):
        wc.labels(renderer, ["top", "top"])
    with says("labels: cameras must be names of some of 'top', 'side', or None for all, got 'top'"):
        wc.labels(renderer, "top")
    with says("labels: amodal must be True or False, got 1"):
        wc.labels(renderer, amodal=1)  # type: ignore[arg-type]
    for tolerance in (-0.1, np.inf, np.nan, "1", True):
        with says(f"labels: tolerance must be a finite number of at least 0 [m], got {tolerance!r}"):
            wc.labels(renderer, tolerance=tolerance)  # type: ignore[arg-type]
    with says("labels: the scene has Gaussian splats, of which there are no labels"):
        builder = newton.ModelBuilder()
        builder.add_shape_gaussian(-1, gaussian=splat_scenes.gaussians([(0.0, 0.0, 0.0)], [(1.0, 0.0, 0.0)]))
        wc.labels(wc.Renderer(wc.from_newton(*newton_scenes.finalize(builder, device)), [scenes.own_camera()]))
    labels = wc.labels(renderer, amodal=False)
    with says("Labels.read: worlds has id 5; allowed are 0 to 0"):
        labels.read([5])
    with says("Labels: it cannot be copied or pickled"):
        labels.__reduce__()


def test_amodal_masks(device: wp.Device) -> None:
    scene = small_scene.scene_of(device, WORLDS)
    alone = label_reference.AloneImages(scene)
    cameras = [small_scene.camera("top", 90, 72, outputs=OUTPUTS), small_scene.camera("side", outputs=OUTPUTS)]
    renderer = wc.Renderer(scene, cameras)
    renderer.render()
    labels = wc.labels(renderer, masks=True)
    assert wc.labels(renderer).cameras["top"].amodal_masks is None
    owners = scene.shape_bodies()[0]
    expected = alone.masks(renderer, [np.flatnonzero(owners == body) for body in range(3)], "bodies")
    for found in (labels.read(), labels.read()):  # masks are cleared before they are written
        for key, one in found.items():
            masks = one.amodal_masks.cpu().numpy()
            assert masks.dtype == np.uint8 and masks.max() == 1
            assert (masks != expected[key].swapaxes(0, 1)).sum() <= (0 if device.is_cpu else 3)
            np.testing.assert_array_equal(masks.sum(axis=(2, 3)), one.amodal_pixels.cpu().numpy())
    labels.read()["top"].amodal_masks.fill_(7)
    labels.read([1])
    assert labels.cameras["top"].amodal_masks.amax(dim=(1, 2, 3)).tolist() == [7, 1, 7]
    with says("masks must be False where amodal is, got True"):
        wc.labels(renderer, amodal=False, masks=True)
    with says("masks must be True or False, got 1"):
        wc.labels(renderer, masks=1)
