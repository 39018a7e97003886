"""First use: what a newcomer's first command imports, prints, and needs of the machine."""

import errno
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import fast_compile
import numpy as np
import pytest
import warp as wp
from PIL import Image

import warpcam as wc
from warpcam.sensors.depth_cameras import CAMERA_MODELS
from warpcam.tools import cli, render, startup

PICTURE = ("render", "--worlds", "1", "--size", "12x8", "--camera", "overview", "--outputs", "rgb,depth")
OFFLINE = """
import socket, sys
def refuse(*_): raise AssertionError("the network was asked for")
socket.socket.connect = socket.getaddrinfo = refuse
from warpcam.tools import cli
code = cli.main(sys.argv[1:])
print(*sys.modules, sep=",")
sys.exit(code)
"""
# Packages of other commands, and of other sources: each takes a second to import, or a library of windows with it.
UNWANTED = {"torch", "mujoco_warp", "newton", "glfw", "matplotlib", "pandas", "jax", "trimesh", "rsl_rl", "viser"}
UNWANTED |= {"warpcam.sensors", "warpcam.datasets", "warpcam.train", "warpcam.benchmarks", "warpcam.viewer"}


def run(code: str, *arguments: str, folder: Path, **variables: str | None) -> subprocess.CompletedProcess[str]:
    """A program in a process of its own and an empty folder, with kernels of other tests; None unsets a variable."""
    left_out = {name for name, value in variables.items() if value is None} | {"MUJOCO_GL"}
    environment = {name: value for name, value in os.environ.items() if name not in left_out}
    environment.update({name: value for name, value in variables.items() if value is not None})
    command = [sys.executable, fast_compile.__file__, "-c", code, *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def test_a_picture_without_network_and_noise(tmp_path: Path) -> None:
    done = run(OFFLINE, *PICTURE, "--device", "cpu", folder=tmp_path, CUDA_VISIBLE_DEVICES="")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    *pictures, rate, modules = done.stdout.splitlines()
    assert pictures == ["warpcam-out/overview-rgb.png", "warpcam-out/overview-depth.png"]
    assert rate.startswith("1 worlds x 1 cameras of 12x8 (rgb, depth): ")
    with Image.open(tmp_path / pictures[0]) as picture:
        assert np.ptp(np.asarray(picture)) > 50
    assert not UNWANTED & set(modules.split(","))


TENSORS_OF_EACH_FRAME = """
import warpcam
def draw(self, *given, draw=warpcam.Renderer.draw): draw(self, *given), self.images
warpcam.Renderer.draw = draw
"""


def test_an_import_that_is_not_wanted_is_seen(tmp_path: Path) -> None:
    code = TENSORS_OF_EACH_FRAME + OFFLINE
    done = run(code, *PICTURE, "--device", "cpu", folder=tmp_path, CUDA_VISIBLE_DEVICES="")
    assert done.returncode == 0, done.stdout + done.stderr
    assert UNWANTED & set(done.stdout.splitlines()[-1].split(",")) == {"torch"}


STARTED = """
import os, warp as wp
from warpcam.tools import startup
startup.start_warp()
print(os.access(wp.config.kernel_cache_dir, os.W_OK), wp.config.kernel_cache_dir)
"""


def test_a_home_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "home").write_text("a file, below which nothing can be made")
    home = str(tmp_path / "home")
    done = run(STARTED, folder=tmp_path, HOME=home, WARP_CACHE_PATH=None, XDG_CACHE_HOME=None)
    assert done.returncode == 0, done.stderr
    writable, folder = done.stdout.split()
    assert writable == "True" and not folder.startswith(home)
    assert not Path(folder).exists()  # once the process has ended
    (line,) = done.stderr.splitlines()
    assert home in line and "set WARP_CACHE_PATH to a folder for them" in line


def test_without_any_folder_the_variables_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", "/root/.cache/warp")

    monkeypatch.setattr(startup, "init_quietly", full)
    monkeypatch.setattr("tempfile.mkdtemp", full)
    with pytest.raises(wc.WarpcamError, match=r"'/root/\.cache/warp' cannot be made \(Read-only.*WARP_CACHE_PATH"):
        startup.start_warp()


def test_kernels_that_cannot_be_written() -> None:
    folder = Path(str(wp.config.kernel_cache_dir)) / "wp_shadow"
    for error in (
        OSError(errno.EROFS, "Read-only file system", str(folder)),
        FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']"),
    ):
        with (
            pytest.raises(wc.WarpcamError, match=r"set WARP_CACHE_PATH .* and TMPDIR"),
            startup.unwritable_folders_named(),
        ):
            raise error
    with pytest.raises(FileNotFoundError), startup.unwritable_folders_named():
        raise FileNotFoundError(errno.ENOENT, "No such file or directory", "scene.xml")


def test_other_lines_of_native_code_are_kept(capfd: pytest.CaptureFixture[str]) -> None:
    with startup._without_line(startup.NO_DRIVER):
        os.write(2, startup.NO_DRIVER + b".\nsomething else\n")
    assert capfd.readouterr().err == "something else\n"


def test_a_folder_of_pictures_is_tried_before_all_work(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    broken = tmp_path / "broken.xml"
    broken.write_text("<no model/>")
    assert cli.main(["render", str(broken), "--device", "cpu", "--out", str(tmp_path / "file" / "out")]) == 2
    assert "--out: " in capsys.readouterr().err


def test_without_viser_the_command_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    for name in ("warpcam.viewer", "warpcam.tools.view"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(SystemExit) as end:
        cli.main(["view", "--help"])
    assert end.value.code == 0
    assert cli.main(["view", "--device", "cpu"]) == 2
    assert "pip install 'warpcam[view]'" in capsys.readouterr().err


def test_sensors_of_the_command_are_those_there_are() -> None:
    assert tuple(CAMERA_MODELS) == render.SENSORS


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_has_its_arguments_and_its_work(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    about, arguments, work = cli.COMMANDS[name]
    assert callable(import_module(arguments).add) and callable(import_module(work).run)
    with pytest.raises(SystemExit) as end:
        cli.main([name, "--help"])
    assert end.value.code == 0
    assert f"usage: warpcam {name}" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    assert about in " ".join(capsys.readouterr().out.split())
