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

// Which of its smooth parts a shape shows at a depth of a ray: a box's sides, a cylinder's side and ends.
template <int LENS> WARPCAM_FN int part_at(const Record& record, const ViewRay<LENS>& ray, float depth)
{
    const Ray local = ray.local(record);
    const Vec p = local.origin + depth * local.direction;
    const float x = p.x * p.x, y = p.y * p.y, z = p.z * p.z;
    if (record.axis_x.w == CYLINDER)
        return x + y < z;
    return x > y && x > z ? 0 : y > z ? 1 : 2;
}

// How far the surface that a sample has hit is turned from those that pixels with the same shape show: two that meet in
// an edge are near each other in depth, but not of one colour.
template <int TYPES, int LENS, class Meshes, class Target> struct TurnedSurface {
    enum Known { NOTHING, FACE, PART };

    const Meshes& meshes;
    const Target& target;
    const Camera& camera;
    Known known;
    unsigned rows;  // where those of the mesh begin
    Vec normal;     // of the face
    Record record;
    int part;

    WARPCAM_FN float operator()(int i, int j, unsigned pixel) const
    {
        if constexpr ((TYPES >> MESH & 1) != 0)
            if (known == FACE)
                return TURNED * (1.0f - dot(normal, face_normal(meshes, rows, int(target.face.data[pixel]))));
        if constexpr ((TYPES & (1 << BOX | 1 << CYLINDER)) != 0)
            if (known == PART)
                return part_at<LENS>(record, view_ray<LENS>(camera, i, j, 0.0f, 0.0f), target.depth.data[pixel]) == part
                    ? 0.0f
                    : TURNED;
        return 0.0f;
    }
};

template <int TYPES, int LENS, class Shapes, class Meshes, class HeightFields, class Target>
WARPCAM_FN TurnedSurface<TYPES, LENS, Meshes, Target>
turned_surface(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields, const Target& target,
               const Camera& camera, const Region& region, int world, const ViewRay<LENS>& ray, float depth, int shape,
               int face)
{
    TurnedSurface<TYPES, LENS, Meshes, Target> turned { meshes, target, camera };
    turned.known = turned.NOTHING;
    if (shape < 0)
        return turned;
    const int type = wp::index(shapes.types, shape);
    if constexpr ((TYPES >> MESH & 1) != 0)
        if (type == MESH && face >= 0) {
            turned.rows = unsigned(wp::index(meshes.face_start, row_of(shapes.assets, world, shape)));
            turned.normal = face_normal(meshes, turned.rows, face);
            turned.known = turned.FACE;
        }
    if constexpr ((TYPES & (1 << BOX | 1 << CYLINDER)) != 0)
        if ((type == BOX || type == CYLINDER)
            && sample_record<TYPES & (1 << BOX | 1 << CYLINDER), LENS>(shapes, meshes, fields, camera, region, world, shape,
                                                                      turned.record)) {
            turned.part = part_at<LENS>(turned.record, ray, depth);
            turned.known = turned.PART;
        }
    return turned;
}

}  // namespace warpcam
