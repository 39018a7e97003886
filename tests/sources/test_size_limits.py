"""Sizes that files claim are refused before anything of that size is decoded, by errors that name the argument."""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scene_doors import DATA, DOORS, TETRAHEDRON, dae, gltf

import warpcam as wc

pytestmark = pytest.mark.filterwarnings("ignore")
IMAGES = [name for name in DOORS if DOORS[name].ending == ".png"]
NEEDED = {"usd": "pxr", "mjcf": "mujoco_warp", "urdf": "mujoco_warp"}
SPHERE = '<geom size="1"/>'
BODY = f"<worldbody>{SPHERE}</worldbody>"


def _needs(door: str) -> None:
    pytest.importorskip("trimesh")
    pytest.importorskip(NEEDED.get(door.partition("-")[0], "numpy"))


def claiming_png(width: int, height: int) -> bytes:
    """A file of some bytes whose header says how large the image is."""
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(b"0")),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        len(body).to_bytes(4, "big") + kind + body + zlib.crc32(kind + body).to_bytes(4, "big") for kind, body in chunks
    )


def _refused(path: Path, limit: str, limits: wc.Limits | None = None) -> str:
    """The error of a file that is over a limit, which names this and the argument."""
    with pytest.raises(wc.WarpcamError) as caught:
        wc.load(path, device="cpu", limits=limits)
    text = str(caught.value)
    assert limit in text and "limits=warpcam.Limits(" in text, text
    return text


@pytest.mark.parametrize("size", [(10_000, 15_000), (60_000, 60_000)])
@pytest.mark.parametrize("door", IMAGES)
def test_images_that_claim_to_be_large(door: str, size: tuple[int, int], tmp_path: Path) -> None:
    """Under Pillow's own limit, and over it."""
    _needs(door)
    (tmp_path / "large.png").write_bytes(claiming_png(*size))
    assert "large.png" in _refused(DOORS[door].write(tmp_path, "large.png"), "image_pixels")


@pytest.mark.parametrize("door", IMAGES)
def test_images_up_to_the_limit_are_read(door: str, tmp_path: Path) -> None:
    _needs(door)
    (tmp_path / "it.png").write_bytes(DOORS[door].content)
    path = DOORS[door].write(tmp_path, "it.png")
    assert wc.load(path, device="cpu", limits=wc.Limits(image_pixels=4)).num_worlds == 1
    assert "has 4 image pixels" in _refused(path, "image_pixels of limits is 3", wc.Limits(image_pixels=3))


