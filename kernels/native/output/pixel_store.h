// Writing pixels: the 32 of a warp's tile together, a CPU thread's one by one.
#pragma once
#include "camera/shape_setup.h"
#include "core/vec3.h"

namespace warpcam {

WARPCAM_DEVICE float infinity() { return as_float(0x7f800000); }

// One pixel of an image. All 32 threads of a warp call the functions below together.
struct Pixel {
    int column, row;
    unsigned at;  // counted from the first world's first pixel; there are fewer than 2^31
    bool inside;  // of the image
#if defined(__CUDA_ARCH__)
    float* row_of_lanes;  // shared memory of the warp, 3 * WARP_SIZE long, aligned to 16 bytes
    int lane;
    int width, height;  // of the image, from the tile's corner on
#endif
};

WARPCAM_DEVICE void put_three(float* image, unsigned at, Vec3 value)
{
    float* channels = image + 3 * size_t(at);
    channels[0] = value.x;
    channels[1] = value.y;
    channels[2] = value.z;
}

// Two pixels beside each other, at once.
template <class Value, class Given> WARPCAM_DEVICE void put_two(Value* image, Given first, Given second)
{
    *reinterpret_cast<AlignedArray<Value, 2>*>(image) = { { static_cast<Value>(first), static_cast<Value>(second) } };
}

// Three numbers a pixel. STORE_QUADS: the image's width is a multiple of four pixels; then a thread stores 16 bytes at
// once.
template <bool IN_QUADS, class Array> WARPCAM_DEVICE void put_vec(const Array& image, const Pixel& pixel, Vec3 value)
{
#if defined(__CUDA_ARCH__)
    if (IN_QUADS) {
        const int piece = pixel.lane % TILE_WIDTH;  // of 16 bytes of a row of the tile; the last two threads have none
        float* lanes = pixel.row_of_lanes + 3 * pixel.lane;
        size_t bytes = 12 * size_t(pixel.at);
        asm("" : "+l"(bytes));  // or the compiler adds `piece`, which is the same for all tiles, to it
        lanes[0] = value.x;
        lanes[1] = value.y;
        lanes[2] = value.z;
        __syncwarp();
        if (4 * piece < 3 * min(pixel.width, TILE_WIDTH) && pixel.lane / TILE_WIDTH < pixel.height)
            *reinterpret_cast<float4*>(reinterpret_cast<char*>(image.data + piece) + bytes) =
                *reinterpret_cast<const float4*>(lanes + piece);
        __syncwarp();
        return;
    }
#endif
    if (pixel.inside)
        put_three(image.data, pixel.at, value);
}

// The bytes R, G, B of a word. Four neighbouring threads store their twelve bytes as three words.
template <bool IN_QUADS, class Array>
WARPCAM_DEVICE void put_bytes(const Array& image, const Pixel& pixel, unsigned word)
{
#if defined(__CUDA_ARCH__)
    if (IN_QUADS) {
        const unsigned next = __shfl_down_sync(FULL_WARP, word, 1);
        const int place = pixel.lane & 3;
        const unsigned joined = word >> 8 * place | next << (24 - 8 * place);
        if (pixel.inside && place < 3)
            reinterpret_cast<unsigned*>(image.data + 3 * size_t(pixel.at - place))[place] = joined;
        return;
    }
#endif
    if (pixel.inside)
        for (int k = 0; k < 3; ++k)
            image.data[3 * size_t(pixel.at) + k] = static_cast<unsigned char>(word >> 8 * k);
}

template <class Array> WARPCAM_DEVICE void put_word(const Array& image, const Pixel& pixel, unsigned word)
{
    if (pixel.inside) {
#if defined(__CUDA_ARCH__)
        reinterpret_cast<unsigned*>(image.data)[pixel.at] = word;
#else
        for (int k = 0; k < 4; ++k)
            image.data[4 * size_t(pixel.at) + k] = static_cast<unsigned char>(word >> 8 * k);
#endif
    }
}

}  // namespace warpcam
