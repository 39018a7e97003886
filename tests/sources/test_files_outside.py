"""Files outside of a scene's folder are not opened, whatever names them, unless the user allows it."""

import contextlib
import gc
import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from opened_files import events, opened_files
from scene_doors import DOORS, Door

import warpcam as wc

pytestmark = [
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.skipif(sys.platform != "linux", reason="inotify tells what is opened"),
]
TEMPLATE = {"StartTime": 3, "EndTime": 3, "Stride": 1}
NEEDED = {"usd": "pxr", "mjcf": "mujoco_warp", "urdf": "mujoco_warp"}


def _linked(folder: Path, outside: Path) -> str:
    (folder / f"link{outside.suffix}").symlink_to(outside)
    return f"link{outside.suffix}"


def _by_linked_folder(folder: Path, outside: Path) -> str:
    (folder / "assets").symlink_to(outside.parent)
    return f"assets/{outside.name}"


WAYS: dict[str, Callable[[Path, Path], str]] = {
    "above": lambda folder, outside: f"../{outside.parent.name}/{outside.name}",
    "absolute": lambda folder, outside: str(outside),
    "round": lambda folder, outside: f"./more/../../{outside.parent.name}/{outside.name}",
    "link": _linked,
    "linked-folder": _by_linked_folder,
}


@pytest.fixture(params=DOORS)
def door(request: pytest.FixtureRequest) -> Door:
    pytest.importorskip("trimesh")
    pytest.importorskip(NEEDED.get(request.param.partition("-")[0], "numpy"))
    found: Door = DOORS[request.param]
    return found


def _laid(tmp_path: Path, door: Door, way: str, beside: str = "secret") -> tuple[Path, Path]:
    """The scene's file and the other one."""
    folder, outside = tmp_path / "scene", tmp_path / beside / f"other{door.ending}"
    (folder / "more").mkdir(parents=True)
    outside.parent.mkdir()
    outside.write_bytes(door.content)
    return door.write(folder, WAYS[way](folder, outside)), outside


@pytest.mark.parametrize("way", WAYS)
def test_a_file_outside_is_opened_only_if_allowed(door: Door, way: str, tmp_path: Path) -> None:
    scene, outside = _laid(tmp_path, door, way)
    with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError) as caught:
        wc.load(scene, device="cpu")
    assert not opened
    text = str(caught.value)
    assert outside.name in text or "link" in text
    assert f"search_paths=[{str(outside.parent)!r}] (--search-path), or trusted=True (--trusted)" in text
    for options in ({"trusted": True}, {"search_paths": [outside.parent]}):
        if outside.suffix == ".usda":
            gc.collect()  # USD keeps layers open as long as there is a stage with them
        with opened_files(outside.parent) as opened:
            wc.load(scene, device="cpu", **options)  # type: ignore[arg-type]
        assert outside.name in opened


def test_files_of_meshes_beside_are_opened(door: Door, tmp_path: Path) -> None:
    """As ``../meshes``, which descriptions of robots name by custom."""
    scene, outside = _laid(tmp_path, door, "above", beside="Meshes")
    with opened_files(outside.parent) as opened:
        wc.load(scene, device="cpu")
    assert outside.name in opened


def test_a_folder_of_meshes_that_is_a_link(door: Door, tmp_path: Path) -> None:
    """A link out of ``../meshes`` leads outside."""
    _, outside = _laid(tmp_path, door, "above")
    (tmp_path / "meshes").symlink_to(outside.parent)
    scene = door.write(tmp_path / "scene", f"../meshes/{outside.name}")
    with pytest.raises(wc.WarpcamError, match=r"a link to '.*/secret/other"):
        wc.load(scene, device="cpu")


def test_the_folder_may_be_linked_itself(door: Door, tmp_path: Path) -> None:
    """Builds of workspaces install links to files in place of these."""
    source, installed = tmp_path / "source", tmp_path / "installed"
    source.mkdir(), installed.mkdir()
    (source / f"other{door.ending}").write_bytes(door.content)
    door.write(source, f"{'./' * (door.ending == '.obj')}other{door.ending}")
    for path in list(source.iterdir()):
        (installed / path.name).symlink_to(path)
    scene = next(path for path in installed.iterdir() if path.stem == "it" and path.suffix != ".mtl")
    with opened_files(source) as opened:
        wc.load(scene, device="cpu")
    assert f"other{door.ending}" in opened


