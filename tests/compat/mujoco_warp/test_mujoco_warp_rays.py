"""Rays by MuJoCo-Warp's calls, beside its own and MuJoCo's."""

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import scenes
import warp as wp

import warpcam as wc
from warpcam.compat import mujoco_warp as ours

NUM_WORLDS, NUM_RAYS = 3, 500
KINDS = tuple(kind for kind in scenes.TYPES if kind != "hfield")  # mj_multiRay loses these, MuJoCo-Warp their sides
ALL = (-1,) * 6
TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def mjm() -> mujoco.MjModel:
    """Free shapes of all types, in all groups, over a floor, with one beyond the groups and one that nobody sees."""
    bodies = "".join(
        f'<body name="{kind}"><freejoint/>{scenes.geom_xml(kind, more=f"""group="{number % 6}" """)}</body>'
        for number, kind in enumerate(KINDS)
        if kind != "plane"
    )
    return scenes.compile_xml(
        '<geom name="floor" type="plane" size="0 0 1" pos="0 0 -2"/>'
        '<geom type="sphere" size=".5" pos="0 0 .3" rgba="1 0 0 0"/>'
        '<geom name="beyond" type="sphere" size=".4" pos="1 1 0" group="7"/>'
        '<body name="still"><geom name="still" type="box" size=".3 .2 .4" pos="-1 1 0"/></body>' + bodies,
        assets=scenes.ASSETS,
    )


