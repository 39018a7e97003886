"""Options of front ends that choose which parts of a Newton model are drawn."""

from dataclasses import dataclass


@dataclass(frozen=True)
class NewtonOptions:
    """Decided when the scene is made: it is what the scene is made of.

    Attributes:
        simulated: Whether the triangles of cloth and soft bodies are drawn. None: those that no visual mesh stands for.
        visual: Whether visual meshes are drawn.
        smooth: Whether visual meshes are smooth; else their faces are flat.
        backs: Whether meshes are seen from behind, too. None: open ones of what is soft are.
        particles: Whether loose particles are drawn.
        shared: Whether what belongs to no world is drawn, in all of them.
        solid: Whether Gaussian splats are a surface that is not seen through, and nothing where they are none; what
            that takes is then written into ``Parts.splat_limits``.
        lit_normals: Whether the output ``normals`` has those of meshes as light takes them, scaled after they are
            interpolated; else those of their faces.
        triplanar: Whether a texture on what has no texture coordinates is blended of three, one along each axis.
        textures: Whether the model's own textures are there; without, none of their files is read.
    """

    simulated: bool | None = None
    visual: bool = True
    smooth: bool = True
    backs: bool | None = None
    particles: bool = True
    shared: bool = True
    solid: bool = False
    lit_normals: bool = False
    triplanar: bool = False
    textures: bool = True
