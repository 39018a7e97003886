// Cache, in shared memory, of trace results for a region's pixels and those around it: see PixelSource.
#pragma once
#include "antialiasing/edge_test.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

template <class Pointer> struct Pointee;
template <class T> struct Pointee<T*> {
    using type = T;
};

// Shared memory of the cache.
template <class Target, int IMAGES, int WIDTH, int HEIGHT> struct CentresRoom {
    static constexpr int LINE = WIDTH + 2, PIXELS = LINE * (HEIGHT + 2);
    static constexpr bool HAS_BYTES = IMAGES & (SMOOTH_RGB | SMOOTH_RGBA);
    using Id = typename Pointee<decltype(Target::shape.data)>::type;

    float depths[PIXELS];
    unsigned colours[HAS_BYTES ? PIXELS : 1];
    Id ids[PIXELS];
};

// Pixels are numbered row after row, from the one left above the region's first.
template <class Target, int IMAGES, int WIDTH, int HEIGHT> struct PixelCache {
    using Room = CentresRoom<Target, IMAGES, WIDTH, HEIGHT>;
    static constexpr int LINE = Room::LINE;
    static constexpr bool BORDERED = true;  // what lies outside of the image is as the nearest pixel inside
    static constexpr bool PLACED = false;

    Room& room;
    const Target& target;
    int left, top;    // of the first pixel that is kept, in the image
    unsigned first;   // the view's first pixel in the images

    // All threads of the block; with a barrier. A warp loads rows, which may have a few more pixels than it has lanes;
    // what lies beyond a row or the last of them is loaded twice, so that nothing is asked and all loads are under way
    // at once.
    WARPCAM_DEVICE void load() const
    {
        constexpr int WARPS = THREADS / WARP_SIZE, ROWS = Room::PIXELS / LINE,
                      TILE_COLUMNS_PER_WARP = min(LINE, WARP_SIZE);
        const int lane = min(threadIdx.x % WARP_SIZE, LINE - 1), warp = threadIdx.x / WARP_SIZE;
        const int i = left + lane, column = i < 0 ? 0 : min(i, target.width - 1);
#pragma unroll
        for (int first = 0; first < ROWS; first += WARPS) {
            const int row = min(first + warp, ROWS - 1), j = top + row;
            load(unsigned(row * LINE + lane), of_images(column, j < 0 ? 0 : min(j, target.height - 1)));
        }
        constexpr int REST = LINE - TILE_COLUMNS_PER_WARP;
        if constexpr (REST > 0)
#pragma unroll 1
            for (int k = threadIdx.x; k < REST * ROWS; k += THREADS) {
                const unsigned pixel = unsigned(k / REST * LINE + TILE_COLUMNS_PER_WARP + k % REST);
                load(pixel, of_images(pixel));
            }
        block_sync();
    }
    WARPCAM_DEVICE void load(unsigned pixel, unsigned from) const
    {
        room.depths[pixel] = target.depth.data[from];
        room.ids[pixel] = target.shape.data[from];
        if (Room::HAS_BYTES)
            room.colours[pixel] = load_bytes<IMAGES>(target, from);
    }

    WARPCAM_DEVICE unsigned at(int i, int j) const { return unsigned((j - top) * LINE + (i - left)); }
    WARPCAM_DEVICE static constexpr unsigned line() { return LINE; }
    WARPCAM_DEVICE static constexpr bool has_fours() { return false; }
    WARPCAM_DEVICE unsigned four_ids(int, int) const { return 0; }
    WARPCAM_DEVICE unsigned of_images(int i, int j) const { return first + unsigned(j * target.width + i); }
    WARPCAM_DEVICE unsigned of_images(unsigned pixel) const
    {
        const int i = left + int(pixel) % LINE, j = top + int(pixel) / LINE;
        return of_images(i < 0 ? 0 : min(i, target.width - 1), j < 0 ? 0 : min(j, target.height - 1));
    }
    WARPCAM_DEVICE int shape(unsigned pixel) const { return room.ids[pixel]; }
    WARPCAM_DEVICE float depth(unsigned pixel) const { return room.depths[pixel]; }
    template <int> WARPCAM_DEVICE unsigned bytes(unsigned pixel) const { return room.colours[pixel]; }
    WARPCAM_DEVICE bool shows(int i, int j, int shape_) const
    {
        return (i >= 0) & (i < target.width) & (j >= 0) & (j < target.height) & (shape(at(i, j)) == shape_);
    }

    WARPCAM_DEVICE unsigned around(int i, int j, int k) const { return at(i + k % 3 - 1, j + k / 3 - 1); }
};

// Cache, in shared memory, of the shapes that a region's pixels and those around it show; WHOLE: the region is the
// whole image. Pixels are numbered row after row, from the one above the region's first, or a word left of that if
// there are any.
template <class Target, int WIDTH, int HEIGHT, bool WHOLE> struct RegionIds {
    using Id = typename Pointee<decltype(Target::shape.data)>::type;
    static constexpr bool FIT = sizeof(Id) == 1;
    static constexpr int WORD = 4, ASIDE = WHOLE ? 0 : WORD, BEFORE = WORD - ASIDE;  // pixels; those before the first
    static constexpr int LINE = WIDTH + 2 * ASIDE, WORDS = (LINE * (HEIGHT + 2) + 2 * BEFORE) / WORD;

    unsigned words[FIT ? WORDS : 1];

    // All threads of the block; then a barrier. What lies outside of the image is as any pixel of it.
    WARPCAM_DEVICE void load(const Target& target, const Region& region, unsigned first)
    {
#pragma unroll
        for (int begin = 0; begin < WORDS; begin += THREADS) {
            const int k = min(begin + int(threadIdx.x), WORDS - 1), pixel = k * WORD - BEFORE;
            const int i = region.left + pixel % LINE - ASIDE, j = region.top + pixel / LINE - 1;
            const Id* const line = target.shape.data + first + max(min(j, target.height - 1), 0) * target.width;
            if (target.width % WORD == 0) {
                words[k] = *reinterpret_cast<const unsigned*>(line + max(min(i, target.width - WORD), 0));
                continue;
            }
            unsigned word = 0;
#pragma unroll
            for (int n = 0; n < WORD; ++n)
                word |= unsigned(static_cast<unsigned char>(line[max(min(i + n, target.width - 1), 0)])) << 8 * n;
            words[k] = word;
        }
    }
    WARPCAM_DEVICE int at(unsigned pixel) const { return reinterpret_cast<const Id*>(words)[pixel + BEFORE]; }
    WARPCAM_DEVICE unsigned load4(unsigned pixel) const { return words[(pixel + BEFORE) / WORD]; }
};

