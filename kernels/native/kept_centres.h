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
template <class Target_, int IMAGES, int WIDTH, int HEIGHT> struct KeptCentres {
    using Room = CentresRoom<Target_, IMAGES, WIDTH, HEIGHT>;
    static constexpr int LINE = Room::LINE;
    static constexpr bool BORDERED = true;  // what lies outside of the image is as the nearest pixel inside

    Room& room;
    const Target_& target;
    int left, top;    // of the first pixel that is kept, in the image
    unsigned first;   // the view's first pixel in the images

    // All threads of the block; with a barrier.
    WARPCAM_FN void load() const
    {
#pragma unroll 5
        for (int k = threadIdx.x; k < Room::PIXELS; k += THREADS) {
            const unsigned pixel = of_images(unsigned(k));
            room.depths[k] = target.depth.data[pixel];
            room.ids[k] = target.shape.data[pixel];
            if (Room::HAS_BYTES)
                room.colours[k] = load_bytes<IMAGES>(target, pixel);
        }
        block_barrier();
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