def test_a_file_outside_that_is_not_there_is_no_fault_of_its_own(tmp_path: Path) -> None:
    """The path of another machine's user, as programs write it; the file lies beside the scene."""
    pytest.importorskip("trimesh")
    (tmp_path / "wood.png").write_bytes(DOORS["dae-image"].content)
    scene = DOORS["dae-image"].write(tmp_path, "/home/of/somebody/wood.png")
    with opened_files(tmp_path) as opened:
        wc.load(scene, device="cpu")
    assert "wood.png" in opened


@pytest.mark.parametrize(
    "name", ["..\\secret\\other.obj", "&#46;&#x2e;/secret/other.obj", "more/..//../secret/other.obj"]
)
@pytest.mark.parametrize("tag", ['<mesh name="n" file="{}"/>', '<mesh name="n"scale="1 1 1"file = \'{}\'/>'])
def test_what_mujoco_takes_for_a_path(name: str, tag: str, tmp_path: Path) -> None:
    """MuJoCo's reader allows more than XML does."""
    pytest.importorskip("mujoco_warp")
    _, outside = _laid(tmp_path, DOORS["mjcf-mesh"], "above")
    scene = tmp_path / "scene" / "it.xml"
    hidden = f"<!-- > -- <mesh --><![CDATA[<!--]]>< asset>{tag.format(name)}</asset><![CDATA[-->]]>"
    scene.write_text(f'<mujoco>{hidden}<worldbody><geom type="mesh" mesh="n"/></worldbody></mujoco>')
    with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError, match="outside of the scene's folder"):
        wc.load(scene, device="cpu")
    assert not opened


@pytest.mark.parametrize(
    "include", ['<INCLUDE file="{}"/>', '< include  file=\n"{}"  />', '<include a=">" file="{}"/>']
)
def test_what_mujoco_takes_for_an_include(include: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    _, outside = _laid(tmp_path, DOORS["mjcf-include"], "above")
    scene = tmp_path / "scene" / "it.xml"
    scene.write_text(f"<mujoco>{include.format('../secret/other.xml')}</mujoco>")
    with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError, match="outside of the scene's folder"):
        wc.load(scene, device="cpu")
    assert not opened


def test_parts_of_parts(tmp_path: Path) -> None:
    """A file that an included or attached file names, from its own folder."""
    pytest.importorskip("mujoco_warp")
    _, outside = _laid(tmp_path, DOORS["mjcf-mesh"], "above")
    folder = tmp_path / "scene"
    (folder / "more" / "deep.xml").write_text(
        '<mujoco><asset><mesh name="n" file="../../secret/other.obj"/></asset>'
        '<worldbody><body name="b"><geom type="mesh" mesh="n"/></body></worldbody></mujoco>'
    )
    (folder / "middle.xml").write_text('<mujoco><include file="more/deep.xml"/></mujoco>')
    for first in ('<include file="middle.xml"/>', '<asset><model name="c" file="more/deep.xml"/></asset>'):
        (folder / "it.xml").write_text(f'<mujoco>{first}<worldbody><geom size="1"/></worldbody></mujoco>')
        with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError, match="outside of the scene's"):
            wc.load(folder / "it.xml", device="cpu")
        assert not opened