def test_images_in_the_file_and_by_hand(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    import base64

    large = claiming_png(10_000, 15_000)
    path = tmp_path / "it.gltf"
    path.write_text(gltf(DATA, "data:image/png;base64," + base64.b64encode(large).decode()))
    assert "it.gltf: image 0" in _refused(path, "image_pixels")
    (tmp_path / "large.png").write_bytes(large)
    (tmp_path / "it.obj").write_text(TETRAHEDRON)
    with pytest.raises(wc.WarpcamError, match=r"textures: 'a': .*large\.png' has 150,000,000 image pixels"):
        wc.load(tmp_path / "it.obj", device="cpu", textures={"a": tmp_path / "large.png"})


def test_no_program_is_started_for_an_image(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Pillow would have Ghostscript read it."""
    pytest.importorskip("trimesh")
    (tmp_path / "it.png").write_bytes(
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 2 2\n%%EndComments\nshowpage\n%%EOF\n"
    )
    for door in ("obj-map", "ply-image", "dae-image"):
        caplog.clear()
        wc.load(DOORS[door].write(tmp_path, "it.png"), device="cpu")
        assert "its format is not known" in caplog.text


def _stl(count: int) -> bytes:
    return bytes(80) + struct.pack("<I", count) + bytes(50)


def _ply(count: int) -> bytes:
    return (
        b"ply\nformat binary_little_endian 1.0\nelement vertex %d\n"
        b"property float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n" % count
    )


def _nested(levels: int) -> str:
    begin, end = '<replicate count="1000">' * levels, "</replicate>" * levels
    return f'<mujoco><worldbody>{begin}<geom size="1"/>{end}</worldbody></mujoco>'


CLAIMS: dict[str, tuple[str, str | bytes, str, str]] = {
    "stl": ("it.stl", _stl(1 << 31), "elements", "says of triangles that it has 2,147,483,648 elements"),
    "ply": ("it.ply", _ply(1 << 40), "elements", "says of 'vertex' that it has"),
    "msh": ("it.msh", struct.pack("<4i", 3, 0, 0, 1 << 30) + bytes(48), "elements", "says of faces that it has"),
    "gltf": ("it.gltf", gltf(DATA, count=1 << 40), "elements", "accessor 0 has 1,099,511,627,776 elements"),
    "gltf-zeros": ("it.gltf", gltf(DATA, count=1 << 28, bufferView=None), "elements", "accessor 0"),  # type: ignore[arg-type]
    "texture": (
        "it.xml", f'<mujoco><asset><texture builtin="flat" width="40000" height="40000"/></asset>{BODY}</mujoco>',
        "image_pixels", "<texture> has 1,600,000,000 image pixels",
    ),
    "channels": (
        "it.xml",
        f'<mujoco><asset><texture builtin="flat" width="9000" height="9000" nchannel="999"/></asset>{BODY}</mujoco>',
        "scene_bytes", "<texture>: the scene, with all that it names, has 80,9",
    ),
    "field": (
        "it.xml", f'<mujoco><asset><hfield name="h" nrow="50000" ncol="50000" size="1 1 1 1"/></asset>{BODY}</mujoco>',
        "elements", "<hfield> has 2,500,000,000 elements",
    ),
    "flex": (
        "it.xml",
        '<mujoco><worldbody><flexcomp name="f" type="grid" count="9999 9999 9" dim="3"/></worldbody></mujoco>',
        "elements", "<flexcomp> has 899,820,009 elements",
    ),
    "replicate": ("it.xml", _nested(3), "copies", "<replicate> has 1,000,000,000 copies"),
    "memory": ("it.xml", f'<mujoco><size memory="100G"/>{BODY}</mujoco>', "scene_bytes", "<size> memory"),
    "user": ("it.xml", f'<mujoco><size nuser_body="9999999"/>{BODY}</mujoco>', "copies", "nuser_body has 9,999,999"),
}  # fmt: skip


@pytest.mark.parametrize("kind", CLAIMS)
def test_small_files_that_claim_much(kind: str, tmp_path: Path) -> None:
    name, content, limit, text = CLAIMS[kind]
    _needs("mjcf" if name.endswith(".xml") else "obj")
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    found = _refused(tmp_path / name, limit)
    assert text in found and name in found, found


def test_a_height_field_whose_header_is_wrong(tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    path = DOORS["mjcf-hfield"].write(tmp_path, "it.hf")
    (tmp_path / "it.hf").write_bytes(struct.pack("<ii", 60_000, 60_000) + bytes(16))
    assert "it.hf has 3,600,000,000 elements" in _refused(path, "elements")
    for rows, columns in ((2, 4), (-2, -3), (-1, 4)):
        (tmp_path / "it.hf").write_bytes(struct.pack("<ii", rows, columns) + bytes(24))
        with pytest.raises(
            wc.WarpcamError, match=rf"it\.hf: is no height field: its header says {rows} x {columns} cells"
        ):
            wc.load(path, device="cpu")


def test_models_that_attach_each_other_many_times(tmp_path: Path) -> None:
    """Ten copies in each of eight files: 10^8 in all."""
    pytest.importorskip("mujoco_warp")
    for level in range(8):
        parts = "".join(f'<attach model="c" body="b" prefix="p{part}"/>' for part in range(10))
        inside = f'<body name="b">{SPHERE if level == 7 else parts}</body>'
        model = "" if level == 7 else f'<asset><model name="c" file="{level + 1}.xml"/></asset>'
        (tmp_path / f"{level}.xml").write_text(f"<mujoco>{model}<worldbody>{inside}</worldbody></mujoco>")
    assert "6.xml: <attach> has 2,000,000 copies" in _refused(tmp_path / "0.xml", "copies")
    (tmp_path / "0.xml").write_text(f'<mujoco><asset><model name="c" file="0.xml"/></asset>{BODY}</mujoco>')
    with pytest.raises(wc.WarpcamError, match=r"0\.xml: is a model that has itself for a part"):
        wc.load(tmp_path / "0.xml", device="cpu")


def test_robots_that_claim_much(tmp_path: Path) -> None:
    pytest.importorskip("mujoco_warp")
    path = tmp_path / "it.urdf"
    link = '<link name="b"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
    for size, limit in (('memory="100G"', "scene_bytes"), ('nuser_body="9999999"', "copies")):
        path.write_text(f'<robot name="a"><mujoco><size {size}/></mujoco>{link}</robot>')
        assert "it.urdf: <size>" in _refused(path, limit)
    newton = pytest.importorskip("newton")
    (tmp_path / "large.png").write_bytes(claiming_png(10_000, 15_000))
    robot = DOORS["urdf-image"].write(tmp_path, "large.png")
    with pytest.raises(wc.WarpcamError, match=r"large\.png has 150,000,000 image pixels"):
        wc.add_urdf(newton.ModelBuilder(), robot)


@pytest.mark.parametrize("door", DOORS)
def test_bytes_of_files(door: str, tmp_path: Path) -> None:
    _needs(door)
    (tmp_path / f"other{DOORS[door].ending}").write_bytes(DOORS[door].content + b"\n" * 9000)
    path = DOORS[door].write(tmp_path, f"other{DOORS[door].ending}")
    text = _refused(path, "file_bytes of limits is 9,000", wc.Limits(file_bytes=9000))
    assert f"other{DOORS[door].ending} has" in text
    assert "the scene, with all that it names, has" in _refused(path, "scene_bytes", wc.Limits(scene_bytes=9000))


def test_copies_of_one_buffer(tmp_path: Path) -> None:
    """A hundred parts that share their positions, each of which gets its own."""
    pytest.importorskip("trimesh")
    import json

    tree = json.loads(gltf(DATA))
    tree["meshes"][0]["primitives"] *= 100
    (tmp_path / "it.gltf").write_text(json.dumps(tree))
    size = (tmp_path / "it.gltf").stat().st_size
    assert wc.load(tmp_path / "it.gltf", device="cpu", limits=wc.Limits(scene_bytes=size + 9000)).num_worlds == 1
    _refused(tmp_path / "it.gltf", "scene_bytes", wc.Limits(scene_bytes=size + 2000))


def test_instances(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    import json

    tree = json.loads(gltf(DATA))
    tree["accessors"].append({"componentType": 5126, "count": 2_000_000, "type": "VEC3"})
    tree["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}
    (tmp_path / "it.gltf").write_text(json.dumps(tree))
    assert "EXT_mesh_gpu_instancing has 2,000,000 copies" in _refused(tmp_path / "it.gltf", "copies")
    pytest.importorskip("pxr")
    (tmp_path / "it.usda").write_text(
        '#usda 1.0\ndef PointInstancer "many"\n{\n    int[] protoIndices = [0, 0, 0, 0, 0, 0, 0, 0]\n    point3f[] '
        f"positions = [{', '.join(['(1, 0, 0)'] * 8)}]\n    rel prototypes = </many/a>\n"
        '    def Cube "a"\n    {\n    }\n}\n'
    )
    assert wc.load(tmp_path / "it.usda", device="cpu", limits=wc.Limits(copies=40)).num_worlds == 1
    assert "/many has 10 copies" in _refused(tmp_path / "it.usda", "copies", wc.Limits(copies=8))


def _package(path: Path, *entries: tuple[str, bytes], compression: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", compression) as package:
        for name, data in entries:
            package.writestr(name, data)
    return path


STAGE = b'#usda 1.0\ndef Cube "a"\n{\n}\n'


def _overlapping(path: Path) -> Path:
    """Both names have the same bytes: the second's place is that of the first."""
    _package(path, ("a.usda", STAGE), ("b.usda", STAGE + b"#" * 2000))
    data = path.read_bytes()
    start = data.rindex(b"PK\x01\x02")
    first = data.index(b"PK\x01\x02")
    entry = bytearray(data[first:start])
    entry[20:28] = struct.pack("<II", 5000, 5000)
    path.write_bytes(data[:first] + bytes(entry) + data[start:])
    return path


def _deep(path: Path) -> Path:
    data = _package(path, ("a.usda", STAGE)).read_bytes()
    for _ in range(5):
        data = _package(path, ("a.usda", STAGE), ("b.usdz", data)).read_bytes()
    return path


PACKAGES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "up": (lambda path: _package(path, ("a.usda", STAGE), ("../b.usda", STAGE)), r"'\.\./b\.usda', which leads out"),
    "absolute": (lambda path: _package(path, ("a.usda", STAGE), ("/etc/b", STAGE)), "'/etc/b', which leads out"),
    "backslash": (lambda path: _package(path, ("a.usda", STAGE), ("..\\b", STAGE)), "which leads out of the package"),
    "bomb": (
        lambda path: _package(path, ("a.usda", STAGE + b" " * 10_000_000), compression=zipfile.ZIP_DEFLATED),
        "'a.usda' is compressed",
    ),
    "overlap": (_overlapping, "its files have .* bytes, and the package itself has"),
    "deep": (_deep, "packages lie in each other 5 deep, and at most 4 are read"),
}


@pytest.mark.parametrize("kind", PACKAGES)
def test_packages_of_stages(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    write, text = PACKAGES[kind]
    with pytest.raises(wc.WarpcamError, match=rf"it\.usdz.*{text}"):
        wc.load(write(tmp_path / "it.usdz"), device="cpu")


def test_a_plain_package_is_read(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    inner = _package(tmp_path / "b.usdz", ("c.usda", STAGE)).read_bytes()
    path = _package(tmp_path / "it.usdz", ("a.usda", STAGE), ("b.usdz", inner))
    assert wc.load(path, device="cpu").num_worlds == 1


def test_archives_by_other_names(tmp_path: Path) -> None:
    """pycollada would unpack a .dae file that is an archive, also behind the end of a document."""
    pytest.importorskip("collada")
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("it.dae", dae("a.png"))
    for data in (packed.getvalue(), dae("a.png").encode() + packed.getvalue()):
        (tmp_path / "it.dae").write_bytes(data)
        with pytest.raises(wc.WarpcamError, match=r"it\.dae: is an archive; unpack it"):
            wc.load(tmp_path / "it.dae", device="cpu")
    for name in ("it.ply.gz", "it.npz", "it.zip", "it.zae", "it.tar.gz", "it.pkl", "it.npy"):
        (tmp_path / name).write_bytes(packed.getvalue())
        with pytest.raises(wc.WarpcamError, match=f"{re.escape(name)}' came; known are"):
            wc.load(tmp_path / name, device="cpu")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_of_xml(encoding: str, tmp_path: Path) -> None:
    """They open files, and ten of ten of ten are a bomb."""
    pytest.importorskip("collada")
    pytest.importorskip("mujoco_warp")
    (tmp_path / "secret.txt").write_text("0 0 0")
    heads = ('<!DOCTYPE a [<!ENTITY b SYSTEM "secret.txt">]>', '<!DOCTYPE a [<!ENTITY b "ha"><!ENTITY c "&b;&b;&b;">]>')
    for head in heads:
        text = dae("a.png", head).replace('<?xml version="1.0"?>', f'<?xml version="1.0" encoding="{encoding}"?>')
        (tmp_path / "it.dae").write_bytes(text.encode(encoding))
        robot = f'<?xml version="1.0" encoding="{encoding}"?>{head}<robot name="a"><link name="b"/></robot>'
        (tmp_path / "it.urdf").write_bytes(robot.encode(encoding))
        for name in ("it.dae", "it.urdf"):
            with pytest.raises(wc.WarpcamError, match=rf"{name}: declares the XML entity 'b'"):
                wc.load(tmp_path / name, device="cpu")


def test_calibrations_and_recipes_whose_aliases_grow(tmp_path: Path) -> None:
    pytest.importorskip("yaml")
    from warpcam.datasets.generate import read_recipes

    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 10)}]" for level in range(1, 12)]
    path = tmp_path / "it.yaml"
    path.write_text("\n".join(lines))
    for read in (wc.read_calibration, read_recipes):
        with pytest.raises(wc.WarpcamError, match=r"it\.yaml.* copies of limits is 1,000,000"):
            read(path)
        with pytest.raises(wc.WarpcamError, match=r"it\.yaml.* file_bytes of limits is 99"):
            read(path, limits=wc.Limits(file_bytes=99))  # type: ignore[operator]
    path.write_text("a: &a [*a]\n")
    for read in (wc.read_calibration, read_recipes):
        with pytest.raises(wc.WarpcamError, match=r"it\.yaml.* line 1: an entry has itself for a part"):
            read(path)