// Cache for images whose colours can be loaded by words: their number of pixels is a multiple of four. Depths, faces
// and colours stay in global memory. Pixels are numbered as in RegionIds; none lies outside the image.
template <class Target, int WIDTH_, int HEIGHT, bool WHOLE> struct PlacedCentres {
    using Ids = RegionIds<Target, WIDTH_, HEIGHT, WHOLE>;
    static constexpr int WIDTH = WIDTH_, LINE = Ids::LINE;
    static constexpr bool BORDERED = false;
    static constexpr bool PLACED = true;

    Ids& ids;
    const Target& target;
    int left, top;  // of pixel 0, in the image
    unsigned first;  // the view's first pixel in the images

    // Adds all shapes that are seen to a list: those that the pixel before does not show. Then a barrier.
    template <class List> WARPCAM_DEVICE void list(List& shapes) const
    {
#pragma unroll 1
        for (int k = threadIdx.x; k < ids.WORDS; k += THREADS) {
            unsigned rest = ids.words[k];
            for (int before = -1; rest != ~0u;) {  // those that are done become -1
                const int id = static_cast<signed char>(rest & 0xff);
                if (id >= 0 && id != before)
                    shapes.add(id);
                before = id;
                rest = rest >> 8 | 0xff000000u;
            }
        }
    }
    WARPCAM_DEVICE unsigned at(int i, int j) const { return unsigned((j - top) * LINE + (i - left)); }
    WARPCAM_DEVICE static constexpr unsigned line() { return LINE; }
    WARPCAM_DEVICE unsigned of_images(unsigned pixel) const
    {
        return of_images(left + int(pixel % LINE), top + int(pixel / LINE));
    }
    WARPCAM_DEVICE unsigned of_images(int i, int j) const { return first + unsigned(j * target.width + i); }
    WARPCAM_DEVICE int shape(unsigned pixel) const { return ids.at(pixel); }
    // Shape of a pixel that may lie outside the image: then the result is arbitrary.
    WARPCAM_DEVICE int shape_beside(int i, int j) const { return shape(at(i, j)); }
    WARPCAM_DEVICE static constexpr bool has_fours() { return true; }
    WARPCAM_DEVICE unsigned four_ids(int i, int j) const { return ids.load4(at(i, j)); }
    WARPCAM_DEVICE float depth(unsigned pixel) const { return target.depth.data[of_images(pixel)]; }
    template <int IMAGES> WARPCAM_DEVICE unsigned bytes(unsigned pixel) const
    {
        return load_bytes<IMAGES>(target, of_images(pixel));
    }
    // The colours of the nine pixels around one, row after row: of each row three words of rgb have them.
    template <int IMAGES> WARPCAM_DEVICE void bytes_around(int i, int j, unsigned (&nine)[9]) const
    {
        if (IMAGES & SMOOTH_RGBA) {
#pragma unroll
            for (int k = 0; k < 9; ++k)
                nine[k] = bytes<IMAGES>(around(i, j, k));
            return;
        }
        constexpr unsigned COLOUR = 0xffffff;
        const bool leftmost = i == 0, rightmost = i + 1 == target.width;
        const int column = leftmost ? 0 : rightmost ? i - 2 : i - 1;
#pragma unroll
        for (int k = 0; k < 3; ++k) {
            const int row = j + k - 1 < 0 ? 0 : min(j + k - 1, target.height - 1);
            const unsigned begin = 3 * unsigned(row * target.width + column), aside = 8 * (begin % 4);
            const unsigned* const words =
                reinterpret_cast<const unsigned*>(target.rgb.data + 3 * size_t(first)) + begin / 4;
            const unsigned a = words[0], b = words[1], c = words[2];
            const unsigned low = __funnelshift_r(a, b, aside), high = __funnelshift_r(b, c, aside), last = c >> aside;
            const unsigned one = low & COLOUR, two = __funnelshift_r(low, high, 24) & COLOUR;
            const unsigned three = __funnelshift_r(high, last, 16) & COLOUR;
            nine[3 * k] = rightmost ? two : one;
            nine[3 * k + 1] = leftmost ? one : rightmost ? three : two;
            nine[3 * k + 2] = leftmost ? two : three;
        }
    }
    WARPCAM_DEVICE bool shows(int i, int j, int shape_) const
    {
        const bool inside = i >= 0 && i < target.width && j >= 0 && j < target.height;
        return inside & (shape_beside(i, j) == shape_);
    }
    WARPCAM_DEVICE unsigned around(int i, int j, int k) const
    {
        const int column = i + k % 3 - 1, row = j + k / 3 - 1;
        return at(column < 0 ? 0 : min(column, target.width - 1), row < 0 ? 0 : min(row, target.height - 1));
    }
};

}  // namespace warpcam
#endif
