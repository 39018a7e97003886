// The samples of a pixel that an edge runs through: their rays, what these may hit, and the means of their colours.
#pragma once
#include "edges.h"
#include "opacity.h"

namespace warpcam {

// Rows of a region are 64 pixels apart in a pixel's place.
WARPCAM_FN int place_of(const Region& region, int i, int j) { return (j - region.top) * 64 + (i - region.left); }

template <int CHANNELS>
WARPCAM_FN void mean_of_bytes(const unsigned char* image, unsigned char* mean, unsigned pixel,
                              const unsigned (&shown)[SAMPLES])
{
    for (int k = 0; k < CHANNELS; ++k) {
        int total = SAMPLES / 2;
        for (int sample = 0; sample < SAMPLES; ++sample)
            total += image[CHANNELS * size_t(shown[sample]) + k];
        mean[CHANNELS * size_t(pixel) + k] = static_cast<unsigned char>(total / SAMPLES);
    }
}

// Writes a pixel's means; they become the image's when all of them are known.
template <int IMAGES, class Target>
WARPCAM_FN void put_means(const Target& target, unsigned pixel, const unsigned (&shown)[SAMPLES])
{
    if (IMAGES & SMOOTH_RGB)
        mean_of_bytes<3>(target.rgb.data, target.mean_rgb.data, pixel, shown);
    if (IMAGES & SMOOTH_RGBA)
        mean_of_bytes<4>(target.rgba.data, target.mean_rgba.data, pixel, shown);
    if (IMAGES & SMOOTH_HDR)
        for (int k = 0; k < 3; ++k) {
            float total = 0.0f;
            for (int sample = 0; sample < SAMPLES; ++sample)
                total += target.hdr.data[3 * size_t(shown[sample]) + k];
            target.mean_hdr.data[3 * size_t(pixel) + k] = total / float(SAMPLES);
        }
}

// The record of a shape as the view sees it; false if it is not seen.
template <int TYPES, int LENS, class Shapes, class Meshes, class HeightFields>
WARPCAM_FN bool sample_record(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                              const Camera& camera, const Region& region, int world, int id, Record& record)
{
    TileBox tiles;
    return prepare<TYPES, LENS, false>(load_shape(shapes, world, id), camera, region, meshes, fields, record, tiles)
        == SEEN;
}

template <int LENS> WARPCAM_FN ViewRay<LENS> sample_ray(const Camera& camera, int i, int j, int sample)
{
    const Offset offset = sample_offset(sample);
    return view_ray<LENS>(camera, i, j, offset.right, offset.down);
}

template <class Meshes> WARPCAM_FN Vec face_normal(const Meshes& meshes, unsigned first, int face)
{
    const unsigned row = first + unsigned(face * FACE_ROWS);
    const Vec corner = to_vec(load(meshes.faces.data, row));
    return normalized(cross(to_vec(load(meshes.faces.data, row + 1)) - corner,
                            to_vec(load(meshes.faces.data, row + 2)) - corner));
}

// How far the face of a mesh that a sample has hit is turned from those that pixels with the same shape show: two that
// meet in an edge are near each other in depth, but not of one colour.
template <int TYPES, class Meshes, class Target> struct TurnedFaces {
    const Meshes& meshes;
    const Target& target;
    unsigned first;  // of the mesh's rows
    Vec normal;
    bool known;  // what is hit is a mesh

    WARPCAM_FN float operator()(unsigned pixel) const
    {
        if constexpr ((TYPES >> MESH & 1) != 0)
            if (known)
                return TURNED * (1.0f - dot(normal, face_normal(meshes, first, int(target.face.data[pixel]))));
        return 0.0f;
    }
};

template <int TYPES, class Shapes, class Meshes, class Target>
WARPCAM_FN TurnedFaces<TYPES, Meshes, Target> turned_faces(const Shapes& shapes, const Meshes& meshes,
                                                          const Target& target, int world, int shape, int face)
{
    TurnedFaces<TYPES, Meshes, Target> turned { meshes, target, 0, { 0.0f, 0.0f, 0.0f }, false };
    if constexpr ((TYPES >> MESH & 1) != 0)
        if (shape >= 0 && face >= 0 && wp::index(shapes.types, shape) == MESH) {
            turned.first = unsigned(wp::index(meshes.face_start, row_of(shapes.assets, world, shape)));
            turned.normal = face_normal(meshes, turned.first, face);
            turned.known = true;
        }
    return turned;
}

}  // namespace warpcam
