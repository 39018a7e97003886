"""Draw the files that demo.xml needs: ``python warpcam/data/make_assets.py``.

Writes, beside itself, ``vase.obj`` and ``vase.png`` (a mesh with texture coordinates and its texture) and
``hills.png`` and ``terrain.png`` (the heights of the height field and its colours). Nothing is random.
"""

from pathlib import Path

import numpy as np
from PIL import Image

FOLDER = Path(__file__).parent

# The vase's outline from foot to lip: radius, height [m].
OUTLINE = np.array(
    [
        (0.000, 0.000),
        (0.095, 0.000),
        (0.100, 0.012),
        (0.080, 0.030),
        (0.098, 0.070),
        (0.142, 0.130),
        (0.162, 0.190),
        (0.150, 0.250),
        (0.108, 0.305),
        (0.068, 0.345),
        (0.062, 0.372),
        (0.082, 0.402),
        (0.098, 0.412),
        (0.090, 0.418),
        (0.050, 0.372),
        (0.000, 0.360),
    ]
)
AROUND = 40  # faces around the vase

# Height of the ground [0, 1] and the colour there.
GROUND = [
    (0.00, (214, 196, 150)),
    (0.16, (190, 178, 120)),
    (0.30, (112, 148, 82)),
    (0.52, (70, 112, 70)),
    (0.68, (124, 112, 98)),
    (0.84, (158, 150, 144)),
    (1.00, (250, 250, 252)),
]


def vase_mesh() -> str:
    """The outline turned around z, as the text of an OBJ file with texture coordinates."""
    angles = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    steps = np.linalg.norm(np.diff(OUTLINE, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    lines = ["# A vase: an outline turned around z. Written by make_assets.py."]
    for radius, height in OUTLINE:
        lines += [f"v {radius * np.cos(a):.5f} {radius * np.sin(a):.5f} {height:.5f}" for a in angles]
    for v in along:
        lines += [f"vt {u:.5f} {v:.5f}" for u in np.linspace(0.0, 1.0, AROUND + 1)]
    for ring in range(len(OUTLINE) - 1):
        for i in range(AROUND):
            a = ring * (AROUND + 1) + i + 1
            b, c, d = a + 1, a + AROUND + 2, a + AROUND + 1
            if OUTLINE[ring, 0] > 0.0:
                lines.append(f"f {a}/{a} {b}/{b} {c}/{c}")
            if OUTLINE[ring + 1, 0] > 0.0:
                lines.append(f"f {a}/{a} {c}/{c} {d}/{d}")
    return "\n".join(lines) + "\n"


def vase_texture(width: int = 256, height: int = 256) -> Image.Image:
    """Glazed bands and waves; repeats around the vase without a seam."""
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, 1.0 - (np.arange(height) + 0.5) / height)
    cream, blue, rust = np.array([238, 228, 208]), np.array([38, 74, 122]), np.array([176, 82, 48])
    pixels = np.broadcast_to(cream, (height, width, 3)).astype(np.float64).copy()
    wave = np.abs(v - 0.42 - 0.035 * np.sin(2 * np.pi * 8 * u))
    pixels[wave < 0.022] = rust
    for low, high in ((0.0, 0.13), (0.24, 0.27), (0.29, 0.30), (0.53, 0.54), (0.56, 0.59), (0.70, 1.0)):
        pixels[(v >= low) & (v < high)] = blue
    return Image.fromarray(pixels.astype(np.uint8))


def hills(width: int = 96, height: int = 64) -> np.ndarray:
    """Heights in [0, 1], (height, width); 0 along the border, so that the hills rise out of the floor."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, width), np.linspace(-1.0, 1.0, height))
    ground = np.zeros_like(x)
    for cx, cy, spread, top in ((-0.45, 0.1, 0.32, 1.0), (0.35, 0.2, 0.38, 0.72), (0.05, -0.35, 0.30, 0.38)):
        ground += top * np.exp(-((x - cx) ** 2 + 0.6 * (y - cy) ** 2) / (2.0 * spread**2))
    ground += 0.07 * np.sin(9.0 * x + 2.0 * y) * np.cos(7.0 * y - 3.0 * x) * ground
    ground += 0.03 * np.sin(23.0 * x - 11.0 * y) * np.sin(19.0 * y + 5.0 * x) * ground
    rim = np.clip(4.0 * (1.0 - np.abs(x)), 0.0, 1.0) * np.clip(4.0 * (1.0 - np.abs(y)), 0.0, 1.0)
    ground = np.clip(ground, 0.0, None) * rim * rim * (3.0 - 2.0 * rim)
    return ground / ground.max()


def terrain(heights: np.ndarray) -> Image.Image:
    """Colours by height: sand, grass, forest, rock, snow."""
    levels = [level for level, _ in GROUND]
    channels = [np.interp(heights, levels, [color[k] for _, color in GROUND]) for k in range(3)]
    return Image.fromarray(np.stack(channels, axis=-1).astype(np.uint8))


def main() -> None:
    heights = hills()
    (FOLDER / "vase.obj").write_text(vase_mesh())
    vase_texture().save(FOLDER / "vase.png", optimize=True)
    Image.fromarray(np.round(255.0 * heights).astype(np.uint8)).save(FOLDER / "hills.png", optimize=True)
    terrain(hills(192, 128)).save(FOLDER / "terrain.png", optimize=True)


if __name__ == "__main__":
    main()