@pytest.fixture
def worlds(mjm: mujoco.MjModel, device: wp.Device) -> tuple[mjw.Model, mjw.Data]:
    m, d = scenes.put(mjm, NUM_WORLDS)
    random = np.random.default_rng(2)
    poses = random.normal(size=(NUM_WORLDS, mjm.nq // 7, 7))
    poses[..., :3] = random.uniform(-1.5, 1.5, poses[..., :3].shape)
    d.qpos.assign(poses.reshape(NUM_WORLDS, -1).astype(np.float32))
    mjw.kinematics(m, d)
    return m, d


def arrays(rows: int = NUM_WORLDS, count: int = NUM_RAYS, spread: float = 1.5) -> dict[str, Any]:
    """Rays from anywhere near the shapes, of any length, and arrays for what they meet."""
    random = np.random.default_rng(5)
    return {
        "pnt": wp.array(random.uniform(-spread, spread, (rows, count, 3)), dtype=wp.vec3),
        "vec": wp.array(2.0 * random.normal(size=(rows, count, 3)), dtype=wp.vec3),
        "geomgroup": ALL,
        "flg_static": True,
        "bodyexclude": wp.full(count, -1, dtype=int),
        "dist": wp.zeros((NUM_WORLDS, count), dtype=float),
        "geomid": wp.zeros((NUM_WORLDS, count), dtype=int),
        "normal": wp.zeros((NUM_WORLDS, count), dtype=wp.vec3),
    }


def met(given: dict[str, Any]) -> list[np.ndarray]:
    return [given[name].numpy().copy() for name in ("dist", "geomid", "normal")]


def context(system: Any, mjm: mujoco.MjModel, worlds: Any, **options: Any) -> Any:
    rc = system.create_render_context(mjm, nworld=NUM_WORLDS, cam_active=[], **options)
    system.refit_bvh(*worlds, rc)
    return rc


def cast(system: Any, mjm: mujoco.MjModel, worlds: Any, given: dict[str, Any], **options: Any) -> list[np.ndarray]:
    system.rays(*worlds, **{**given, "geomgroup": vec6(given["geomgroup"])}, rc=context(system, mjm, worlds, **options))
    return met(given)


def vec6(flags: Any) -> Any:
    return wp.types.vector(length=6, dtype=float)(*flags)


def agree(mine: list[np.ndarray], theirs: list[np.ndarray], lengths: np.ndarray) -> None:
    """At all rays but the few that graze an edge."""
    same = mine[1] == theirs[1]
    assert (~same).mean() < 0.004 and (theirs[1] >= 0).mean() > 0.15
    assert (mine[0][mine[1] < 0] == -1.0).all() and not mine[2][mine[1] < 0].any()
    far = np.abs(mine[0] - theirs[0]) * np.broadcast_to(lengths, mine[0].shape)
    off = far > TOLERANCE * np.maximum(1.0, np.abs(theirs[0]))
    assert (off & same).mean() < 0.002
    turned = np.abs(mine[2] - theirs[2]).max(axis=-1) > 2e-3
    assert (turned & same & ~off).mean() < 0.002


OPTIONS: dict[str, dict[str, Any]] = {
    "all": {"enabled_geom_groups": range(8)},
    "enabled groups": {"enabled_geom_groups": (0, 2, 5, 7)},
    "some groups": {"geomgroup": (-1, 0, -1, 0, 0, -1), "enabled_geom_groups": range(8)},
    "what moves": {"flg_static": False, "enabled_geom_groups": range(8)},
    "one row": {"rows": 1, "enabled_geom_groups": range(8)},
}


@pytest.mark.parametrize("case", OPTIONS)
def test_rays_are_those_of_mujoco_warp(mjm: mujoco.MjModel, worlds: Any, case: str, device: wp.Device) -> None:
    """Each of them leaves out a body of its own, or none; many begin within shapes."""
    options = dict(OPTIONS[case])
    given = arrays(options.pop("rows", NUM_WORLDS))
    given |= {name: options.pop(name) for name in ("geomgroup", "flg_static") if name in options}
    given["bodyexclude"] = wp.array(np.arange(NUM_RAYS) % (mjm.nbody + 1) - 1, dtype=int)
    theirs = cast(mjw, mjm, worlds, given, **options)
    for out in ("dist", "geomid", "normal"):
        given[out].fill_(7)
    mine = cast(ours, mjm, worlds, given, **options)
    agree(mine, theirs, np.linalg.norm(given["vec"].numpy(), axis=-1))
    if case == "what moves":
        assert mjm.geom("floor").id not in mine[1] and mjm.geom("still").id not in mine[1]


def test_rays_are_those_of_mj_multi_ray(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    """From one point, at a floor and shapes; MuJoCo counts what is beyond the groups to the last of them."""
    given, start = arrays(1), np.array((0.1, -0.2, 1.4))
    given["pnt"] = wp.array(np.broadcast_to(start, (1, NUM_RAYS, 3)).copy(), dtype=wp.vec3)
    mine = cast(ours, mjm, worlds, given, enabled_geom_groups=range(8))
    vectors, mjd = given["vec"].numpy()[0].astype(np.float64), mujoco.MjData(mjm)
    for world in range(NUM_WORLDS):
        mjd.qpos[:] = worlds[1].qpos.numpy()[world]
        mujoco.mj_forward(mjm, mjd)
        ids, distances, normals = np.zeros(NUM_RAYS, np.int32), np.zeros(NUM_RAYS), np.zeros((NUM_RAYS, 3))
        mujoco.mj_multiRay(
            mjm, mjd, start, vectors.reshape(-1), None, True, -1, ids, distances, normals.reshape(-1), NUM_RAYS,
            mujoco.mjMAXVAL,
        )  # fmt: skip
        one = [part[world] for part in mine]
        agree(one, [distances, ids, normals], np.linalg.norm(vectors, axis=-1))


def test_one_ray_in_every_world(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    rc, theirs = (context(system, mjm, worlds, enabled_geom_groups=range(8)) for system in (ours, mjw))
    for number, excluded in enumerate((-1, mjm.body("box").id, -1)):
        given = arrays(count=1 + number)
        pnt, vec = (wp.array(given[name].numpy()[:, -1:], dtype=wp.vec3) for name in ("pnt", "vec"))
        one = [part.numpy() for part in ours.ray(*worlds, pnt, vec, bodyexclude=excluded, rc=rc)]
        other = [part.numpy() for part in mjw.ray(*worlds, pnt, vec, bodyexclude=excluded, rc=theirs)]
        for mine, expected in zip(one, other, strict=True):
            assert mine.shape == expected.shape and mine.dtype == expected.dtype
            np.testing.assert_allclose(mine, expected, atol=2e-3)


def test_what_changes_is_followed(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    """Rays that are written in place or come in other arrays, and shapes that move."""
    rc = context(ours, mjm, worlds, enabled_geom_groups=range(8))
    given, other = arrays(), arrays()
    ours.rays(*worlds, **given, rc=rc)
    before = met(given)
    given["pnt"].assign(given["pnt"].numpy() + 0.3)
    ours.rays(*worlds, **given, rc=rc)
    moved = met(given)
    other["pnt"].assign(given["pnt"])
    ours.rays(*worlds, **other, rc=rc)
    np.testing.assert_array_equal(met(other)[0], moved[0])
    assert (moved[0] != before[0]).any()
    scenes.write(worlds[1].qpos, (slice(None), 2), 5.0)
    mjw.kinematics(*worlds)
    ours.rays(*worlds, **given, rc=rc)
    assert (met(given)[0] != moved[0]).any()
    assert len(rc._ray_casts._bundles) == 1 and len(rc._ray_casts._scenes) == 1


def test_rays_without_length_meet_nothing(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    given = arrays()
    vectors = given["vec"].numpy()
    vectors[:, ::3] = 0.0
    given["vec"].assign(vectors)
    distances, ids, normals = cast(ours, mjm, worlds, given)
    assert (distances[:, ::3] == -1.0).all() and (ids[:, ::3] == -1).all() and not normals[:, ::3].any()
    assert (ids[:, 1::3] >= 0).mean() > 0.2


def test_excluded_bodies_that_are_written_later_are_told(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    """In another array they count."""
    rc = context(ours, mjm, worlds)
    given = arrays()
    ours.rays(*worlds, **given, rc=rc)
    changed = given["bodyexclude"].numpy()
    changed[:50] = mjm.body("box").id
    given["bodyexclude"].assign(changed)
    ours.rays(*worlds, **given, rc=rc)
    distances = given["dist"].numpy()
    assert np.isnan(distances[:, :50]).all() and not np.isnan(distances[:, 50:]).any()
    given["bodyexclude"] = wp.array(changed, dtype=int)
    ours.rays(*worlds, **given, rc=rc)
    assert not np.isnan(given["dist"].numpy()).any()
    assert mjm.geom_bodyid[given["geomid"].numpy()[:, :50]].max() != mjm.body("box").id


def test_without_our_context_rays_are_mujoco_warps_own(
    mjm: mujoco.MjModel, worlds: Any, device: wp.Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    monkeypatch.setattr(mjw, "rays", lambda *given: calls.append(given))
    monkeypatch.setattr(mjw, "ray", lambda *given: calls.append(given))
    given = arrays()
    ours.rays(*worlds, **given)
    ours.ray(*worlds, given["pnt"], given["vec"], rc="theirs")
    assert calls[0] == (*worlds, *given.values(), None)
    assert calls[1] == (*worlds, given["pnt"], given["vec"], None, True, -1, "theirs")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"pnt": "points"}, r"pnt must have shape \(1 or 3, ray\), of 1 to \d+ rays"),
        ({"vec": (3, 4)}, r"vec must be a Warp array of vec3f? \(3, 500\) on .*, got vec3f? \(3, 4\)"),
        ({"geomgroup": (1, 2)}, r"geomgroup must be 6 numbers or None, got \(1, 2\)"),
        ({"bodyexclude": None}, r"bodyexclude must be a Warp array of int32 \(500,\) on .*, got NoneType"),
        ({"dist": (2, 500)}, r"dist must be a Warp array of float32 \(3, 500\) on .*, got vec3f? \(2, 500\)"),
        (
            {"pnt": (2, 500)},
            r"pnt must be a Warp array of vec3f? \(1, 500\) or \(3, 500\) on .*, got vec3f? \(2, 500\)",
        ),
    ],
)
def test_arrays_that_do_not_fit(
    mjm: mujoco.MjModel, worlds: Any, change: dict[str, Any], text: str, device: wp.Device
) -> None:
    ((name, value),) = change.items()
    is_shape = isinstance(value, tuple) and name != "geomgroup"
    given = arrays() | {name: wp.zeros(value, dtype=wp.vec3) if is_shape else value}
    with pytest.raises(wc.WarpcamError, match=f"rays: {text}"):
        ours.rays(*worlds, **given, rc=context(ours, mjm, worlds))


def test_one_ray_takes_one(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    given, rc = arrays(), context(ours, mjm, worlds)
    with pytest.raises(wc.WarpcamError, match=r"ray: pnt must have shape \(1 or 3, 1\), got \(3, 500\)"):
        ours.ray(*worlds, given["pnt"], given["vec"], rc=rc)
    with pytest.raises(wc.WarpcamError, match="ray: bodyexclude must be the id of a body or -1, got 'box'"):
        ours.ray(*worlds, wp.zeros((1, 1), dtype=wp.vec3), wp.zeros((1, 1), dtype=wp.vec3), bodyexclude="box", rc=rc)


def test_a_capture_takes_rays_that_were_cast_before(mjm: mujoco.MjModel, worlds: Any, device: wp.Device) -> None:
    if not device.is_cuda:
        pytest.skip("a capture needs a CUDA device")
    rc, given = context(ours, mjm, worlds, enabled_geom_groups=range(8)), arrays()
    with pytest.raises(wc.WarpcamError, match="rays: a capture is under way"), wp.ScopedCapture():
        ours.rays(*worlds, **given, rc=rc)
    ours.rays(*worlds, **given, rc=rc)
    expected = met(given)
    with wp.ScopedCapture() as capture:
        ours.rays(*worlds, **given, rc=rc)
    given["dist"].fill_(7.0)
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(met(given)[0], expected[0])
