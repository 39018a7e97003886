"""``warpcam doctor``: what it tells of a machine, and that it sees what is wrong with one."""

import functools
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fast_compile
import numpy as np
import pytest
import torch
import warp as wp

from warpcam.kernels.runtime import cpu_pool
from warpcam.tools import cli, doctor, self_test
from warpcam.tools.self_test import shoot

CPU = wp.get_device("cpu")

Change = Callable[[dict[str, np.ndarray]], None]


@functools.cache
def one() -> self_test.RenderedFrame:
    return shoot(CPU)


def copies() -> dict[str, np.ndarray]:
    return {name: image.copy() for name, image in one().images.items()}


def changed(output: str, where: Any, value: Any) -> Change:
    """A device's fault: some pixels of an image are other ones."""

    def change(images: dict[str, np.ndarray]) -> None:
        images[output][where] = value

    return change


def made(output: str, of: Callable[[np.ndarray], Any]) -> Change:
    """A device's fault: an image is another one."""

    def change(images: dict[str, np.ndarray]) -> None:
        images[output][:] = of(images[output])

    return change


def shifted(images: dict[str, np.ndarray]) -> None:
    for image in images.values():
        image[:] = np.roll(image, 1, axis=2)


def upside_down(images: dict[str, np.ndarray]) -> None:
    for image in images.values():
        image[:] = image[:, ::-1]


def stale(images: dict[str, np.ndarray]) -> None:
    for image in images.values():
        image[3] = 0


def darkened(images: dict[str, np.ndarray]) -> None:
    images["rgb"][2] //= 2


# What a broken device might make, and what is said of it.
FAULTS: dict[str, tuple[Change, str]] = {
    "nothing": (changed("segmentation", ..., 0), "the ball is not seen"),
    "one world is left out": (stale, "the ball is not seen"),
    "depth along the ray": (made("depth", lambda depth: 1.02 * depth), "the wall is .* from where it is"),
    "depth a little off": (made("depth", lambda depth: depth + 1e-3), "the wall is .* from where it is"),
    "one depth is not a number": (changed("depth", (0, 5, 5), np.nan), "the wall is nan m from where it is"),
    "one depth": (changed("depth", (2, 0, 0), 2.5), "the wall is 0.5 m"),
    "another shape": (changed("segmentation", (1, 7, 7), 5), "shape 5 is seen, and there are 3"),
    "shifted": (shifted, "the ball is .* from where it is"),
    "upside down": (upside_down, "the ball is .* from where it is"),
    "no colour": (changed("rgb", ..., 90), "the colours are all alike"),
    "no shadow": (made("rgb", lambda rgb: np.maximum(rgb, 60)), "colours of .* are not"),
    "red and blue": (made("rgb", lambda rgb: rgb[..., ::-1]), "colours of .* are not the CPU's"),
    "one world's colours": (darkened, "colours of .* are not the CPU's"),
}


def card(alias: str = "cuda:0") -> Any:
    """A GPU that is not there."""
    return SimpleNamespace(
        alias=alias,
        name="Abacus 9000",
        is_cpu=False,
        uuid="GPU-11111111",
        pci_bus_id="00000000:01:00",
        arch=90,
        total_memory=2**37,
        free_memory=2**36,
    )


def two_devices(monkeypatch: pytest.MonkeyPatch, change: Change = lambda _: None, torch_sees: int = 1) -> Any:
    """A report about a CPU and a GPU whose images are the CPU's, changed."""

    def shoot(device: Any) -> self_test.RenderedFrame:
        images = copies()
        if not device.is_cpu:
            change(images)
        return self_test.RenderedFrame(images, 1.0, 0.001)

    monkeypatch.setattr(self_test, "shoot", shoot)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: torch_sees)
    return doctor.examine([CPU, card()])


def text_of(report: Any) -> str:
    console = doctor.Console(width=200)
    with console.capture() as capture:
        console.print(doctor.screen_of(report))
    return capture.get()


def test_every_device_of_this_machine_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor"]) == 0
    printed = capsys.readouterr().out
    for word in ("python", "warp-lang", "mujoco-warp", "gymnasium", "CUDA_VISIBLE_DEVICES", "kernels", "all is well"):
        assert word in printed
    for device in wp.get_devices():
        assert re.search(rf"{device.alias} +passed +first frame after .* s, then .* ms", printed)
        assert device.is_cpu or device.uuid in printed


