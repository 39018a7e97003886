"""A light without shade and a camera with antialiasing, for tests of smooth edges."""

import scenes

import warpcam as wc

LIT = '<visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>'


def camera(samples: int, **changes: object) -> wc.Camera:
    settings = {"outputs": ("rgb",), "position": (0.0, 0.0, 2.0), "rotation": (1.0, 0.0, 0.0, 0.0)}
    return scenes.own_camera(antialiasing=samples, **{**settings, **changes})
