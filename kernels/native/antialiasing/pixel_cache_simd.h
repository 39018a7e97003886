// Cache, on a CPU, of trace results for a region's pixels and those around it: see PixelSource.
#pragma once
#include "antialiasing/edge_test.h"
#include "core/simd8.h"

namespace warpcam {

constexpr int AROUND = 9;  // pixels, see PixelSource::around()

// Shapes of the nine pixels around one; pixels outside the image take the nearest inside.
struct NineIds {
    const int* here;
    int line;
    unsigned inside;  // those that are in the image, a bit each

    int operator[](int k) const { return here[(k / 3 - 1) * line + k % 3 - 1]; }
    unsigned which_are(int id) const
    {
        unsigned found = 0;
        for (int row = 0; row < 3; ++row)
            found |= (movemask(load8(here + (row - 1) * line - 1) == id) & 7u) << 3 * row;
        return found;
    }
};

// Pixels are numbered row after row, from the one left above the region's first.
template <int IMAGES, int WIDTH, int HEIGHT, class Target> struct CentresAtHand {
    static constexpr int LINE = WIDTH + 2, PIXELS = LINE * (HEIGHT + 2);
    static constexpr bool HAS_BYTES = IMAGES & (SMOOTH_RGB | SMOOTH_RGBA);
    static constexpr bool BORDERED = true;  // what lies outside of the image is as the nearest pixel inside
    static constexpr bool PLACED = false;
    static constexpr int CHANNELS = IMAGES & SMOOTH_RGBA ? 4 : 3;

    const Target& target;
    int left, top;   // of the first pixel that is kept, in the image
    unsigned first;  // the view's first pixel in the images
    int ids[PIXELS + SIMD_WIDTH];
    float depths[PIXELS + SIMD_WIDTH];
    unsigned colours[HAS_BYTES ? PIXELS + SIMD_WIDTH : 1];

    CentresAtHand(const Target& from, unsigned first_, const Region& region)
        : target(from), left(region.left - 1), top(region.top - 1), first(first_)
    {
        const int width = min(WIDTH, target.width - region.left), height = min(HEIGHT, target.height - region.top);
        for (int row = 0; row < height + 2; ++row) {
            const int j = top + row, inside = j < 0 ? 0 : min(j, target.height - 1);
            const unsigned to = unsigned(row * LINE + 1), begin = of_images(region.left, inside);
            int done = 0;
            for (; done + SIMD_WIDTH <= width; done += SIMD_WIDTH)
                load_packet(to + done, begin + done);
            for (; done < width; ++done)
                load(to + done, begin + done);
            load(to - 1, of_images(max(left, 0), inside));
            load(to + width, of_images(min(region.left + width, target.width - 1), inside));
        }
    }

    void load(unsigned pixel, unsigned from)
    {
        ids[pixel] = target.shape.data[from];
        depths[pixel] = target.depth.data[from];
        if constexpr (HAS_BYTES)
            colours[pixel] = load_bytes<IMAGES>(target, from);
    }

    void load_packet(unsigned pixel, unsigned from)
    {
        const Int8 shapes = load8(target.shape.data + from);
        __builtin_memcpy(ids + pixel, &shapes, sizeof shapes);
        __builtin_memcpy(depths + pixel, target.depth.data + from, sizeof(Float8));
        if constexpr ((IMAGES & SMOOTH_RGBA) != 0) {
            __builtin_memcpy(colours + pixel, target.rgba.data + 4 * size_t(from), 4 * SIMD_WIDTH);
        } else if constexpr (HAS_BYTES) {
            typedef unsigned char Bytes __attribute__((ext_vector_type(32)));
            Bytes bytes = 0;
            __builtin_memcpy(&bytes, target.rgb.data + 3 * size_t(from), 3 * SIMD_WIDTH);
            const Bytes none = 0;
            bytes = __builtin_shufflevector(bytes, none, 0, 1, 2, 32, 3, 4, 5, 32, 6, 7, 8, 32, 9, 10, 11, 32, 12, 13,
                                            14, 32, 15, 16, 17, 32, 18, 19, 20, 32, 21, 22, 23, 32);
            __builtin_memcpy(colours + pixel, &bytes, sizeof bytes);
        }
    }

    unsigned at(int i, int j) const { return unsigned((j - top) * LINE + (i - left)); }
    static constexpr unsigned line() { return LINE; }
    unsigned of_images(int i, int j) const { return first + unsigned(j * target.width + i); }
    unsigned of_images(unsigned pixel) const
    {
        const int i = left + int(pixel) % LINE, j = top + int(pixel) / LINE;
        return of_images(i < 0 ? 0 : min(i, target.width - 1), j < 0 ? 0 : min(j, target.height - 1));
    }
    int shape(unsigned pixel) const { return ids[pixel]; }
    float depth(unsigned pixel) const { return depths[pixel]; }
    template <int> unsigned bytes(unsigned pixel) const { return colours[pixel]; }
    NineIds nine_ids(int i, int j) const
    {
        const unsigned upright = (j > 0 ? 0x007u : 0u) | 0x038u | (j + 1 < target.height ? 0x1c0u : 0u);
        const unsigned across = (i > 0 ? 0x049u : 0u) | 0x092u | (i + 1 < target.width ? 0x124u : 0u);
        return { ids + at(i, j), LINE, upright & across };
    }
    unsigned around(int i, int j, int k) const { return at(i + k % 3 - 1, j + k / 3 - 1); }

    // Bit mask of the pixels, of eight from column `i` on in a row, that may have an edge: pixels beside another shape,
    // and pixels whose surface is bent.
    template <int LENS> unsigned maybe_edges(int i, int j, float scale_x, float scale_y) const
    {
        const unsigned here = at(i, j);
        const auto ids_at = [&](unsigned pixel) { return load8(ids + pixel); };
        const auto depths_at = [&](unsigned pixel) {
            Float8 values;
            __builtin_memcpy(&values, depths + pixel, sizeof values);
            return values;
        };
        const Int8 own = ids_at(here);
        const Int8 other = (ids_at(here - 1) != own) | (ids_at(here + 1) != own) | (ids_at(here - LINE) != own)
                           | (ids_at(here + LINE) != own);
        const Float8 b = depths_at(here);
        const auto turns = [&](unsigned step, float scale) {  // as Seen::turns_at()
            const Float8 a = depths_at(here - step), c = depths_at(here + step);
            if (LENS == RAY_TABLE_WITH_ORIGINS)
                return is_bent(a, b, c, scale);
            if (LENS != ORTHOGRAPHIC)
                return abs(b * (a + c) - 2.0f * a * c) > EDGE_SLOPE * scale * (a * c);
            return abs(a + c - 2.0f * b) > EDGE_SLOPE * scale;
        };
        Int8 amid = -1;
        amid[0] = i > 0 ? -1 : 0;
        for (int k = 0; k < SIMD_WIDTH; ++k)
            amid[k] &= i + k + 1 < target.width ? -1 : 0;
        Int8 bent = amid & turns(1, scale_x);
        if (j > 0 && j + 1 < target.height)
            bent |= turns(LINE, scale_y);
        return movemask(other | (bent & (own >= 0)));
    }
};

}  // namespace warpcam
