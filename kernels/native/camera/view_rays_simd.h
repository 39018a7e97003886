// Eight rays of a lens, on a CPU: camera/shape_record.h, camera/ray_table.h and camera/offset_rays.h, whose comments
// hold here.
#pragma once
#include "core/simd8.h"
#include "camera/ray_table.h"

namespace warpcam {

// In the camera's frame; or how that changes from pixel to pixel.
struct OffsetRay8 {
    Vec3x8 start, direction;

    void put(int k, const OffsetRay& offset_ray)
    {
        set_lane(start, k, offset_ray.start);
        set_lane(direction, k, offset_ray.direction);
    }
};

// True if eight pixels of a group, in ascending order, are consecutive.
inline bool in_a_row(const short* pixels) { return pixels[SIMD_WIDTH - 1] - pixels[0] == SIMD_WIDTH - 1; }

// True if `count` pixels are consecutive in one row of WIDTH.
template <int WIDTH> inline bool in_one_row(const short* pixels, int count)
{
    return count == SIMD_WIDTH && in_a_row(pixels) && pixels[0] % WIDTH + SIMD_WIDTH <= WIDTH;
}

template <int LENS> inline void offset_rays_of(Float8 x, Float8 y, OffsetRay8& offset_rays)
{
    const Float8 none = 0.0f, one = 1.0f;
    offset_rays.start = { none, none, none };
    if constexpr (LENS == PINHOLE) {
        offset_rays.direction = { x, y, -one };
    } else if constexpr (LENS == ORTHOGRAPHIC) {
        offset_rays = { { x, y, none }, { none, none, -one } };
    } else if constexpr (LENS == RAYS) {
        const Float8 rate = 2.0f * rcp(1.0f + x * x + y * y);
        offset_rays.direction = { rate * x, rate * y, one - rate };
    } else {
        const float* rows[SIMD_WIDTH];
        for (int k = 0; k < SIMD_WIDTH; ++k)
            rows[k] = reinterpret_cast<const float*>(CameraRay<LENS> { x[k], y[k] }.own_rows());
        const Float8x4 start = columns_of(rows, 0), along = columns_of(rows, sizeof(Float3Int) / sizeof(float));
        offset_rays = { { start.a, start.b, start.c }, { along.a, along.b, along.c } };
    }
}

template <int LENS> inline Vec3x8 places_on(const OffsetRay8& offset_rays, Float8 depth)
{
    if constexpr (has_centre(LENS))
        return depth * offset_rays.direction;
    else
        return offset_rays.start + depth * offset_rays.direction;
}

inline void load_pairs(const Float2* from, Float8& x, Float8& y)
{
    Float8 low, high;
    __builtin_memcpy(&low, from, sizeof low);
    __builtin_memcpy(&high, from + SIMD_WIDTH / 2, sizeof high);
    x = __builtin_shufflevector(low, high, 0, 2, 4, 6, 8, 10, 12, 14);
    y = __builtin_shufflevector(low, high, 1, 3, 5, 7, 9, 11, 13, 15);
}

// First entry of a pixel's part of a ray table.
template <int LENS> struct TableEntry {
    using type = Float2;
};
template <> struct TableEntry<RAY_TABLE_WITH_ORIGINS> {
    using type = Float3Int;
};

// Rays of a table, row after row of the image; ENTRIES a pixel.
template <int LENS> constexpr int ENTRIES = LENS == RAY_TABLE_WITH_ORIGINS ? OFFSET_RAY_ROWS : 1;
template <int LENS> inline const typename TableEntry<LENS>::type* table_entries(const Camera& camera)
{
    if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
        return tile_starts(camera, 0, tiles_down(camera));
    else
        return reinterpret_cast<const Float2*>(tile_cones(camera, 0, tiles_down(camera)));
}

// The rays of a table from pixel (i, j) on, of those in the image that are nearest.
template <int LENS> inline void offset_rays_from(const Camera& camera, int i, int j, OffsetRay8& offset_rays)
{
    Float8 x, y;
    const int width = table_width(camera);
    if (LENS == RAYS && i + SIMD_WIDTH <= width && j < table_height(camera)) {
        load_pairs(table_entries<RAYS>(camera) + (size_t(j) * width + i), x, y);
    } else {
        for (int k = 0; k < SIMD_WIDTH; ++k) {
            const CameraRay<LENS> ray = view_ray<LENS>(camera, i + k, j);
            x[k] = ray.x;
            y[k] = ray.y;
        }
    }
    offset_rays_of<LENS>(x, y, offset_rays);
}

// The rays of some rows of a region, whose pixels have numbers, WIDTH of them a row.
template <int LENS, int WIDTH, int ROWS> struct RayRows {
    using Entry = typename TableEntry<LENS>::type;

    const Camera& camera;
    int left, top;
    float x[has_table(LENS) ? 1 : WIDTH], y[has_table(LENS) ? 1 : ROWS];
    const Entry* rays;  // of a table, of all pixels of the image: so many
    int across, down;

    // MIRROR_VIEW: its columns run the other way; `columns` is how many the image has.
    RayRows(const Camera& camera_, int left_, int width, bool mirrored, int columns)
        : camera(camera_), left(left_), top(0)
    {
        if constexpr (has_table(LENS)) {
            across = table_width(camera);
            down = table_height(camera);
            rays = table_entries<LENS>(camera);
        } else {
            for (int column = 0; column < width; ++column)
                x[column] = image_x(camera, float(mirrored ? columns - 1 - left - column : left + column));
        }
    }

    void seek_tile(int row, int rows)
    {
        top = row;
        if constexpr (!has_table(LENS))
            for (int k = 0; k < rows; ++k)
                y[k] = image_y(camera, float(row + k));
    }

    // Finds the rays of `count` pixels; further lanes repeat the last pixel.
    void find(const short* pixels, int count, Float8& own_x, Float8& own_y) const
    {
        if constexpr (LENS != RAY_TABLE_WITH_ORIGINS)
            if (in_one_row<WIDTH>(pixels, count)) {
                const int row = pixels[0] / WIDTH, column = pixels[0] % WIDTH;
                if constexpr (LENS == RAYS) {
                    load_pairs(entry(left + column, top + row), own_x, own_y);
                } else {
                    __builtin_memcpy(&own_x, x + column, sizeof own_x);
                    own_y = y[row];
                }
                return;
            }
        for (int k = 0; k < SIMD_WIDTH; ++k) {
            const int pixel = pixels[min(k, count - 1)], row = pixel / WIDTH, column = pixel % WIDTH;
            if constexpr (LENS == RAYS)
                put(*entry(left + column, top + row), k, own_x, own_y);
            else if constexpr (LENS == RAY_TABLE_WITH_ORIGINS)
                put(CameraRay<RAY_TABLE_WITH_ORIGINS>::of(entry(left + column, top + row)), k, own_x, own_y);
            else
                put(Float2 { x[column], y[row] }, k, own_x, own_y);
        }
    }

    // Changes of the rays to the next pixel across and down, with those of their origins if rays have own origins.
    void steps(const short* pixels, int count, Float8 own_x, Float8 own_y, OffsetRay8& right, OffsetRay8& under) const
    {
        const Float8 none = 0.0f, a = camera.scale_x, b = -camera.scale_y;
        const Vec3x8 nowhere { none, none, none };
        if constexpr (LENS == PINHOLE) {
            right = { nowhere, { a, none, none } };
            under = { nowhere, { none, b, none } };
        } else if constexpr (LENS == ORTHOGRAPHIC) {
            right = { { a, none, none }, nowhere };
            under = { { none, b, none }, nowhere };
        } else if constexpr (LENS == RAYS) {
            right = { nowhere, turns(pixels, count, own_x, own_y, 1, 0) };
            under = { nowhere, turns(pixels, count, own_x, own_y, 0, 1) };
        } else {
            for (int k = 0; k < SIMD_WIDTH; ++k) {
                const CameraRay<LENS> ray { own_x[k], own_y[k] };
                right.put(k, ray.across());
                under.put(k, ray.down());
            }
        }
    }

private:
    const Entry* entry(int i, int j) const { return rays + ENTRIES<LENS> * (size_t(j) * across + i); }

    template <class Two> static void put(const Two& two, int k, Float8& x, Float8& y)
    {
        x[k] = two.x;
        y[k] = two.y;
    }

    // The rays of the pixels so far beside them, and which of these there are, and see anything; else their own.
    Int8 beside(const short* pixels, int count, int right, int under, Float8& x, Float8& y) const
    {
        const int i = left + pixels[0] % WIDTH + right, j = top + pixels[0] / WIDTH + under;
        Int8 there = -1;
        Float8 its_x, its_y;
        if (in_one_row<WIDTH>(pixels, count) && i >= 0 && i + SIMD_WIDTH <= across && j >= 0 && j < down) {
            load_pairs(entry(i, j), its_x, its_y);
        } else {
            for (int k = 0; k < SIMD_WIDTH; ++k) {
                const int pixel = pixels[min(k, count - 1)], own_i = left + pixel % WIDTH, own_j = top + pixel / WIDTH;
                const int its_i = own_i + right, its_j = own_j + under;
                const bool within = its_i >= 0 && its_i < across && its_j >= 0 && its_j < down;
                there[k] = within ? -1 : 0;
                put(*entry(within ? its_i : own_i, within ? its_j : own_j), k, its_x, its_y);
            }
        }
        there &= its_x < NO_RAY;
        x = there ? its_x : x;
        y = there ? its_y : y;
        return there;
    }

    // Changes of rays as changes of unit directions: table_slopes() and turn_of() for a packet.
    Vec3x8 turns(const short* pixels, int count, Float8 own_x, Float8 own_y, int right, int under) const
    {
        Float8 from_x = own_x, from_y = own_y, to_x = own_x, to_y = own_y;
        const Int8 both =
            beside(pixels, count, -right, -under, from_x, from_y) & beside(pixels, count, right, under, to_x, to_y);
        const Float8 share = own_x >= NO_RAY ? (Float8)0.0f : both ? (Float8)0.5f : (Float8)1.0f;
        const Float8 dx = share * (to_x - from_x), dy = share * (to_y - from_y);
        const Float8 rate = rcp(1.0f + own_x * own_x + own_y * own_y), along = 2.0f * rate * (own_x * dx + own_y * dy);
        return { 2.0f * rate * (dx - along * own_x), 2.0f * rate * (dy - along * own_y), 2.0f * rate * along };
    }
};

}  // namespace warpcam
