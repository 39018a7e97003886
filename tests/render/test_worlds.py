"""Worlds do not know of each other, and what a frame shows depends on nothing but the state."""

import mujoco
import numpy as np
import pytest
import scenes
import torch
import warp as wp

import warpcam as wc

OUTPUTS = ("depth", "segmentation", "normals", "rgb")
WORLDS = 6
LIGHT = '<light pos="0 0 4" dir="0 0 -1"/>'
EYE = '<camera name="scene" pos="0 -2.5 1" xyaxes="1 0 0 0 0.4 1" fovy="60"/>'


@pytest.fixture(scope="module")
def zoo() -> mujoco.MjModel:
    """A shape of each type over a floor, each on a body that is moved by hand."""
    shapes = "".join(
        f'<body mocap="true">{scenes.geom_xml(kind, more=f"rgba={chr(34)}.{index} .5 .8 1{chr(34)}")}</body>'
        for index, kind in enumerate(scenes.TYPES)
    )
    floor = '<geom name="floor" type="plane" size="0 0 0.1" pos="0 0 -1"/>'
    return scenes.compile_xml(shapes + floor + LIGHT + EYE, assets=scenes.ASSETS)


def states(mjm: mujoco.MjModel, count: int) -> list[mujoco.MjData]:
    random = np.random.default_rng(3)
    found = []
    for _ in range(count):
        mjd = mujoco.MjData(mjm)
        mjd.mocap_pos[:] = random.uniform((-1.2, -0.5, -0.6), (1.2, 1.0, 1.0), (mjm.nmocap, 3))
        mjd.mocap_quat[:] = random.normal(size=(mjm.nmocap, 4))
        mujoco.mj_forward(mjm, mjd)
        found.append(mjd)
    return found


def eye(**changes: object) -> wc.Camera:
    return wc.Camera("scene", **{"width": 37, "height": 21, "outputs": OUTPUTS, **changes})


def assert_same(left: dict[str, np.ndarray], right: dict[str, np.ndarray]) -> None:
    assert left.keys() == right.keys()
    for name in left:
        assert np.array_equal(left[name], right[name]), name


def at(images: dict[str, np.ndarray], worlds: object) -> dict[str, np.ndarray]:
    return {name: image[worlds] for name, image in images.items()}


def test_one_by_one_and_in_any_order(device: wp.Device, zoo: mujoco.MjModel) -> None:
    mjds = states(zoo, WORLDS)
    together = scenes.look(wc.from_mujoco(zoo, mjds, device=device), eye())
    assert len({image.tobytes() for image in together["depth"]}) == WORLDS
    for world, mjd in enumerate(mjds):
        alone = scenes.look(wc.from_mujoco(zoo, mjd, device=device), eye())
        assert_same(at(together, [world]), alone)
    order = [3, 0, 5, 1, 4, 2]
    shuffled = scenes.look(wc.from_mujoco(zoo, [mjds[world] for world in order], device=device), eye())
    assert_same(at(together, order), shuffled)
    # Enough worlds that a block of threads draws another part of a view than above.
    many = scenes.look(wc.from_mujoco(zoo, mjds * 11, device=device), eye())
    for turn in range(11):
        assert_same(at(many, slice(WORLDS * turn, WORLDS * (turn + 1))), together)


def test_repeats_and_graphs_are_equal(device: wp.Device, zoo: mujoco.MjModel) -> None:
    scene = wc.from_mujoco(zoo, states(zoo, WORLDS), device=device)
    renderer = wc.Renderer(scene, [eye()])
    first = {name: image.clone() for name, image in renderer.render()["scene"].items()}
    assert_same(scenes.on_host(first), scenes.look(scene, eye(), graph=False))
    for _ in range(100):
        for image in renderer.images["scene"].values():
            image.fill_(7)
        again = renderer.render()["scene"]
        assert all(torch.equal(again[name], first[name]) for name in first)


def test_others_stay_as_they_are(device: wp.Device, zoo: mujoco.MjModel) -> None:
    mjds = states(zoo, WORLDS)
    renderer = wc.Renderer(wc.from_mujoco(zoo, mjds, device=device), [eye()])
    before = scenes.on_host(renderer.render()["scene"])
    mjds[2].geom_xpos[:, 0] += 0.3
    mjds[2].cam_xpos[:, 2] += 0.2
    after = scenes.on_host(renderer.render()["scene"])
    others = [0, 1, 3, 4, 5]
    assert_same(at(before, others), at(after, others))
    for name in OUTPUTS:
        assert (before[name][2] != after[name][2]).any(), name


