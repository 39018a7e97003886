"""Labels of two worlds, drawn over their images in labels.png.

Green: tight boxes of what is visible; white: amodal boxes; yellow: corners of oriented boxes; circles: keypoints,
filled if they are visible.
"""

import mujoco
import mujoco_warp as mjw
from PIL import Image, ImageDraw

import warpcam as wc

SCENE = """
<mujoco>
  <worldbody>
    <light pos="1 -2 4" dir="-0.2 0.4 -1" directional="true"/>
    <camera name="front" pos="0 -2.2 1.1" xyaxes="1 0 0 0 0.4 1"/>
    <geom type="plane" size="0 0 1" rgba="0.8 0.8 0.75 1"/>
    <body name="crate" pos="-0.4 0.4 0.3"><joint axis="0 0 1"/>
      <geom type="box" size="0.3 0.3 0.3" rgba="0.9 0.5 0.1 1"/>
      <site name="near corner" pos="0.3 -0.3 0.3" size="0.001"/>
      <site name="far corner" pos="-0.3 0.3 -0.3" size="0.001"/>
    </body>
    <body name="ball" pos="0 -0.2 0.25"><joint type="slide" axis="1 0 0"/>
      <geom size="0.25" rgba="0.7 0.2 0.3 1"/><site name="top" pos="0 0 0.25" size="0.001"/>
    </body>
  </worldbody>
</mujoco>
"""

mjm = mujoco.MjModel.from_xml_string(SCENE)
mjd = mujoco.MjData(mjm)
mujoco.mj_forward(mjm, mjd)
m, d = mjw.put_model(mjm), mjw.put_data(mjm, mjd, nworld=2)
d.qpos.assign([[0.5, 0.0], [1.2, 0.4]])

renderer = wc.Renderer(
    wc.from_mujoco_warp(mjm, m, d), [wc.Camera("front", width=320, height=240, outputs=("rgb", "bodies"))]
)
labels = wc.labels(renderer, ids=[1, 2], keypoints=wc.site_keypoints(mjm))
images = renderer.render(forward=True)["front"]
found = labels.read()["front"]

sheet = Image.new("RGB", (640, 240))
for world in range(2):
    picture = Image.fromarray(images["rgb"][world].cpu().numpy())
    draw = ImageDraw.Draw(picture)
    for instance in range(2):
        for boxes, color in ((found.amodal_boxes, "white"), (found.visible_boxes, "lime")):
            x0, y0, x1, y1 = boxes[world, instance].tolist()
            draw.rectangle((x0, y0, x1 - 1, y1 - 1), outline=color)
        draw.point([tuple(corner) for corner in found.corners[world, instance].tolist()], fill="yellow")
        name, depth = mjm.body(int(labels.ids[world, instance])).name, found.depths[world, instance]
        share = 100 * found.visibility[world, instance]
        print(f"world {world}: {share:.0f} % of the {name} can be seen, {depth:.2f} m away")
    for (x, y), visible in zip(found.keypoints[world].tolist(), found.keypoint_visibility[world].tolist(), strict=True):
        draw.ellipse((x - 3, y - 3, x + 3, y + 3), outline="cyan", fill="cyan" if visible == 2 else None)
    sheet.paste(picture, (320 * world, 0))
sheet.save("labels.png")
