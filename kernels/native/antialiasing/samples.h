// The samples of a pixel that an edge runs through: their rays, what these may hit, and the means of their colours.
#pragma once
#include "antialiasing/edge_test.h"
#include "geometry/shape_state.h"

namespace warpcam {

// Rows of a region are 64 pixels apart in a pixel's place.
WARPCAM_DEVICE int place_of(const Region& region, int i, int j) { return (j - region.top) * 64 + (i - region.left); }

// Some rows of numbers from one array to another, by all threads of a block.
template <class Number>
WARPCAM_DEVICE void copy_rows(const Number* from, Number* to, size_t first, int line, int width, int height)
{
#if defined(__CUDA_ARCH__)
    constexpr int STEP = WARP_SIZE, ROWS = THREADS / WARP_SIZE, BATCH = 8;  // rows that a warp has under way
    const int column = threadIdx.x % WARP_SIZE, row = threadIdx.x / WARP_SIZE;
#else
    constexpr int STEP = 1, ROWS = 1, BATCH = 1, column = 0, row = 0;
#endif
    for (int j = row; j < height; j += ROWS * BATCH)
#pragma unroll 1
        for (int k = column; k < width; k += STEP) {
            Number numbers[BATCH];
#pragma unroll
            for (int n = 0; n < BATCH; ++n)
                numbers[n] = from[first + size_t(min(j + n * ROWS, height - 1)) * line + k];
#pragma unroll
            for (int n = 0; n < BATCH; ++n)
                if (j + n * ROWS < height)
                    to[first + size_t(j + n * ROWS) * line + k] = numbers[n];
        }
}

// The images of a region as they were lit, where no edge is: to all of it, before there are means. `first` is the
// view's first pixel in the images.
template <int IMAGES, class Target>
WARPCAM_DEVICE void copy_lit(const Target& target, const Region& region, size_t first)
{
    const int width = min(region.width, target.width - region.left);
    const int height = min(region.height, target.height - region.top);
    const auto copy = [&](const auto& from, const auto& to, int channels) {  // of four bytes, or of as many
        copy_rows(from, to, channels * (first + size_t(region.top) * target.width + region.left),
                  channels * target.width, channels * width, height);
    };
    if (IMAGES & SMOOTH_RGB) {
        const size_t begin = first + size_t(region.top) * target.width + region.left;
        if (target.width % 4 == 0)  // three words are four pixels
            copy_rows(reinterpret_cast<const unsigned*>(target.rgb.data),
                      reinterpret_cast<unsigned*>(target.smooth_rgb.data), begin / 4 * 3, target.width / 4 * 3,
                      width / 4 * 3, height);
        else
            copy(target.rgb.data, target.smooth_rgb.data, 3);
    }
    if (IMAGES & SMOOTH_RGBA)
        copy(reinterpret_cast<const unsigned*>(target.rgba.data), reinterpret_cast<unsigned*>(target.smooth_rgba.data),
             1);
    if (IMAGES & SMOOTH_HDR)
        copy(target.hdr.data, target.smooth_hdr.data, 3);
}

// The mean of the pixels that a pixel's samples show, of 8 bits a channel.
template <int IMAGES, class Centres>
WARPCAM_DEVICE unsigned mean_bytes(const Centres& centres, const unsigned (&shown)[SAMPLES])
{
    constexpr unsigned EVERY_OTHER = 0x00ff00ff;
    unsigned even = 0x00020002, odd = 0x00020002;  // half of four, rounding up
    for (int sample = 0; sample < SAMPLES; ++sample) {
        const unsigned bytes = centres.template bytes<IMAGES>(shown[sample]);
        even += bytes & EVERY_OTHER;
        odd += bytes >> 8 & EVERY_OTHER;
    }
    static_assert(SAMPLES == 4, "means are quarters");
    return (even >> 2 & EVERY_OTHER) | (odd >> 2 & EVERY_OTHER) << 8;
}

// Writes it at the pixel's index in the images.
template <int IMAGES, class Target> WARPCAM_DEVICE void put_bytes(const Target& target, size_t at, unsigned mean)
{
    for (int k = 0; k < 3 && (IMAGES & SMOOTH_RGB); ++k)
        target.smooth_rgb.data[3 * at + k] = static_cast<unsigned char>(mean >> 8 * k);
    for (int k = 0; k < 4 && (IMAGES & SMOOTH_RGBA); ++k)
        target.smooth_rgba.data[4 * at + k] = static_cast<unsigned char>(mean >> 8 * k);
}

// Writes the means of the pixels that a pixel's samples show, at its index in the images.
template <int IMAGES, class Centres>
WARPCAM_DEVICE void put_means(const Centres& centres, size_t at, const unsigned (&shown)[SAMPLES])
{
    const auto& target = centres.target;
    if (IMAGES & (SMOOTH_RGB | SMOOTH_RGBA))
        put_bytes<IMAGES>(target, at, mean_bytes<IMAGES>(centres, shown));
    if (IMAGES & SMOOTH_HDR)
        for (int k = 0; k < 3; ++k) {
            float total = 0.0f;
            for (int sample = 0; sample < SAMPLES; ++sample)
                total += target.hdr.data[3 * size_t(centres.of_images(shown[sample])) + k];
            target.smooth_hdr.data[3 * at + k] = total / float(SAMPLES);
        }
}

// The record of a shape as the view sees it, with its id at the origin; false if it is not seen. Who lists it gives it
// its place in the list for an id: what is hit then leads to it.
template <class Types, int LENS, class Shapes, class Meshes, class HeightFields>
WARPCAM_DEVICE bool sample_record(const Shapes& shapes, const Meshes& meshes, const HeightFields& fields,
                                  const Camera& camera, const Region& region, int world, int id, ShapeRecord& record)
{
    TileRect tiles;
    const bool seen =
        setup_shape<Types, LENS, false>(load_shape(shapes, world, id), camera, region, meshes, fields, record, tiles)
        == SEEN;
    record.origin.w = id;
    return seen;
}

template <class Meshes> WARPCAM_DEVICE Vec3 face_normal(const Meshes& meshes, unsigned first, int face)
{
    const unsigned row = first + unsigned(face * FACE_ROWS);
    const Vec3 corner = as_vec3(load(meshes.faces.data, row));
    return normalized(
        cross(as_vec3(load(meshes.faces.data, row + 1)) - corner, as_vec3(load(meshes.faces.data, row + 2)) - corner));
}

constexpr int TYPES_WITH_FACES = types_with([](auto shape) { return shape.HAS_FACES; });
constexpr int TYPES_WITH_PARTS = TYPES_WITH_FACES | 1 << HEIGHT_FIELD;
// Tolerance of places on a side or the base of a height field, in parts of its half width.
constexpr float ON_SIDE = 1.0e-4f;

// True if a shape, which may be none, has sides that meet in edges.
template <class Types, class Shapes> WARPCAM_DEVICE bool has_sides(const Shapes& shapes, int shape)
{
    constexpr int SIDED = Types::GEOMETRY & (1 << MESH | TYPES_WITH_FACES);
    return SIDED && shape >= 0 && (SIDED >> wp::index(shapes.types, shape) & 1);
}

// Part of a height field at a place: its ground, its base, or one of the sides between these.
WARPCAM_DEVICE int height_field_part(const ShapeRecord& record, Vec3 p)
{
    const float gap = ON_SIDE * max(record.size.x, record.size.y);
    if (record.size.x - abs(p.x) < gap)
        return p.x > 0.0f ? 1 : 2;
    if (record.size.y - abs(p.y) < gap)
        return p.y > 0.0f ? 3 : 4;
    return p.z + record.size.z < gap ? 5 : 0;
}

// Smooth part that a shape shows at a depth of a ray: a box's side, a cylinder's side or end, a height field's part.
template <class Types, int LENS>
WARPCAM_DEVICE int part_at(const ShapeRecord& record, const CameraRay<LENS>& ray, float depth)
{
    const Ray local = ray.local(record);
    const Vec3 p = local.origin + depth * local.direction;
    if (Types::has(HEIGHT_FIELD) && record.axis_x.w == HEIGHT_FIELD)
        return height_field_part(record, p);
    int face = 0;
    visit_known_shape<TYPES_WITH_FACES>(record.axis_x.w, [&](auto shape) { face = shape.face_at(p); });
    return face;
}

// Selects the pixel that shows what a sample of pixel (i, j) has hit; show(sided, normal_cost) selects as
// EdgeTester::shown() does. Two surfaces that meet in an edge are near each other in depth, but differ in colour: so
// the selection weighs how a mesh's face is turned from those of the pixels around, and whether these show the same
// side. `record` is that of the shape hit, `edge` the pixel's edge().
template <class Types, int LENS, class Meshes, class Centres, class Show>
WARPCAM_DEVICE int shown_sample(const EdgeTester<LENS, Centres>& seen, const Meshes& meshes, const Camera& camera,
                                int i, int j, int sample, float depth, int face, const ShapeRecord& record,
                                unsigned edge, const Show& show)
{
    if ((edge & PLAIN) && record.origin.w == seen.shape(seen.at(i, j)))
        return ITSELF;
    constexpr int SIDED = Types::GEOMETRY & TYPES_WITH_PARTS;
    const int type = record.axis_x.w;
    const bool is_face = Types::has(MESH) && type == MESH && face >= 0;
    const bool is_sided = SIDED && (SIDED >> type & 1);
    const unsigned rows = as_int(record.size.z);
    Vec3 normal { 0.0f, 0.0f, 0.0f };
    if (is_face)
        normal = face_normal(meshes, rows, face);
    const int part = is_sided ? part_at<Types, LENS>(record, sample_ray<LENS>(camera, i, j, sample), depth) : -1;
    const auto normal_cost = [&](int column, int row, unsigned pixel) {
        if (is_face)
            return NORMAL_WEIGHT
                   * (1.0f
                      - dot(normal, face_normal(meshes, rows,
                                                int(seen.centres.target.face.data[seen.centres.of_images(pixel)]))));
        return !is_sided || part_at<Types, LENS>(record, view_ray<LENS>(camera, column, row), seen.depth(pixel)) == part
                   ? 0.0f
                   : NORMAL_WEIGHT;
    };
    return show(is_face || is_sided, normal_cost);
}

template <class Types, int IMAGES, int LENS, class Meshes, class Centres>
WARPCAM_DEVICE int shown_sample(const EdgeTester<LENS, Centres>& seen, const Meshes& meshes, const Camera& camera,
                                int i, int j, int sample, float depth, int face, const ShapeRecord& record,
                                unsigned edge)
{
    return shown_sample<Types>(
        seen, meshes, camera, i, j, sample, depth, face, record, edge, [&](bool sided, const auto& normal_cost) {
            return seen.template shown<IMAGES>(i, j, sample_offset(sample), depth, record.origin.w, sided, normal_cost);
        });
}

}  // namespace warpcam
