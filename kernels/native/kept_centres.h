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
    static constexpr bool PLACED = false;

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
    WARPCAM_FN auto ids() const { return target.shape.data + first; }  // those of the view, where the trace has them
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

// Which shapes a whole image shows, kept in shared memory; its depths, faces and colours stay where they are. Pixels are
// numbered row after row.
template <class Target> struct ImageIds {
    using Id = typename Pointee<decltype(Target::shape.data)>::type;
    static constexpr int PIXELS = 64 * 64, BESIDE = 80;  // that may be read, too, though nobody uses what is there
    static constexpr bool FIT = sizeof(Id) == 1;

    alignas(16) Id ids[FIT ? PIXELS + 2 * BESIDE : 1];

    // All threads of the block; then a barrier.
    WARPCAM_FN void load(const Target& target, unsigned first)
    {
        constexpr int TOGETHER = 16 / sizeof(Id);
        const int count = target.width * target.height;
        if (count % TOGETHER == 0) {
            const int4* const from = reinterpret_cast<const int4*>(target.shape.data + first);
            for (int k = threadIdx.x; k < count / TOGETHER; k += THREADS)
                reinterpret_cast<int4*>(ids + BESIDE)[k] = __ldg(from + k);
        } else {
            for (int k = threadIdx.x; k < count; k += THREADS)
                ids[BESIDE + k] = target.shape.data[first + k];
        }
    }
};

template <class Target> struct PlacedCentres {
    static constexpr bool BORDERED = false;
    static constexpr bool PLACED = true;

    ImageIds<Target>& image;
    const Target& target;
    unsigned first;  // the view's first pixel in the images

    // All threads of the block; then a barrier.
    WARPCAM_FN void load() const { image.load(target, first); }
    // Adds all shapes that are seen to a list: those that the pixel before does not show. Then a barrier.
    template <class List> WARPCAM_FN void list(List& shapes) const
    {
        const int words = target.width * target.height / 4;
#pragma unroll 1
        for (int k = threadIdx.x; k < words; k += THREADS) {
            unsigned left = reinterpret_cast<const unsigned*>(ids())[k];
            for (int before = -1; left != ~0u;) {  // those that are done become -1
                const int id = static_cast<signed char>(left & 0xff);
                if (id >= 0 && id != before)
                    shapes.add(id);
                before = id;
                left = left >> 8 | 0xff000000u;
            }
        }
    }
    WARPCAM_FN const typename ImageIds<Target>::Id* ids() const { return image.ids + image.BESIDE; }
    WARPCAM_FN unsigned at(int i, int j) const { return unsigned(j * target.width + i); }
    WARPCAM_FN unsigned line() const { return unsigned(target.width); }
    WARPCAM_FN unsigned of_images(unsigned pixel) const { return first + pixel; }
    WARPCAM_FN unsigned of_images(int i, int j) const { return first + at(i, j); }
    WARPCAM_FN int shape(unsigned pixel) const { return ids()[pixel]; }
    // Where the pixel may lie outside of the image: then it is any number.
    WARPCAM_FN int shape_beside(int i, int j) const { return ids()[j * target.width + i]; }
    WARPCAM_FN float depth(unsigned pixel) const { return target.depth.data[first + pixel]; }
    template <int IMAGES> WARPCAM_FN unsigned bytes(unsigned pixel) const
    {
        return load_bytes<IMAGES>(target, first + pixel);
    }
    // The colours of the nine pixels around one, row after row: of each row three words of rgb have them.
    template <int IMAGES> WARPCAM_FN void bytes_around(int i, int j, unsigned (&nine)[9]) const
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
            const int row = j + k - 1 < 0 ? 0 : lower_int(j + k - 1, target.height - 1);
            const unsigned begin = 3 * at(column, row), aside = 8 * (begin % 4);
            const unsigned* const words = reinterpret_cast<const unsigned*>(target.rgb.data + 3 * size_t(first)) + begin / 4;
            const unsigned a = words[0], b = words[1], c = words[2];
            const unsigned low = __funnelshift_r(a, b, aside), high = __funnelshift_r(b, c, aside), last = c >> aside;
            const unsigned one = low & COLOUR, two = __funnelshift_r(low, high, 24) & COLOUR;
            const unsigned three = __funnelshift_r(high, last, 16) & COLOUR;
            nine[3 * k] = rightmost ? two : one;
            nine[3 * k + 1] = leftmost ? one : rightmost ? three : two;
            nine[3 * k + 2] = leftmost ? two : three;
        }
    }
    WARPCAM_FN bool shows(int i, int j, int shape_) const
    {
        const bool inside = i >= 0 && i < target.width && j >= 0 && j < target.height;
        return inside & (shape_beside(i, j) == shape_);
    }
    WARPCAM_FN unsigned around(int i, int j, int k) const
    {
        const int column = i + k % 3 - 1, row = j + k / 3 - 1;
        return at(column < 0 ? 0 : lower_int(column, target.width - 1), row < 0 ? 0 : lower_int(row, target.height - 1));
    }
};

}  // namespace warpcam
#endif