@pytest.mark.parametrize("uri", ["%2e%2e/secret/other.bin", "..%2Fsecret%2Fother.bin"])
def test_paths_of_gltf_that_are_encoded(uri: str, tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    from scene_doors import gltf

    _laid(tmp_path, DOORS["gltf-buffer"], "above")
    (tmp_path / "scene" / "it.gltf").write_text(gltf(uri))
    with pytest.raises(wc.WarpcamError, match="outside of the scene's folder"):
        wc.load(tmp_path / "scene" / "it.gltf", device="cpu")


@pytest.mark.parametrize(
    "name",
    [
        "package://secret/other.obj",
        "package://../secret/other.obj",
        "model://secret/other.obj",
        "file://{}/secret/other.obj",
        "$(find secret)/other.obj",
        "package://scene/../secret/other.obj",
    ],
)
def test_packages_outside(name: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    pytest.importorskip("trimesh")
    _, outside = _laid(tmp_path, DOORS["urdf-mesh"], "above")
    scene = DOORS["urdf-mesh"].write(tmp_path / "scene", name.format(tmp_path))
    with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError, match="outside of the scene's folder"):
        wc.load(scene, device="cpu")
    assert not opened


def test_a_layer_named_by_an_expression(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from scene_doors import LAYER

    scene = DOORS["usd-reference"].write(tmp_path, '`"other.usda"`')
    (tmp_path / "other.usda").write_bytes(LAYER)
    with pytest.raises(wc.WarpcamError, match=r"by the expression .*trusted=True"):
        wc.load(scene, device="cpu")
    assert wc.load(scene, device="cpu", trusted=True).num_worlds == 1


def test_clips_by_a_template(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    _, outside = _laid(tmp_path, DOORS["usd-clip"], "above")
    outside.rename(outside.with_name("other.3.usda"))
    scene = DOORS["usd-clip"].write(tmp_path / "scene", "../secret/other.#.usda")
    times = "".join(f"\n            double template{key} = {value}" for key, value in TEMPLATE.items())
    listed = "asset[] assetPaths = [@../secret/other.#.usda@]"
    text = scene.read_text().replace(listed, f'string templateAssetPath = "../secret/other.#.usda"{times}')
    scene.write_text(text)
    with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError, match="outside of the scene's folder"):
        wc.load(scene, device="cpu")
    assert not opened


def test_a_package_that_names_files_outside(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    import zipfile

    for kind in ("usd-reference", "usd-image"):
        folder = tmp_path / kind
        folder.mkdir()
        _, outside = _laid(folder, DOORS[kind], "above")
        plain = DOORS[kind].write(folder, str(outside))
        with zipfile.ZipFile(folder / "scene" / "it.usdz", "w") as package:
            package.write(plain, "it.usda")
        with opened_files(outside.parent) as opened, pytest.raises(wc.WarpcamError, match="outside of the scene's"):
            wc.load(folder / "scene" / "it.usdz", device="cpu")
        assert not opened


def test_a_pipe_is_not_opened(door: Door, tmp_path: Path) -> None:
    """It would wait for ever."""
    scene, outside = _laid(tmp_path, door, "above", beside="meshes")
    outside.unlink()
    os.mkfifo(outside)
    with opened_files(outside.parent) as opened:
        with contextlib.suppress(wc.WarpcamError):
            wc.load(scene, device="cpu")
    assert not opened


def test_textures_by_hand_may_lie_anywhere(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "it.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "red.png").write_bytes(DOORS["obj-map"].content)
    scene = wc.load(folder / "it.obj", device="cpu", textures={"red": tmp_path / "red.png"})
    assert isinstance(scene, wc.DrivenScene) and scene.textures == ("red",)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"trusted": "yes"}, "load: trusted must be True or False, got 'yes'"),
        ({"search_paths": "/tmp"}, "load: search_paths must be a sequence of folders, got '/tmp'"),
        ({"search_paths": ["/nowhere"]}, "load: search_paths must be folders, and '/nowhere' is none"),
        ({"limits": 3}, "load: limits must be a warpcam.Limits or None, got int"),
    ],
)
def test_bad_arguments(options: dict[str, object], text: str, tmp_path: Path) -> None:
    (tmp_path / "it.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(wc.WarpcamError, match=text.replace("(", r"\(")):
        wc.load(tmp_path / "it.obj", device="cpu", **options)  # type: ignore[arg-type]


def test_an_image_in_a_package_outside(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    import zipfile

    _, outside = _laid(tmp_path, DOORS["usd-image"], "above")
    package = outside.with_suffix(".usdz")
    with zipfile.ZipFile(package, "w") as archive:
        archive.write(outside, "other.png")
    scene = DOORS["usd-image"].write(tmp_path / "scene", "../secret/other.usdz[other.png]")
    with pytest.raises(wc.WarpcamError, match=r"names the file '.*/secret/other\.usdz' outside"):
        wc.load(scene, device="cpu")
    assert wc.load(scene, device="cpu", search_paths=[tmp_path / "secret"]).num_worlds == 1


@pytest.mark.parametrize("name", ["http://localhost:9/a", "ftp://localhost:9/a"])
def test_addresses_of_the_network_are_no_files(door: Door, name: str, tmp_path: Path) -> None:
    with events(("socket.", "urllib.", "http.", "ftplib.", "subprocess.", "pickle.")) as heard:
        with contextlib.suppress(wc.WarpcamError):
            wc.load(door.write(tmp_path, f"{name}{door.ending}"), device="cpu")
    assert not heard
    with events(("socket.",)) as heard:
        socket.socket().close()
    assert heard


def test_stages_and_builders(tmp_path: Path) -> None:
    """The arguments of ``from_usd`` and ``add_urdf``, and a stage that the caller has opened."""
    pytest.importorskip("pxr")
    newton = pytest.importorskip("newton")
    from pxr import Usd

    for kind, load in (
        ("usd-reference", lambda path, **options: wc.from_usd(path, device="cpu", **options)),
        ("urdf-mesh", lambda path, **options: wc.add_urdf(newton.ModelBuilder(), path, **options)),
    ):
        scene, outside = _laid(tmp_path / kind, DOORS[kind], "above")
        with pytest.raises(wc.WarpcamError, match="outside of the scene's folder"):
            load(scene)
        with pytest.raises(wc.WarpcamError, match="file_bytes of limits is 9"):
            load(scene, trusted=True, limits=wc.Limits(file_bytes=9))
        load(scene, trusted=True)
        load(scene, search_paths=[outside.parent])
    scene, _ = _laid(tmp_path / "stage", DOORS["usd-image"], "above")
    assert wc.from_usd(Usd.Stage.Open(str(scene)), device="cpu").num_worlds == 1


def test_search_paths_are_searched(door: Door, tmp_path: Path) -> None:
    """A name that leads to no file from the scene's folder."""
    library, name = tmp_path / "library", f"other{door.ending}"
    library.mkdir()
    (tmp_path / "scene").mkdir()
    scene = door.write(tmp_path / "scene", name)
    (library / name).write_bytes(door.content)
    if "include" in scene.read_text("latin-1") or "<model" in scene.read_text("latin-1"):
        with pytest.raises(wc.WarpcamError, match="MuJoCo cannot read"):  # it alone looks for these
            wc.load(scene, device="cpu", search_paths=[library])
        return
    with opened_files(library) as opened:
        wc.load(scene, device="cpu", search_paths=[library])
    assert name in opened


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("trimesh")
    from warpcam.tools.cli import main

    for number, options in enumerate(([], ["--trusted"], ["--search-path", "secret"])):
        scene, outside = _laid(tmp_path / str(number), DOORS["obj-mtllib"], "above")
        options = [str(outside.parent) if option == "secret" else option for option in options]
        rest = [
            "--worlds",
            "1",
            "--size",
            "8x8",
            "--device",
            "cpu",
            "--outputs",
            "depth",
            "--out",
            str(tmp_path / "out"),
        ]
        with opened_files(outside.parent) as opened:
            code = main(["render", str(scene), *options, *rest])
        assert code == (0 if options else 2) and (outside.name in opened) == bool(options)
        assert options or "--search-path" in capsys.readouterr().err


def test_names_that_usd_looks_for_from_the_stage(tmp_path: Path) -> None:
    """A layer in a folder names one without a dot, which lies beside the stage."""
    pytest.importorskip("pxr")
    (tmp_path / "parts").mkdir()
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "other.usda").write_bytes(DOORS["usd-reference"].content)
    DOORS["usd-reference"].write(tmp_path / "parts", "lib/other.usda").rename(tmp_path / "parts" / "a.usda")
    text = (
        (tmp_path / "parts" / "a.usda")
        .read_text()
        .replace("(\n    metersPerUnit", '(\n    defaultPrim = "World"\n    metersPerUnit')
    )
    (tmp_path / "parts" / "a.usda").write_text(text)
    scene = DOORS["usd-reference"].write(tmp_path, "./parts/a.usda")
    with opened_files(tmp_path / "lib") as opened:
        wc.load(scene, device="cpu")
    assert opened == {"other.usda"}
    with pytest.raises(wc.WarpcamError, match=r"'omniverse://a/b\.usd' is an address; open it by pxr"):
        wc.from_usd("omniverse://a/b.usd")
