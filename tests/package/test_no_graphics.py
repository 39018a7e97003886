"""No graphics library comes into the process: not with the package, not with a frame."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

GRAPHICS = re.compile(r"lib(GL|GLX|GLU|GLEW|EGL|GLESv\d|OpenGL|OSMesa|glfw|vulkan|GLdispatch|glapi|gbm|nvidia-gl\w*)\b")

# Prints which graphics libraries are mapped after each step.
LOADED = f"""
import re
def loaded(step):
    with open("/proc/self/maps") as maps:
        names = {{line.split("/")[-1].strip() for line in maps if "/" in line}}
    found = sorted(name for name in names if re.match(r"{GRAPHICS.pattern}", name))
    print(step, *found, sep=",")
"""
CORE = """
import warpcam
loaded("package")
"""
FRAME = """
import mujoco
loaded("mujoco")
import warpcam as wc
loaded("package")
mjm = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
mjd = mujoco.MjData(mjm)
mujoco.mj_forward(mjm, mjd)
camera = wc.Camera("eye", width=9, height=9, outputs=("depth",), lens=wc.Pinhole(fovy=45.0), position=(0, 0, 3))
images = wc.Renderer(wc.from_mujoco(mjm, mjd), [camera]).render()
assert abs(float(images["eye"]["depth"][0, 4, 4, 0]) - 2.0) < 1e-5
loaded("frame")
import mujoco_warp as mjw
import warp as wp
with wp.ScopedDevice("cpu"):
    wc.Renderer(wc.from_mujoco_warp(mjm, mjw.put_model(mjm), mjw.put_data(mjm, mjd)), [camera]).render()
loaded("warp frame")
"""

pytestmark = pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="only Linux tells what is mapped")


def steps(code: str, mujoco_gl: str | None) -> dict[str, set[str]]:
    """Graphics libraries in a process of its own, after each step of the code."""
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    if mujoco_gl is not None:
        environment["MUJOCO_GL"] = mujoco_gl
    done = subprocess.run(
        [sys.executable, "-c", LOADED + code], env=environment, cwd="/", capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    steps_of_code = re.compile(r"(package|mujoco|(warp )?frame)\b")
    lines = [line.split(",") for line in done.stdout.splitlines() if steps_of_code.match(line)]
    return {step: set(found) for step, *found in lines}


def test_the_package_alone() -> None:
    assert steps(CORE, None) == {"package": set()}


def test_a_frame() -> None:
    """MuJoCo itself is told to leave graphics alone."""
    assert steps(FRAME, "disable") == {step: set() for step in ("mujoco", "package", "frame", "warp frame")}


def test_we_add_nothing_to_what_mujoco_loads() -> None:
    """MuJoCo loads a window library when it is imported, unless told otherwise."""
    found = steps(FRAME, None)
    assert found["package"] == found["frame"] == found["warp frame"] == found["mujoco"]


def test_a_graphics_library_would_be_seen() -> None:
    """The judge itself: with glfw, which MuJoCo imports, something is found."""
    pytest.importorskip("glfw")
    assert steps("import glfw\nloaded('package')", None)["package"]
