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

// A tile's numbers, row after row, of what is wanted. Rows of bytes are those of two tiles beside each other.
template <class Shape, class Face, bool DEPTH, bool FACES, bool SHADOWS> struct alignas(16) TileWords {
    static constexpr bool HAS_DEPTH = DEPTH, HAS_FACES = FACES, HAS_SHADOWS = SHADOWS;

    Shape shape[LANES];
    float depth[DEPTH ? LANES : 4];
    Face face[FACES ? LANES : 16 / sizeof(Face)];
    unsigned char shadow[SHADOWS ? 2 * LANES : 16];

    // What a lane's pixel shows; it is in that column of the image.
    WARPCAM_FN Seen at(int lane, int column) const
    {
        return { { DEPTH ? depth[lane] : 0.0f, int(shape[lane]), FACES ? int(face[lane]) : 0 },
                 SHADOWS ? int(shadow[lane / TILE_WIDTH * 16 + (column & 15)]) : 0 };
    }
};

#if defined(__CUDA_ARCH__)

WARPCAM_FN void copy_ahead(void* to, const void* from)
{
    const unsigned shared = static_cast<unsigned>(__cvta_generic_to_shared(to));
    asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(shared), "l"(from) : "memory");
}

// Ends what belongs together of the copies; then waits for all but the last that was ended so.
WARPCAM_FN void wait_for_one()
{
    asm volatile("cp.async.commit_group;\n\tcp.async.wait_group 1;" ::: "memory");
}
WARPCAM_FN void end_copies() { asm volatile("cp.async.commit_group;" ::: "memory"); }

// Fetches the tiles of one warp, of which two are kept. Only for images of whole regions, whose rows begin at multiples
// of 16 pixels. Each lane fetches 16 bytes of one row.
template <class Words> struct Fetcher {
    const char* from;  // the lane's piece, if the tile were at the first pixel of all
    char* to;          // where it goes to in the first tile that is kept
    int shift;         // log2 of the bytes of a pixel's number
    int used;          // lanes before this one have something to fetch

    // Gives lanes from `used` on their pieces.
    template <class Value> WARPCAM_FN void share_out(int lane, const Value* data, Value* kept, int width)
    {
        constexpr int SIZE = sizeof(Value), EACH = 16 / SIZE, PIECES = EACH < TILE_WIDTH ? TILE_WIDTH / EACH : 1;
        const int number = lane - used;
        used += PIECES * TILE_HEIGHT;
        if (unsigned(number) < unsigned(PIECES * TILE_HEIGHT)) {
            const int row = number / PIECES, column = number % PIECES * EACH;
            from = reinterpret_cast<const char*>(data + row * width + column);
            to = reinterpret_cast<char*>(kept + row * PIECES * EACH + column);
            shift = SIZE == 4 ? 2 : SIZE == 2 ? 1 : 0;
        }
    }

    template <class Frame_>
    WARPCAM_FN Fetcher(const Frame_& frame, Words* words, int lane) : from(nullptr), to(nullptr), shift(0), used(0)
    {
        share_out(lane, frame.shape.data, words->shape, frame.width);
        if constexpr (Words::HAS_DEPTH)
            share_out(lane, frame.depth.data, words->depth, frame.width);
        if constexpr (Words::HAS_FACES)
            share_out(lane, frame.face.data, words->face, frame.width);
        if constexpr (Words::HAS_SHADOWS)
            share_out(lane, frame.shadow.data, words->shadow, frame.width);
    }

    // Asks for the tile whose first pixel is given; `slot` is which of those that are kept it will be.
    WARPCAM_FN void ask(unsigned at, int slot, int lane) const
    {
        if (lane < used)
            copy_ahead(to + slot * int(sizeof(Words)), from + (size_t(at) << shift & ~size_t(15)));
    }
};

#endif

}  // namespace warpcam