@pytest.mark.parametrize("kind", ["ids", "list", "mask", "torch ids", "torch mask", "nothing"])
def test_some_worlds_only(device: wp.Device, zoo: mujoco.MjModel, kind: str) -> None:
    mjds = states(zoo, WORLDS)
    renderer = wc.Renderer(wc.from_mujoco(zoo, mjds, device=device), [eye(outputs=("depth", "segmentation"))])
    before = scenes.on_host(renderer.render()["scene"])
    for mjd in mjds:
        mjd.geom_xpos[:, 0] += 0.3
    mask = np.array([False, True, False, False, True, False])
    torch_device = wp.device_to_torch(device)
    chosen = {
        "ids": np.array([4, 1]),
        "list": [1, 4, 1],
        "mask": mask,
        "torch ids": torch.tensor([1, 4], device=torch_device),
        "torch mask": torch.tensor(mask, device=torch_device),
        "nothing": [],
    }[kind]
    some = scenes.on_host(renderer.render(worlds=chosen)["scene"])
    every = scenes.on_host(renderer.render()["scene"])
    drawn = np.zeros(WORLDS, bool) if kind == "nothing" else mask
    assert_same(at(some, ~drawn), at(before, ~drawn))
    assert_same(at(some, drawn), at(every, drawn))
    assert (before["depth"] != every["depth"]).any(axis=(1, 2)).all()


@pytest.mark.parametrize("worlds", [[6], [-1], [True], [0.5], "all", np.ones(5, bool), [[0]]])
def test_wrong_worlds(device: wp.Device, zoo: mujoco.MjModel, worlds: object) -> None:
    renderer = wc.Renderer(
        wc.from_mujoco(zoo, states(zoo, WORLDS), device=device), [eye(outputs=("depth", "segmentation"))]
    )
    with pytest.raises(wc.WarpcamError, match="worlds"):
        renderer.render(worlds=worlds)


@pytest.mark.parametrize("what", ["position", "rotation", "size", "camera", "infinite", "own camera"])
def test_what_is_no_number_costs_its_world(device: wp.Device, zoo: mujoco.MjModel, what: str) -> None:
    mjds = states(zoo, WORLDS)
    m, d = scenes.put(zoo, WORLDS, batch={"geom_size": WORLDS})
    for name in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat"):
        array = getattr(d, name)
        array.assign(np.stack([getattr(mjd, name) for mjd in mjds]).reshape(array.numpy().shape))
    pose = {"position": (0.0, -2.5, 1.0), "rotation": (0.8, 0.5, 0.0, 0.0), "lens": wc.Pinhole(fovy=60.0)}
    cameras = [eye(), scenes.own_camera(width=37, height=21, outputs=OUTPUTS, **pose)]
    renderer = wc.Renderer(wc.from_mujoco_warp(zoo, m, d), cameras)
    before = {name: scenes.on_host(images) for name, images in renderer.render().items()}
    assert not renderer.faulty.any()
    ball, bad = zoo.geom("sphere").id, 4
    if what == "position":
        scenes.write(d.geom_xpos, (bad, ball, 1), np.nan)
    elif what == "rotation":
        scenes.write(d.geom_xmat, (bad, ball, 1), np.nan)
    elif what == "size":
        scenes.write(m.geom_size, (bad, ball, 0), np.nan)
    elif what == "infinite":
        scenes.write(d.geom_xpos, (bad, ball, 1), np.inf)
    elif what == "camera":
        scenes.write(d.cam_xpos, (bad, 0, 1), np.nan)
    else:
        renderer.camera("eye").position[bad] = torch.nan
    after = {name: scenes.on_host(images) for name, images in renderer.render().items()}
    others = [0, 1, 2, 3, 5]
    blank = {"camera": ["scene"], "own camera": ["eye"]}.get(what, ["scene", "eye"])
    for name in before:
        assert_same(at(before[name], others), at(after[name], others))
    for name in blank:
        assert np.isinf(after[name]["depth"][bad]).all()
        assert (after[name]["segmentation"][bad] == -1).all()
        assert (after[name]["normals"][bad] == 0.0).all()
        assert (after[name]["rgb"][bad] == 0).all()
    assert renderer.faulty.tolist() == [world == bad for world in range(WORLDS)]


