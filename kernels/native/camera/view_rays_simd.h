// Eight rays of a lens, on a CPU: camera/shape_record.h, camera/ray_table.h and camera/offset_rays.h, whose comments
// hold here.
#pragma once
#include "core/simd8.h"
#include "camera/ray_table.h"

namespace warpcam {

// In the camera's frame; or how that changes from pixel to pixel.
struct Beams {
    Vecs start, direction;

    void put(int k, const Beam& beam)
    {
        put_one(start, k, beam.start);
        put_one(direction, k, beam.direction);
    }
};

// Whether eight pixels of a group, which stand in order, follow each other.
inline bool in_a_row(const short* pixels) { return pixels[PACKET - 1] - pixels[0] == PACKET - 1; }

// Whether `count` of them do, in one row of WIDTH.
template <int WIDTH> inline bool in_one_row(const short* pixels, int count)
{
    return count == PACKET && in_a_row(pixels) && pixels[0] % WIDTH + PACKET <= WIDTH;
}

template <int LENS> inline void beams_of(Floats x, Floats y, Beams& beams)
{
    const Floats none = 0.0f, one = 1.0f;
    beams.start = { none, none, none };
    if constexpr (LENS == PINHOLE) {
        beams.direction = { x, y, -one };
    } else if constexpr (LENS == ORTHOGRAPHIC) {
        beams = { { x, y, none }, { none, none, -one } };
    } else if constexpr (LENS == RAYS) {
        const Floats rate = 2.0f * reciprocal(1.0f + x * x + y * y);
        beams.direction = { rate * x, rate * y, one - rate };
    } else {
        const float* rows[PACKET];
        for (int k = 0; k < PACKET; ++k)
            rows[k] = reinterpret_cast<const float*>(ViewRay<LENS> { x[k], y[k] }.own_rows());
        const Columns start = columns_of(rows, 0), along = columns_of(rows, sizeof(Row) / sizeof(float));
        beams = { { start.a, start.b, start.c }, { along.a, along.b, along.c } };
    }
}

template <int LENS> inline Vecs places_on(const Beams& beams, Floats depth)
{
    if constexpr (has_centre(LENS))
        return depth * beams.direction;
    else
        return beams.start + depth * beams.direction;
}

inline void load_pairs(const Pair* from, Floats& x, Floats& y)
{
    Floats low, high;
    __builtin_memcpy(&low, from, sizeof low);
    __builtin_memcpy(&high, from + PACKET / 2, sizeof high);
    x = __builtin_shufflevector(low, high, 0, 2, 4, 6, 8, 10, 12, 14);
    y = __builtin_shufflevector(low, high, 1, 3, 5, 7, 9, 11, 13, 15);
}

// What begins a pixel's part of a table.
template <int LENS> struct TableEntry {
    using type = Pair;
};
template <> struct TableEntry<SPREAD> {
    using type = Row;
};

// Those of a table, row after row of the image; ENTRIES a pixel.
template <int LENS> constexpr int ENTRIES = LENS == SPREAD ? SPREAD_ROWS : 1;
template <int LENS> inline const typename TableEntry<LENS>::type* table_entries(const Camera& camera)
{
    if constexpr (LENS == SPREAD)
        return tile_starts(camera, 0, tiles_down(camera));
    else
        return reinterpret_cast<const Pair*>(tile_cones(camera, 0, tiles_down(camera)));
}

// The rays of a table from pixel (i, j) on, of those in the image that are nearest.
template <int LENS> inline void beams_from(const Camera& camera, int i, int j, Beams& beams)
{
    Floats x, y;
    const int width = table_width(camera);
    if (LENS == RAYS && i + PACKET <= width && j < table_height(camera)) {
        load_pairs(table_entries<RAYS>(camera) + (size_t(j) * width + i), x, y);
    } else {
        for (int k = 0; k < PACKET; ++k) {
            const ViewRay<LENS> ray = view_ray<LENS>(camera, i + k, j);
            x[k] = ray.x;
            y[k] = ray.y;
        }
    }
    beams_of<LENS>(x, y, beams);
}

// The rays of some rows of a region, whose pixels have numbers, WIDTH of them a row.
template <int LENS, int WIDTH, int ROWS> struct RayRows {
    using Entry = typename TableEntry<LENS>::type;

    const Camera& camera;
    int left, top;
    float x[has_table(LENS) ? 1 : WIDTH], y[has_table(LENS) ? 1 : ROWS];
    const Entry* rays;  // of a table, of all pixels of the image: so many
    int across, down;

    // MIRRORED: its columns run the other way; `columns` is how many the image has.
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

    void go_to(int row, int rows)
    {
        top = row;
        if constexpr (!has_table(LENS))
            for (int k = 0; k < rows; ++k)
                y[k] = image_y(camera, float(row + k));
    }

    // Of `count` pixels; the others are the last again.
    void find(const short* pixels, int count, Floats& own_x, Floats& own_y) const
    {
        if constexpr (LENS != SPREAD)
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
        for (int k = 0; k < PACKET; ++k) {
            const int pixel = pixels[lower_int(k, count - 1)], row = pixel / WIDTH, column = pixel % WIDTH;
            if constexpr (LENS == RAYS)
                put(*entry(left + column, top + row), k, own_x, own_y);
            else if constexpr (LENS == SPREAD)
                put(ViewRay<SPREAD>::of(entry(left + column, top + row)), k, own_x, own_y);
            else
                put(Pair { x[column], y[row] }, k, own_x, own_y);
        }
    }

    // How these change to the next pixel across and down; where they begin, too, if that is not in one place.
    void steps(const short* pixels, int count, Floats own_x, Floats own_y, Beams& right, Beams& under) const
    {
        const Floats none = 0.0f, a = camera.scale_x, b = -camera.scale_y;
        const Vecs nowhere { none, none, none };
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
            for (int k = 0; k < PACKET; ++k) {
                const ViewRay<LENS> ray { own_x[k], own_y[k] };
                right.put(k, ray.across());
                under.put(k, ray.down());
            }
        }
    }

private:
    const Entry* entry(int i, int j) const { return rays + ENTRIES<LENS> * (size_t(j) * across + i); }