def test_tables_of_lidars(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """numpy unpacks files by their names, and asks the network for addresses."""
    import gzip

    from warpcam.sensors.patterns import livox_csv, ouster_metadata

    table = "time,azimuth,zenith\n" + "0,1,2\n" * 8
    (tmp_path / "it.csv").write_text(table)
    assert livox_csv(tmp_path / "it.csv", samples=8).directions.shape[-1] == 3
    (tmp_path / "it.csv.gz").write_bytes(gzip.compress(table.encode()))
    with pytest.raises(wc.WarpcamError, match=r"it\.csv\.gz: cannot be read"):
        livox_csv(tmp_path / "it.csv.gz", samples=8)
    monkeypatch.setattr("urllib.request.urlopen", lambda *_, **__: pytest.fail("asks the network"))
    with pytest.raises(wc.WarpcamError, match="cannot be read"):
        livox_csv("http://localhost/it.csv", samples=8)
    for read in (
        lambda limits: livox_csv(tmp_path / "it.csv", samples=8, limits=limits),
        lambda limits: ouster_metadata(tmp_path / "it.csv", limits=limits),
    ):
        with pytest.raises(wc.WarpcamError, match=r"it\.csv has \d+ file bytes, and file_bytes of limits is 9"):
            read(wc.Limits(file_bytes=9))


@pytest.mark.parametrize("value", [0, -1, 1.5, True, "9", None, np.int64(3)])
def test_limits_are_whole_numbers(value: object) -> None:
    with pytest.raises(wc.WarpcamError, match="Limits: elements must be a whole number of at least 1, got"):
        wc.Limits(elements=value)  # type: ignore[arg-type]
