"""Labels of what a renderer draws: boxes, masks' sizes, poses and keypoints of each instance, on the device."""