    template <class Two> static void put(const Two& two, int k, Floats& x, Floats& y)
    {
        x[k] = two.x;
        y[k] = two.y;
    }

    // The rays of the pixels so far beside them, and which of these there are, and see anything; else their own.
    Ints beside(const short* pixels, int count, int right, int under, Floats& x, Floats& y) const
    {
        const int i = left + pixels[0] % WIDTH + right, j = top + pixels[0] / WIDTH + under;
        Ints there = -1;
        Floats its_x, its_y;
        if (in_one_row<WIDTH>(pixels, count) && i >= 0 && i + PACKET <= across && j >= 0 && j < down) {
            load_pairs(entry(i, j), its_x, its_y);
        } else {
            for (int k = 0; k < PACKET; ++k) {
                const int pixel = pixels[lower_int(k, count - 1)], own_i = left + pixel % WIDTH,
                          own_j = top + pixel / WIDTH;
                const int its_i = own_i + right, its_j = own_j + under;
                const bool within = its_i >= 0 && its_i < across && its_j >= 0 && its_j < down;
                there[k] = within ? -1 : 0;
                put(*entry(within ? its_i : own_i, within ? its_j : own_j), k, its_x, its_y);
            }
        }
        there &= its_x < BLIND;
        x = there ? its_x : x;
        y = there ? its_y : y;
        return there;
    }

    // As table_slopes() and turn_of() have it.
    Vecs turns(const short* pixels, int count, Floats own_x, Floats own_y, int right, int under) const
    {
        Floats from_x = own_x, from_y = own_y, to_x = own_x, to_y = own_y;
        const Ints both =
            beside(pixels, count, -right, -under, from_x, from_y) & beside(pixels, count, right, under, to_x, to_y);
        const Floats share = own_x >= BLIND ? (Floats)0.0f : both ? (Floats)0.5f : (Floats)1.0f;
        const Floats dx = share * (to_x - from_x), dy = share * (to_y - from_y);
        const Floats rate = reciprocal(1.0f + own_x * own_x + own_y * own_y),
                     along = 2.0f * rate * (own_x * dx + own_y * dy);
        return { 2.0f * rate * (dx - along * own_x), 2.0f * rate * (dy - along * own_y), 2.0f * rate * along };
    }
};

}  // namespace warpcam