def test_for_programs(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["doctor", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["ok"] is True
    assert told["problems"] == []
    assert told["packages"]["warp-lang"] == wp.__version__
    assert [each["alias"] for each in told["devices"]] == [device.alias for device in wp.get_devices()]
    assert [each["device"] for each in told["renders"]] == [device.alias for device in wp.get_devices()]
    assert all(each["passed"] and each["frame"] > 0.0 for each in told["renders"])


def test_a_process_prints_nothing_but_json() -> None:
    """Neither what Warp says when it starts nor warnings get between."""
    program = ["-c", "import sys; from warpcam.tools import cli; sys.exit(cli.main(sys.argv[1:]))", "doctor"]
    variables = {**os.environ, "MUJOCO_EGL_DEVICE_ID": "3"}
    quick = [sys.executable, fast_compile.__file__, *program, "--json"]
    done = subprocess.run(quick, env=variables, capture_output=True, text=True, timeout=300)
    told = json.loads(done.stdout)
    assert (done.returncode, told["ok"]) == (0, True)
    assert {"name": "MUJOCO_EGL_DEVICE_ID", "value": "3", "meaning": doctor._IGNORED} in told["environment"]
    imports = "import sys\nfrom warpcam.tools.cli import main\n"
    twice = imports + "print(main(['doctor']))\nsys.exit(main(['doctor', '--json']))"
    nowhere = {**os.environ, "WARP_CACHE_PATH": "/proc/nowhere"}
    broken = subprocess.run([sys.executable, "-c", twice], env=nowhere, capture_output=True, text=True, timeout=300)
    assert broken.returncode == 1 and "Traceback" not in broken.stderr
    text, form = broken.stdout.split("\n1\n")
    for problem in (text, json.loads(form)["problems"][0]):
        assert "Warp does not start" in problem and "/proc/nowhere" in problem and "WARP_CACHE_PATH" in problem


def test_a_mistake_prints_nothing_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["doctor", "--jsn"])
    printed = capsys.readouterr()
    assert printed.out == "" and "--jsn" in printed.err


def test_a_gpu_is_told_with_all_its_names(monkeypatch: pytest.MonkeyPatch) -> None:
    report = two_devices(monkeypatch)
    assert report.problems == []
    assert report.renders[1] == doctor.Render("cuda:0", True, None, 1.0, 0.001, 0.0)
    text = text_of(report)
    assert re.search(r"cuda:0 +Abacus 9000 +64.0 of 128.0 GiB free +sm_90 +GPU-11111111 +PCI 00000000:01:00", text)
    assert re.search(r"cuda:0 +passed .* and the CPU: 0.00% of the pixels differ", text)


@pytest.mark.parametrize("which", FAULTS)
def test_a_device_that_renders_something_else_is_told(which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    change, said = FAULTS[which]
    report = two_devices(monkeypatch, change)
    (problem,) = report.problems
    assert re.match(f"cuda:0: .*{said}", problem)
    assert [render.passed for render in report.renders] == [True, False]
    assert f"PROBLEM {problem}" in text_of(report)


def test_pixels_at_edges_may_differ_by_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    ids = one().images["segmentation"]
    _, row, column, _ = np.argwhere(ids[:, :, 1:] != ids[:, :, :-1])[0]

    def neighbour(images: dict[str, np.ndarray]) -> None:
        for image in images.values():
            image[0, row, column] = image[0, row, column + 1]

    assert two_devices(monkeypatch, made("rgb", lambda rgb: rgb + (rgb < 250))).problems == []
    images = copies()
    neighbour(images)
    share, problem = self_test.difference(images, one().images)
    assert 0.0 < share < 1e-3
    assert problem is None


def test_the_exit_status_tells(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(self_test, "fault", lambda images: "it is dark")
    assert cli.main(["doctor"]) == 1
    assert "PROBLEM cpu: it is dark" in capsys.readouterr().out
    assert cli.main(["doctor", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["ok"] is False


def test_a_device_without_images_does_not_stop_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def shoot(device: Any) -> self_test.RenderedFrame:
        if device.alias == "cuda:0":
            raise AssertionError("Torch not compiled with CUDA enabled")
        return self_test.RenderedFrame(copies(), 1.0, 0.001)

    monkeypatch.setattr(self_test, "shoot", shoot)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    monkeypatch.setattr(torch.version, "cuda", None)
    report = doctor.examine([CPU, card(), card("cuda:1")])
    assert [render.passed for render in report.renders] == [True, False, True]
    assert report.problems == [
        "cuda:0: no images: AssertionError: Torch not compiled with CUDA enabled",
        "Warp sees 2 GPUs, torch 0: this torch was built without CUDA, and images on a GPU are torch tensors; install "
        "one that has it",
    ]


def test_a_torch_that_sees_more(monkeypatch: pytest.MonkeyPatch) -> None:
    (problem,) = two_devices(monkeypatch, torch_sees=2).problems
    assert problem.startswith("Warp sees 1 GPUs, torch 2: nothing can be rendered on the others")


def test_variables_are_told_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in doctor.VARIABLES:
        monkeypatch.delenv(name, raising=False)
    assert [each.name for each in doctor.read_environment()] == ["CUDA_VISIBLE_DEVICES"]
    monkeypatch.setattr(doctor.device_rule, "driver_installed", lambda: False)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", " 2")
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "3")
    report = two_devices(monkeypatch)
    assert [(each.name, each.value) for each in report.environment] == [
        ("CUDA_VISIBLE_DEVICES", " 2"),
        ("MUJOCO_EGL_DEVICE_ID", "3"),
    ]
    spaces, missing = report.remarks
    assert spaces.startswith("CUDA_VISIBLE_DEVICES=' 2' has spaces")
    assert missing.startswith("CUDA_VISIBLE_DEVICES=' 2' names GPUs, but there is no CUDA driver")
    assert report.problems == []
    for hidden in ("", "-1"):  # on purpose
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", hidden)
        assert two_devices(monkeypatch).remarks == []
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "2\t")
    assert two_devices(monkeypatch).remarks[0].startswith("CUDA_VISIBLE_DEVICES='2\\t' has spaces")
    assert re.search(r"MUJOCO_EGL_DEVICE_ID +'3' +chooses a GPU for OpenGL; ignored here", text_of(report))


def test_a_list_that_cuda_does_not_show_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0,7")
    monkeypatch.setattr(doctor.device_rule, "driver_installed", lambda: True)
    monkeypatch.setattr(doctor.device_rule.wp, "get_cuda_device_count", lambda: 1)
    (remark,) = two_devices(monkeypatch).remarks
    assert remark.startswith("CUDA_VISIBLE_DEVICES='0,7': it names 2, and CUDA shows 1")


@pytest.mark.parametrize(
    ("value", "threads"), [("3", 3), (" 2", 2), ("2 ", 2), ("0", 0), ("-1", 0), ("two", 0), ("²", 0)]
)
def test_how_many_threads_a_cpu_has(
    value: str, threads: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A text that is no such number is told, not passed over."""
    cpu_pool.cpu_threads.cache_clear()
    monkeypatch.setenv("WARPCAM_CPU_THREADS", value)
    try:
        cores = cpu_pool.cpu_threads()
        (meaning,) = [each.meaning for each in doctor.read_environment() if each.name == "WARPCAM_CPU_THREADS"]
        remarks = [each for each in two_devices(monkeypatch).remarks if "no whole number" in each]
    finally:
        cpu_pool.cpu_threads.cache_clear()
    assert cores == (threads or len(os.sched_getaffinity(0)))
    assert meaning == f"a frame on the CPU is split over {cores} threads"
    said = [] if threads else [f"WARPCAM_CPU_THREADS={value!r} is no whole number above 0"]
    assert [each.split(",")[0] for each in remarks] == said
    assert [each.split(";")[0] for each in caplog.messages] == said


def test_a_folder_that_keeps_no_trees_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WARPCAM_CACHE_DIR", str(tmp_path / "new" / "folder"))
    assert two_devices(monkeypatch).remarks == []
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WARPCAM_CACHE_DIR", str(tmp_path / "file" / "folder"))
    (remark,) = two_devices(monkeypatch).remarks
    assert remark.startswith("trees of large meshes are built anew in each program: ")
    assert str(tmp_path / "file") in remark and "WARPCAM_CACHE_DIR" in remark
