// Writing pixels: the 32 of a warp's tile together, a CPU thread's one by one.
#pragma once
#include "prepare.h"
#include "vectors.h"

namespace warpcam {

WARPCAM_FN float infinity() { return as_float(0x7f800000); }

// One pixel of an image. All 32 threads of a warp call the functions below together.
struct Pixel {
    int column, row;
    unsigned at;  // counted from the first world's first pixel; there are fewer than 2^31
    bool inside;  // of the image
#if defined(__CUDA_ARCH__)
    float* row_of_lanes;  // shared memory of the warp, at least 3 * LANES long, aligned to 16 bytes
    int lane;
    int width, height;  // of the image, from the tile's corner on
    unsigned corner;    // `at` of the tile's first pixel
    int stride;         // width of the image
#endif
};

WARPCAM_FN void put_three(float* image, unsigned at, Vec value)
{
    float* channels = image + 3 * size_t(at);
    channels[0] = value.x;
    channels[1] = value.y;
    channels[2] = value.z;
}

// Three numbers a pixel. QUADS: the image's width is a multiple of four pixels; then a thread stores 16 bytes at once.
template <bool IN_QUADS, class Array> WARPCAM_FN void put_vec(const Array& image, const Pixel& pixel, Vec value)
{
#if defined(__CUDA_ARCH__)
    if (IN_QUADS) {
        constexpr int ROW = 3 * TILE_WIDTH / 4;  // pieces of 16 bytes in a row of the tile
        float* lanes = pixel.row_of_lanes;
        lanes[3 * pixel.lane] = value.x;
        lanes[3 * pixel.lane + 1] = value.y;
        lanes[3 * pixel.lane + 2] = value.z;
        __syncwarp();
        const int row = pixel.lane / ROW, piece = pixel.lane % ROW;
        if (row < TILE_HEIGHT && row < pixel.height && 4 * piece < 3 * pixel.width) {
            float* start = image.data + 3 * size_t(pixel.corner + row * pixel.stride);
            reinterpret_cast<float4*>(start)[piece] = reinterpret_cast<const float4*>(lanes)[pixel.lane];
        }
        __syncwarp();
        return;
    }
#endif
    if (pixel.inside)
        put_three(image.data, pixel.at, value);
}

// The bytes R, G, B of a word. Four neighbouring threads store their twelve bytes as three words.
template <bool IN_QUADS, class Array> WARPCAM_FN void put_bytes(const Array& image, const Pixel& pixel, unsigned word)
{
#if defined(__CUDA_ARCH__)
    if (IN_QUADS) {
        const unsigned next = __shfl_down_sync(ALL, word, 1);
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

template <class Array> WARPCAM_FN void put_word(const Array& image, const Pixel& pixel, unsigned word)
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
