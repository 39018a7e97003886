"""Triangles of meshes: which one a pixel sees, and where on it the hit is."""

from warpcam.kernels.passes.derived import register_derived

# The fourth number of a face's first row in Meshes.faces is the face as it was given. Weights are those of the face's
# own second and third corner: a back goes round its corners the other way, so its weights change places.
register_derived(
    "triangles",
    ("barycentrics", "faces"),
    """
    int face = -1;
    float second = 0.0f, third = 0.0f;
    if (seen.is(warpcam::MESH)) {
        const warpcam::MeshStart start = warpcam::mesh_start<Types>(meshes, seen.pose);
        face = warpcam::face_row(meshes, start.faces + 3 * seen.face).w;
        const bool front = seen.surface.corner == 3 * (start.corners + face);
        second = front ? seen.surface.weight1 : seen.surface.weight2;
        third = front ? seen.surface.weight2 : seen.surface.weight1;
    }
    if (images.faces.data)
        images.faces.data[pixel] = face;
    if (images.barycentrics.data) {
        images.barycentrics.data[2 * size_t(pixel)] = second;
        images.barycentrics.data[2 * size_t(pixel) + 1] = third;
    }
    """,
)
