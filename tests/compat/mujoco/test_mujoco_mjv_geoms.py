"""Geoms of MuJoCo's abstract scene beside the model, as ``mujoco.Renderer`` shows them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from mjv_geom_scene import GEOM, XML, add, connect, judging, made, tilted

import warpcam as wc
from warpcam.compat.mujoco import Renderer, frame_renderer

WIDTH, HEIGHT = 96, 72


@dataclass
class Pair:
    """One scene in two renderers: MuJoCo's own, if there is a library for it, and ours."""

    model: mujoco.MjModel
    data: mujoco.MjData
    judge: Any
    ours: Renderer

    def pictures(
        self,
        write: Callable[[mujoco.MjvScene], None] = lambda scene: None,
        mode: str = "",
        option: mujoco.MjvOption | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        if self.judge is None:
            pytest.skip("MuJoCo's own renderer needs a library: apt-get install libosmesa6")
        theirs, own = (picture(one, self.data, write, mode, option) for one in (self.judge, self.ours))
        return theirs, own

    def check(self, write: Callable[[mujoco.MjvScene], None], least: float = 0.002, most: float = 0.004) -> None:
        """Check that a write changes the picture, and both pictures are alike."""
        plain, _ = self.pictures()
        theirs, own = self.pictures(write)
        assert differ(plain, theirs) > least, "there is nothing to be seen of it"
        assert differ(theirs, own) < most
        for mode in ("depth", "segmentation"):
            one, two = self.pictures(write, mode)
            off = np.abs(one / two - 1.0) > 0.02 if mode == "depth" else (one != two).any(axis=-1)
            assert off.mean() < most


def picture(
    renderer: Any,
    data: mujoco.MjData,
    write: Callable[[mujoco.MjvScene], None] = lambda scene: None,
    mode: str = "",
    option: mujoco.MjvOption | None = None,
) -> np.ndarray:
    renderer.disable_depth_rendering()
    renderer.disable_segmentation_rendering()
    if mode:
        getattr(renderer, f"enable_{mode}_rendering")()
    renderer.update_scene(data, "fixed", option)
    write(renderer.scene)
    return renderer.render()


def differ(one: np.ndarray, two: np.ndarray) -> float:
    """The part of all pixels that are another colour."""
    return float((np.abs(one.astype(int) - two).max(axis=-1) > 24).mean())


@pytest.fixture(scope="module")
def judge() -> Iterator[Any]:
    yield from judging(made()[0], HEIGHT, WIDTH)


@pytest.fixture(scope="module")
def kept() -> dict[str, Any]:
    return {}


@pytest.fixture
def pair(device: wp.Device, judge: Any, kept: dict[str, Any]) -> Pair:
    """With room for everything from the start, so that all tests share their kernels."""
    if device.alias not in kept:
        model, data = made()
        pair = kept[device.alias] = Pair(model, data, judge, Renderer(model, HEIGHT, WIDTH, device=device))
        picture(pair.ours, data, everything)
    return kept[device.alias]


TYPES: dict[str, Callable[[mujoco.MjvScene], object]] = {
    "sphere": lambda s: add(s, GEOM.mjGEOM_SPHERE, (0.25, 0, 0), (0, 0, 0.6), shown=True, objid=7, objtype=1),
    "sphere of three sizes": lambda s: setattr(
        add(s, GEOM.mjGEOM_SPHERE, (0.25, 0, 0), (0, 0, 0.6), mat=tilted(), shown=True), "size", (0.3, 0.1, 0.2)
    ),
    "ellipsoid": lambda s: add(s, GEOM.mjGEOM_ELLIPSOID, (0.1, 0.3, 0.2), (0, 0, 0.6), mat=tilted(), shown=True),
    "capsule": lambda s: add(s, GEOM.mjGEOM_CAPSULE, (0.12, 0.3, 0), (0, 0, 0.6), mat=tilted(), shown=True),
    "cylinder": lambda s: add(s, GEOM.mjGEOM_CYLINDER, (0.12, 0.3, 0), (0, 0, 0.6), mat=tilted(), shown=True),
    "box": lambda s: add(s, GEOM.mjGEOM_BOX, (0.1, 0.3, 0.2), (0, 0, 0.6), mat=tilted(), shown=True),
    "plane": lambda s: add(s, GEOM.mjGEOM_PLANE, (0.3, 0.2, 0.1), (0, 0, 0.6), shown=True, matid=0),
    "mesh": lambda s: add(s, GEOM.mjGEOM_MESH, (0.1, 0.1, 0.1), (0, 0, 0.6), mat=tilted(), dataid=0, shown=True),
    "height field": lambda s: add(s, GEOM.mjGEOM_HFIELD, (0.1, 0.1, 0.1), (0, 0, 0.6), dataid=0, shown=True),
    "arrow": lambda s: connect(s, GEOM.mjGEOM_ARROW, 0.15, (0, 0, 0.3), (0.5, -0.9, 1.5), shown=True),
    "arrow without wedges": lambda s: connect(s, GEOM.mjGEOM_ARROW1, 0.08, (0, 0, 0.3), (0.5, -0.9, 1.5), shown=True),
    "arrow both ways": lambda s: connect(s, GEOM.mjGEOM_ARROW2, 0.06, (0, 0, 0.6), (0.5, -0.9, 1.0), shown=True),
    "line": lambda s: connect(
        s, GEOM.mjGEOM_LINE, 4, (-0.8, -1, 0.2), (0.6, 0.5, 0.9), rgba=(0.2, 0.4, 0.1, 1), shown=True
    ),
    "box of lines": lambda s: add(s, GEOM.mjGEOM_LINEBOX, (0.4, 0.3, 0.2), (0, -0.5, 0.4), mat=tilted(), shown=True),
    "shiny": lambda s: add(s, GEOM.mjGEOM_SPHERE, (0.3, 0, 0), (0, 0, 0.6), specular=1, shininess=0.1, emission=0.4),
    "seen through": lambda s: add(s, GEOM.mjGEOM_BOX, (0.3, 0.3, 0.2), (0, 0, 0.6), (1, 0, 0, 0.4), shown=True),
    "that casts a shadow": lambda s: add(s, GEOM.mjGEOM_BOX, (0.2, 0.2, 0.2), (0, 0, 0.8), category=0, shown=True),
    "in two parts": lambda s: [
        add(s, GEOM.mjGEOM_BOX, (0.2, 0.2, 0.15), (0, 0, 1.1), (0, 1, 0, 1)),
        add(s, GEOM.mjGEOM_BOX, (0.2, 0.2, 0.2), (0.4, 0, 0.5), (0, 0, 1, 1), shown=True),
    ],
}


def everything(scene: mujoco.MjvScene) -> None:
    for put in TYPES.values():
        put(scene)


@pytest.mark.parametrize("name", TYPES)
def test_a_geom_of_the_users_own(pair: Pair, name: str) -> None:
    pair.check(lambda scene: TYPES[name](scene) and None)


def test_all_of_them_at_once(pair: Pair) -> None:
    pair.check(everything, most=0.03)


def test_a_box_that_reflects(device: wp.Device, judge: Any) -> None:
    def put(scene: mujoco.MjvScene, reflectance: float = 0.7) -> None:
        add(scene, GEOM.mjGEOM_BOX, (0.9, 0.5, 0.05), (0, 0, 0.1), (0.3, 0.3, 0.3, 1), reflectance=reflectance)

    model, data = made()
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        dull = picture(renderer, data, lambda scene: put(scene, 0.0))
        assert differ(dull, picture(renderer, data, put)) > 0.002
        Pair(model, data, judge, renderer).check(put)


def test_only_what_is_no_decor_casts_shadows(pair: Pair) -> None:
    """High above what is seen."""
    high = {"size": (0.4, 0.4, 0.1), "pos": (0.0, 0.0, 2.6)}
    plain = picture(pair.ours, pair.data)
    decor = picture(pair.ours, pair.data, lambda scene: add(scene, GEOM.mjGEOM_BOX, **high) and None)
    other = picture(pair.ours, pair.data, lambda scene: add(scene, GEOM.mjGEOM_BOX, **high, category=0) and None)
    assert (decor == plain).all() and differ(plain, other) > 0.01


def test_what_has_no_id_is_left_out_of_depth_and_ids(pair: Pair) -> None:
    for mode in ("depth", "segmentation"):
        plain = picture(pair.ours, pair.data, mode=mode)
        for segment, there in ((-1, False), (33, True)):

            def write(scene: mujoco.MjvScene, segment: int = segment) -> None:
                add(scene, GEOM.mjGEOM_SPHERE, (0.3, 0, 0), (0, 0, 0.8), segid=segment, objid=12, objtype=17)

            image = picture(pair.ours, pair.data, write, mode)
            assert (image != plain).any() == there, mode
    assert (image == (12, 17)).all(axis=-1).sum() > 50


def test_what_shares_an_id_is_called_like_the_last(pair: Pair) -> None:
    """A geom that was never given an id, in memory that nobody has written to, has id 0."""

    def write(scene: mujoco.MjvScene) -> None:
        add(scene, GEOM.mjGEOM_SPHERE, (0.3, 0, 0), (0, 0, 0.8), segid=0, objid=3, objtype=2)

    image = picture(pair.ours, pair.data, write, "segmentation")
    floor = (picture(pair.ours, pair.data, mode="segmentation") == (0, 5)).all(axis=-1)
    assert (image == (3, 2)).all(axis=-1)[floor].all() and (image == (3, 2)).all(axis=-1).sum() > floor.sum()
    theirs, own = pair.pictures(write, "segmentation")
    assert (theirs != own).any(axis=-1).mean() < 0.01


def chosen(*flags: str, frame: Any = 0) -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.frame = int(frame)
    for flag in flags:
        option.flags[getattr(mujoco.mjtVisFlag, f"mjVIS_{flag}")] = True
    return option


FLAGS = {
    "contacts": chosen("CONTACTPOINT", "CONTACTFORCE"),
    "split": chosen("CONTACTFORCE", "CONTACTSPLIT"),
    "joints": chosen("JOINT"),
    "actuators": chosen("ACTUATOR"),
    "center of mass": chosen("COM"),
    "inertia": chosen("INERTIA"),
    "cameras and lights": chosen("CAMERA", "LIGHT"),
    "connections": chosen("AUTOCONNECT", "CONSTRAINT"),
    "forces": chosen("PERTFORCE"),
    "boxes": chosen("BODYBVH"),
    "frames": chosen(frame=mujoco.mjtFrame.mjFRAME_GEOM),
}


@pytest.mark.parametrize("name", FLAGS)
def test_what_a_flag_shows(pair: Pair, name: str) -> None:
    pair.data.xfrc_applied[1, :3] = (3.0, -4.0, 6.0)
    plain, _ = pair.pictures()
    theirs, own = pair.pictures(option=FLAGS[name])
    assert (theirs != plain).any() or name in ("cameras and lights", "connections")
    assert differ(theirs, own) < (0.03 if name == "boxes" else 0.01)  # whose edges lie on what they are around
    for mode in ("depth", "segmentation"):
        one, two = pair.pictures(mode=mode, option=FLAGS[name])
        off = np.abs(one / two - 1.0) > 0.02 if mode == "depth" else (one != two).any(axis=-1)
        assert off.mean() < 0.01


WRITTEN: dict[str, Callable[[mujoco.MjvScene], None]] = {
    "colour": lambda s: s.geoms[1].rgba.__setitem__(slice(None), (0, 1, 0, 1)),
    "place": lambda s: s.geoms[2].pos.__setitem__(2, 0.8),
    "size": lambda s: s.geoms[4].size.__setitem__(slice(None), (0.2, 0.2, 0.3)),
    "type": lambda s: setattr(s.geoms[1], "type", int(GEOM.mjGEOM_ELLIPSOID)),
    "gone": lambda s: setattr(s.geoms[1], "type", int(GEOM.mjGEOM_NONE)),
    "fewer": lambda s: setattr(s, "ngeom", 6),
    "site": lambda s: move_site(s),
    "darker": lambda s: s.lights[1].diffuse.__setitem__(slice(None), 0.1),
    "no headlight": lambda s: s.lights[0].diffuse.__setitem__(slice(None), 0.0),
    "turned light": lambda s: s.lights[1].dir.__setitem__(slice(None), (-0.9, 0.1, -0.5)),
    "no shadow": lambda s: setattr(s.lights[1], "castshadow", 0),
    "dark": lambda s: setattr(s, "nlight", 0),
    "another light": lambda s: lighten(s),
}


def move_site(scene: mujoco.MjvScene) -> None:
    site = next(geom for geom in scene.geoms[: scene.ngeom] if geom.objtype == int(mujoco.mjtObj.mjOBJ_SITE))
    site.pos[:], site.size[:] = (-0.2, -0.6, 0.5), 0.2


def lighten(scene: mujoco.MjvScene) -> None:
    light = scene.lights[scene.nlight]
    light.type, light.castshadow, light.headlight = int(mujoco.mjtLightType.mjLIGHT_SPOT), 1, 0
    light.pos[:], light.dir[:], light.attenuation[:] = (0.5, -0.5, 2.0), (0.0, 0.0, -2.0), (1.0, 0.0, 0.0)
    light.cutoff, light.exponent = 30.0, 5.0
    light.ambient[:], light.diffuse[:], light.specular[:] = 0.0, (0.9, 0.2, 0.2), 0.2
    scene.nlight += 1


@pytest.mark.parametrize("name", WRITTEN)
def test_what_is_written_into_the_scene_is_drawn(pair: Pair, name: str) -> None:
    grazing = name == "turned light"  # whose shadows are long
    pair.check(WRITTEN[name], least=0.004, most=0.005 if grazing else 0.0015)
    before = picture(pair.ours, pair.data)  # MuJoCo makes them anew
    picture(pair.ours, pair.data, WRITTEN[name])
    assert (picture(pair.ours, pair.data) == before).all()


def test_lines_of_range_finders_are_drawn() -> None:
    xml = XML.replace("<actuator>", '<sensor><rangefinder site="away"/></sensor><actuator>')
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.sensordata[0] > 0.0
    hidden = mujoco.MjvOption()
    hidden.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = False
    with Renderer(model, HEIGHT, WIDTH, device="cpu") as renderer:
        assert differ(picture(renderer, data), picture(renderer, data, option=hidden)) > 0.002


def test_what_is_no_number_is_not_drawn_and_hides_nothing(pair: Pair) -> None:
    plain = picture(pair.ours, pair.data)

    def write(scene: mujoco.MjvScene) -> None:
        add(scene, GEOM.mjGEOM_SPHERE, (0.2, 0, 0), (np.nan, 0, 1))
        add(scene, GEOM.mjGEOM_BOX, (0.2, np.inf, 0), (0, 0, 1))
        add(scene, GEOM.mjGEOM_SPHERE, (0.2, 0, 0), (0, 0, 1), (1, 0, 0, 0))
        add(scene, GEOM.mjGEOM_PLANE, (0, 0, 0.1), (0, 0, 1))
        add(scene, GEOM.mjGEOM_NONE, (0.2, 0.2, 0.2), (0, 0, 1))

    assert (picture(pair.ours, pair.data, write) == plain).all()


def test_their_number_changes_and_nothing_is_built_anew(device: wp.Device, monkeypatch: pytest.MonkeyPatch) -> None:
    model, data = made()
    built: list[Any] = []
    load = frame_renderer.load
    monkeypatch.setattr(frame_renderer, "load", lambda *a, **k: built.append(k["decor"]) or load(*a, **k))
    pictures = []
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        for count, scenes in ((0, 1), (1, 2), (8, 2), (0, 2), (3, 2), (9, 3), (16, 3), (8, 3), (17, 4), (1, 4), (0, 4)):

            def write(scene: mujoco.MjvScene, count: int = count) -> None:
                for number in range(count):
                    add(scene, GEOM.mjGEOM_SPHERE, (0.05, 0, 0), (0.1 * number - 0.8, 0, 0.8))

            pictures.append(picture(renderer, data, write))
            assert len(built) == scenes, count
    assert built[0] is None, "a scene without them has no places"
    assert all((pictures[0] == pictures[other]).all() for other in (3, 10)) and (pictures[2] == pictures[7]).all()
    assert len({image.tobytes() for image in pictures}) == 7


REFUSED: dict[str, tuple[Callable[[mujoco.MjvScene], object], str]] = {
    "text": (
        lambda s: add(s, GEOM.mjGEOM_SPHERE, (0.1, 0, 0), (0, 0, 1), label="here"),
        r"geoms\[\d+\]\.label is 'here': text is not drawn; allowed is ''",
    ),
    "oval": (
        lambda s: setattr(add(s, GEOM.mjGEOM_CYLINDER, (0.1, 0.1, 0), (0, 0, 1)), "size", (0.1, 0.2, 0.3)),
        r"geoms\[\d+\]\.size is \[0.1.*mjGEOM_CYLINDER, which warpcam draws round; allowed are equal first two sizes",
    ),
    "triangle": (
        lambda s: add(s, GEOM.mjGEOM_TRIANGLE, (0.1, 0.1, 0), (0, 0, 1)),
        r"geoms\[\d+\]\.type is mjGEOM_TRIANGLE, which warpcam does not draw; allowed are mjGEOM_PLANE, .*LINEBOX",
    ),
    "no type": (lambda s: add(s, 77, (0.1, 0.1, 0), (0, 0, 1)), r"geoms\[\d+\]\.type is 77, which warpcam"),
    "hull": (
        lambda s: add(s, GEOM.mjGEOM_MESH, (0.1, 0.1, 0), (0, 0, 1), dataid=1),
        r"geoms\[\d+\]\.dataid is 1: hulls are not drawn",
    ),
    "no mesh": (
        lambda s: add(s, GEOM.mjGEOM_MESH, (0.1, 0.1, 0), (0, 0, 1), dataid=8),
        r"geoms\[\d+\]\.dataid is 8; the model has 1 meshes",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_drawn_is_refused(pair: Pair, name: str) -> None:
    write, message = REFUSED[name]
    with pytest.raises(wc.WarpcamError, match=message):
        picture(pair.ours, pair.data, lambda scene: write(scene) and None)


def test_geoms_without_a_form_are_left_out(device: wp.Device, caplog: pytest.LogCaptureFixture) -> None:
    """An arrow of length 0, a size of zeros and a rotation of zeros show nothing, and are no faults of the state."""

    def formless(scene: mujoco.MjvScene) -> None:
        connect(scene, GEOM.mjGEOM_ARROW, 0.0, (0, 0, 0.6), (0, 0, 0.6), shown=True)
        for kind in (GEOM.mjGEOM_BOX, GEOM.mjGEOM_SPHERE, GEOM.mjGEOM_ELLIPSOID):
            add(scene, kind, (0, 0, 0), (0, 0, 0.6), shown=True)
            add(scene, kind, (0.2, 0.2, 0.2), (0, 0, 0.6), mat=np.zeros((3, 3)), shown=True)

    model, data = made()
    with Renderer(model, HEIGHT, WIDTH, device=device) as renderer:
        for mode in ("", "segmentation"):
            seen = picture(renderer, data, formless, mode)
            assert (seen == picture(renderer, data, mode=mode)).all()
    assert "faulty" not in caplog.text