@pytest.mark.parametrize("what", ["geom_xpos", "geom_xmat", "geom_size"])
def test_what_is_no_number_counts_out_of_sight_too(device: wp.Device, what: str) -> None:
    """In a scene of so many shapes that a CPU looks closely at those in sight alone."""
    balls = "".join(f'<geom size=".02" pos="{k % 9 / 9 - 0.4} {k // 9 / 9 - 0.4} 0"/>' for k in range(80))
    mjm = scenes.compile_xml(balls + '<geom size=".1" pos="0 0 9"/>')  # behind the camera
    m, d = scenes.put(mjm, 2, batch={"geom_size": 2})
    camera = scenes.own_camera(width=16, height=16, position=(0.0, 0.0, 2.0), rotation=(1.0, 0.0, 0.0, 0.0))
    renderer = wc.Renderer(wc.from_mujoco_warp(mjm, m, d), [camera])
    assert (renderer.render()["eye"]["segmentation"].max() >= 0) and not renderer.faulty.any()
    scenes.write(m.geom_size if what == "geom_size" else getattr(d, what), (1, 80, 1), np.nan)
    renderer.render()
    assert renderer.faulty.tolist() == [False, True]


@pytest.mark.parametrize(("width", "height"), [(37, 21), (1, 1), (100, 70), (7, 130)])
def test_images_of_any_size(device: wp.Device, zoo: mujoco.MjModel, width: int, height: int) -> None:
    """Each is a window of a large image, whose tiles lie elsewhere."""
    scene = wc.from_mujoco(zoo, states(zoo, 2), device=device)
    pose = {"position": (0.0, -2.5, 1.0), "rotation": (0.8, 0.5, 0.0, 0.0)}
    large, left, top = 144, 11, 5

    def seen(width: int, height: int, cx: float, cy: float) -> dict[str, np.ndarray]:
        lens = wc.Pinhole(fx=80.0, cx=cx, cy=cy)
        return scenes.look(scene, scenes.own_camera(width=width, height=height, lens=lens, **pose))

    whole = seen(large, large, 72.0, 72.0)
    part = seen(width, height, 72.0 - left, 72.0 - top)
    window = (slice(None), slice(top, top + height), slice(left, left + width))
    same = part["segmentation"] == whole["segmentation"][window]
    assert same.mean() >= 0.995
    both = same & (part["segmentation"] >= 0)
    assert np.allclose(part["depth"][both], whole["depth"][window][both], rtol=1e-4)


def test_every_one_of_many_shapes(device: wp.Device) -> None:
    """700 balls side by side."""
    random = np.random.default_rng(5)
    side = np.stack(np.mgrid[:28, :25], axis=-1).reshape(-1, 2)
    places = np.column_stack((side - (13.5, 12.0), random.permutation(700) * 0.1))
    mjm = scenes.compile_xml("".join(f'<geom type="sphere" size="0.4" pos="{x} {y} {z}"/>' for x, y, z in places))
    above = scenes.own_camera(width=84, height=84, lens=wc.Orthographic(height=28.0), position=(0, 0, 100))
    seen = scenes.look(wc.from_mujoco(mjm, scenes.forward(mjm), device=device), above)
    assert set(np.unique(seen["segmentation"])) == set(range(-1, 700))
    for row, column in np.argwhere(seen["segmentation"][0] >= 0):
        x, y, z = places[seen["segmentation"][0, row, column]]
        across = ((column + 0.5) / 3 - 14 - x) ** 2 + (14 - (row + 0.5) / 3 - y) ** 2
        assert seen["depth"][0, row, column] == pytest.approx(100 - z - np.sqrt(0.16 - across), abs=2e-4)


@pytest.mark.parametrize("kind", ["sphere", "box"])
def test_more_shapes_than_one_pass_draws(device: wp.Device, kind: str) -> None:
    """600 shapes in a heap, all in one part of a view, and enough worlds that the part is all of it."""
    random = np.random.default_rng(6)
    heap = "".join(
        f'<geom type="{kind}" size="{" ".join(["0.1"] * (3 if kind == "box" else 1))}" pos="{x} {y} {z}"/>'
        for x, y, z in random.normal(scale=0.6, size=(600, 3))
    )
    mjm = scenes.compile_xml(heap)
    mjd, position = scenes.forward(mjm), np.array((0.0, 0.0, 5.0))
    scene = wc.from_mujoco(mjm, [mjd] * 32, device=device)
    seen = scenes.look(scene, scenes.own_camera(lens=wc.Pinhole(fovy=40.0), position=position))
    for image in seen.values():
        assert (image == image[0]).all()
    rays = scenes.pixel_rays(32, 32, 40.0).reshape(-1, 3)
    found, wrong = np.zeros(1, np.int32), 0
    for ray, shape, depth in zip(rays, seen["segmentation"][0].flat, seen["depth"][0].flat, strict=True):
        t = mujoco.mj_ray(mjm, mjd, position, ray, None, True, -1, found)
        wrong += found[0] != shape or (shape >= 0 and abs(t - depth) > 1e-4)
    assert (seen["segmentation"][0] >= 256).sum() > 200
    assert wrong <= 2  # on outlines
