// What a view has found in a region's pixels and those around it, kept in shared memory: see ImageCentres.
#pragma once
#include "edges.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

template <class Pointer> struct Pointee;
template <class T> struct Pointee<T*> {
    using type = T;
};

// Where it is kept.
template <class Target, int IMAGES, int WIDTH, int HEIGHT> struct CentresRoom {
    static constexpr int LINE = WIDTH + 2, PIXELS = LINE * (HEIGHT + 2);
    static constexpr bool HAS_BYTES = IMAGES & (SMOOTH_RGB | SMOOTH_RGBA);
    using Id = typename Pointee<decltype(Target::shape.data)>::type;

    float depths[PIXELS];
    unsigned colours[HAS_BYTES ? PIXELS : 1];
    Id ids[PIXELS];
};

// Pixels are numbered row after row, from the one left above the region's first.
template <class Target, int IMAGES, int WIDTH, int HEIGHT> struct KeptCentres {
    using Room = CentresRoom<Target, IMAGES, WIDTH, HEIGHT>;
    static constexpr int LINE = Room::LINE;
    static constexpr bool BORDERED = true;  // what lies outside of the image is as the nearest pixel inside

    Room& room;
    const Target& target;
    int left, top;    // of the first pixel that is kept, in the image
    unsigned first;   // the view's first pixel in the images

    // All threads of the block; with a barrier. A warp loads rows, which may have a few more pixels than it has lanes; what
    // lies beyond a row or the last of them is loaded twice, so that nothing is asked and all loads are under way at once.
    WARPCAM_FN void load() const
    {
        constexpr int WARPS = THREADS / LANES, ROWS = Room::PIXELS / LINE, WIDE = lower_int(LINE, LANES);
        const int lane = lower_int(threadIdx.x % LANES, LINE - 1), warp = threadIdx.x / LANES;
        const int i = left + lane, column = i < 0 ? 0 : lower_int(i, target.width - 1);
#pragma unroll
        for (int first = 0; first < ROWS; first += WARPS) {
            const int row = lower_int(first + warp, ROWS - 1), j = top + row;
            load(unsigned(row * LINE + lane), of_images(column, j < 0 ? 0 : lower_int(j, target.height - 1)));
        }
        constexpr int REST = LINE - WIDE;
        if constexpr (REST > 0)
#pragma unroll 1
            for (int k = threadIdx.x; k < REST * ROWS; k += THREADS) {
                const unsigned pixel = unsigned(k / REST * LINE + WIDE + k % REST);
                load(pixel, of_images(pixel));
            }
        block_barrier();
    }
    WARPCAM_FN void load(unsigned pixel, unsigned from) const
    {
        room.depths[pixel] = target.depth.data[from];
        room.ids[pixel] = target.shape.data[from];
        if (Room::HAS_BYTES)
            room.colours[pixel] = load_bytes<IMAGES>(target, from);
    }

    WARPCAM_FN unsigned at(int i, int j) const { return unsigned((j - top) * LINE + (i - left)); }
    WARPCAM_FN static constexpr unsigned line() { return LINE; }
    WARPCAM_FN unsigned of_images(int i, int j) const { return first + unsigned(j * target.width + i); }
    WARPCAM_FN unsigned of_images(unsigned pixel) const
    {
        const int i = left + int(pixel) % LINE, j = top + int(pixel) / LINE;
        return of_images(i < 0 ? 0 : lower_int(i, target.width - 1), j < 0 ? 0 : lower_int(j, target.height - 1));
    }
    WARPCAM_FN int shape(unsigned pixel) const { return room.ids[pixel]; }
    WARPCAM_FN float depth(unsigned pixel) const { return room.depths[pixel]; }
    template <int> WARPCAM_FN unsigned bytes(unsigned pixel) const { return room.colours[pixel]; }
    WARPCAM_FN bool shows(int i, int j, int shape_) const
    {
        return (i >= 0) & (i < target.width) & (j >= 0) & (j < target.height) & (shape(at(i, j)) == shape_);
    }

    WARPCAM_FN unsigned around(int i, int j, int k) const { return at(i + k % 3 - 1, j + k / 3 - 1); }
};

}  // namespace warpcam
#endif
