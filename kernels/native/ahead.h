// What the trace and the shadow pass found at a warp's next tile, fetched into shared memory while the warp draws the one
// before. Numbers that are loaded ahead into registers are spilled at once, and so waited for.
#pragma once
#include "kept_looks.h"

namespace warpcam {

// What the trace and the shadow pass found at a pixel.
struct Seen : Hit {
    int shadow;  // where FACTS have SPARE or WHOLE_REGIONS; otherwise it is asked for when the pixel is drawn
};

template <class Frame_> struct FrameOf;
template <class Frame_> struct FrameOf<const Frame_&> {
    template <class Pointer> struct At;
    template <class Value> struct At<Value*> {
        using type = Value;
    };
    using Shape = typename At<decltype(Frame_::shape.data)>::type;
    using Face = typename At<decltype(Frame_::face.data)>::type;
};

// A tile's numbers, row after row, of what is wanted.
template <class Shape, class Face, bool DEPTH, bool FACES, bool SHADOWS> struct alignas(16) TileWords {
    Shape shape[LANES];
    float depth[DEPTH ? LANES : 4];
    Face face[FACES ? LANES : 16 / sizeof(Face)];
    unsigned char shadow[SHADOWS ? LANES : 16];

    static constexpr bool HAS_DEPTH = DEPTH, HAS_FACES = FACES, HAS_SHADOWS = SHADOWS;

    WARPCAM_FN Seen at(int lane) const
    {
        return { { DEPTH ? depth[lane] : 0.0f, int(shape[lane]), FACES ? int(face[lane]) : 0 },
                 SHADOWS ? int(shadow[lane]) : 0 };
    }
};

#if defined(__CUDA_ARCH__)

template <int BYTES> WARPCAM_FN void copy_ahead(void* to, const void* from)
{
    const unsigned shared = static_cast<unsigned>(__cvta_generic_to_shared(to));
    if (BYTES == 16)
        asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(shared), "l"(from) : "memory");
    else
        asm volatile("cp.async.ca.shared.global [%0], [%1], %2;" ::"r"(shared), "l"(from), "n"(BYTES) : "memory");
}

// Ends what belongs together of the copies; then waits for all but the last that was ended so.
WARPCAM_FN void wait_for_one()
{
    asm volatile("cp.async.commit_group;\n\tcp.async.wait_group 1;" ::: "memory");
}
WARPCAM_FN void end_copies() { asm volatile("cp.async.commit_group;" ::: "memory"); }

// Fetches the tiles of one warp, of which two are kept. Only for images of whole regions, whose rows begin at multiples
// of 16 bytes. Each lane fetches one piece of one row: 16 bytes, or of what has a byte a pixel all eight.
template <class Words> struct Fetcher {
    const char* from;  // the lane's piece, if the tile were at the first pixel of all
    int to;            // where it goes to in a tile [bytes]
    int shift;         // log2 of the bytes of a pixel's number
    int large;         // lanes before this one fetch 16 bytes

    // Gives lanes from `large` on their pieces; the first lane after them.
    template <class Value>
    WARPCAM_FN int share_out(int lane, const Value* data, const Value* kept, const Words* words, int width)
    {
        constexpr int SIZE = sizeof(Value), EACH = SIZE > 1 ? 16 / SIZE : TILE_WIDTH, PIECES = TILE_WIDTH / EACH;
        const int number = lane - large;
        if (unsigned(number) < unsigned(PIECES * TILE_HEIGHT)) {
            const int row = number / PIECES, column = number % PIECES * EACH;
            from = reinterpret_cast<const char*>(data + row * width + column);
            to = int(reinterpret_cast<const char*>(kept + row * TILE_WIDTH + column)
                     - reinterpret_cast<const char*>(words));
            shift = SIZE == 4 ? 2 : SIZE == 2 ? 1 : 0;
        }
        return large + PIECES * TILE_HEIGHT;
    }

    template <class Frame_>
    WARPCAM_FN Fetcher(const Frame_& frame, const Words* words, int lane) : from(nullptr), to(0), shift(0), large(0)
    {
        large = share_out(lane, frame.shape.data, words->shape, words, frame.width);
        if constexpr (Words::HAS_DEPTH)
            large = share_out(lane, frame.depth.data, words->depth, words, frame.width);
        if constexpr (Words::HAS_FACES)
            large = share_out(lane, frame.face.data, words->face, words, frame.width);
        if constexpr (Words::HAS_SHADOWS)
            share_out(lane, frame.shadow.data, words->shadow, words, frame.width);
    }

    // Asks for the tile whose first pixel is given.
    WARPCAM_FN void ask(Words* words, unsigned at, int lane) const
    {
        const char* source = from + (size_t(at) << shift);
        char* target = reinterpret_cast<char*>(words) + to;
        if (lane < large)
            copy_ahead<16>(target, source);
        else if (Words::HAS_SHADOWS && lane < large + TILE_HEIGHT)
            copy_ahead<8>(target, source);
    }
};

#endif

}  // namespace warpcam
