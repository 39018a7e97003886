// Loss of JPEG: blocks of 8 x 8 numbers are transformed, quantised and transformed back. On CUDA eight lanes hold a
// block, a column each, so that lanes read and write neighbours; on a CPU a thread holds all of it.
#pragma once
#include "core/vec3.h"
#include "sensors/color_bytes.h"

namespace warpcam {

#if defined(__CUDA_ARCH__)
constexpr int JPEG_COLUMNS = 1;  // of a block that a thread holds
#else
constexpr int JPEG_COLUMNS = 8;
#endif

struct JpegBlock {
    float at[8][JPEG_COLUMNS];  // row by row
};

// Which block of which world a thread works on, and the first of its columns.
struct JpegPlace {
    int world, row, column, first_column;
};

WARPCAM_DEVICE JpegPlace jpeg_place(int index, int across, int down)
{
    const int block = index * JPEG_COLUMNS / 8, line = block / across, world = line / down;
    return { world, line - world * down, block - line * across, JPEG_COLUMNS == 1 ? index & 7 : 0 };
}

// The cosine transform of each column (ITU-T T.81, A.3.3), or its inverse.
template <bool INVERSE> WARPCAM_DEVICE void transform_columns(JpegBlock& block)
{
    // Halves of cosines of multiples of pi / 16.
    constexpr float A = 0.35355339f, B = 0.49039264f, C = 0.46193977f, D = 0.41573481f;
    constexpr float E = 0.27778512f, F = 0.19134172f, G = 0.09754516f;
    constexpr float COSINES[8][8] = {
        { A, A, A, A, A, A, A, A },     { B, D, E, G, -G, -E, -D, -B }, { C, F, -F, -C, -C, -F, F, C },
        { D, -G, -B, -E, E, B, G, -D }, { A, -A, -A, A, A, -A, -A, A }, { E, -B, G, D, -D, -G, B, -E },
        { F, -C, C, -F, -F, C, -C, F }, { G, -E, D, -B, B, -D, E, -G },
    };
    const JpegBlock given = block;
#pragma unroll
    for (int row = 0; row < 8; ++row) {
#pragma unroll
        for (int column = 0; column < JPEG_COLUMNS; ++column) {
            float sum = 0.0f;
#pragma unroll
            for (int k = 0; k < 8; ++k)
                sum += (INVERSE ? COSINES[k][row] : COSINES[row][k]) * given.at[k][column];
            block.at[row][column] = sum;
        }
    }
}

WARPCAM_DEVICE void transpose(JpegBlock& block)
{
#if defined(__CUDA_ARCH__)
    const int lane = threadIdx.x & 31;
    const unsigned lanes = 0xffu << (lane & 24);
#pragma unroll
    for (int step = 1; step < 8; step *= 2) {
        const bool is_upper = lane & step;
#pragma unroll
        for (int row = 0; row < 8; ++row) {
            if (row & step)
                continue;
            float &near = block.at[row][0], &far = block.at[row + step][0];
            const float other = __shfl_xor_sync(lanes, is_upper ? near : far, step);
            near = is_upper ? other : near;
            far = is_upper ? far : other;
        }
    }
#else
    const JpegBlock given = block;
    for (int row = 0; row < 8; ++row)
        for (int column = 0; column < 8; ++column)
            block.at[row][column] = given.at[column][row];
#endif
}

WARPCAM_DEVICE float jpeg_byte(float value) { return round_down(clamp(value, 0.0f, 255.0f) + 0.5f); }

// A byte as a share of 255.
WARPCAM_DEVICE float jpeg_share(float byte) { return quotient(byte, 255.0f, 1.0f / 255.0f); }

// Numbers of bytes, less 128, as they come back from the file; steps are those of the frequencies, row by row.
WARPCAM_DEVICE void code_block(JpegBlock& block, const float* steps, int first_column)
{
    transform_columns<false>(block);
    transpose(block);
    transform_columns<false>(block);
    transpose(block);
#pragma unroll
    for (int row = 0; row < 8; ++row) {
#pragma unroll
        for (int column = 0; column < JPEG_COLUMNS; ++column) {
            const float step = steps[8 * row + first_column + column];
            block.at[row][column] = step * wp::round(quotient(block.at[row][column], step, rcp(step)));
        }
    }
    transform_columns<true>(block);
    transpose(block);
    transform_columns<true>(block);
    transpose(block);
}

// Bytes of red, green and blue of a pixel of all worlds: as they are, or of numbers.
template <class Image, class Colors>
WARPCAM_DEVICE Vec3 color_bytes(const Image& image, const Colors& source, size_t pixel)
{
    if (source.kind != NUMBERS_KIND) {
        const unsigned char* color = source.bytes.data + pixel * source.bytes.shape[2];
        return { float(color[0]), float(color[1]), float(color[2]) };
    }
    const auto& color = source.numbers.data[pixel];
    if (image.is_linear) {
        const int* bytes = image.bytes_of_light.data;
        return { encoded_byte(bytes, color[0]), encoded_byte(bytes, color[1]), encoded_byte(bytes, color[2]) };
    }
    return { jpeg_byte(255.0f * color[0]), jpeg_byte(255.0f * color[1]), jpeg_byte(255.0f * color[2]) };
}

// Luma and both chromas as bytes (JFIF, ITU-R BT.601) of bytes.
WARPCAM_DEVICE Vec3 jpeg_color(Vec3 rgb)
{
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(off)
#endif
    return { jpeg_byte(0.299f * rgb.x + 0.587f * rgb.y + 0.114f * rgb.z),
             jpeg_byte(0.5f * rgb.z - 0.168736f * rgb.x - 0.331264f * rgb.y + 128.0f),
             jpeg_byte(0.5f * rgb.x - 0.418688f * rgb.y - 0.081312f * rgb.z + 128.0f) };
}

// Codes a block of chroma of an image that is SCALE times smaller, and writes the luma that is in front of it.
template <int SCALE, class Mask, class Image, class Colors>
WARPCAM_DEVICE void code_jpeg_chroma(const Mask& mask, const Image& image, const Colors& source, int index)
{
    const int width = image.width, height = image.height, across = image.chroma_across;
    const JpegPlace place = jpeg_place(index, across, image.chroma_down);
    if (!mask.data[place.world])
        return;
    const size_t start = size_t(place.world) * width * height;
    unsigned char* luma = image.luma.data + start;
    JpegBlock to_blue, to_red;
#pragma unroll
    for (int row = 0; row < 8; ++row) {
#pragma unroll
        for (int column = 0; column < JPEG_COLUMNS; ++column) {
            const int left = SCALE * (8 * place.column + place.first_column + column);
            const int top = SCALE * (8 * place.row + row);
            float blue = 0.0f, red = 0.0f;
#pragma unroll
            for (int k = 0; k < SCALE * SCALE; ++k) {
                const int x = left + k % SCALE, y = top + k / SCALE;
                const size_t pixel = start + min(y, height - 1) * width + min(x, width - 1);
                const Vec3 color = jpeg_color(color_bytes(image, source, pixel));
                blue += color.y;
                red += color.z;
                if (x < width && y < height)
                    luma[y * width + x] = (unsigned char)color.x;
            }
            constexpr float SHARE = 1.0f / (SCALE * SCALE);
            to_blue.at[row][column] = round_down(SHARE * blue + 0.5f) - 128.0f;
            to_red.at[row][column] = round_down(SHARE * red + 0.5f) - 128.0f;
        }
    }
    const float* steps = image.steps.data + 128 * place.world + 64;
    code_block(to_blue, steps, place.first_column);
    code_block(to_red, steps, place.first_column);
    auto* chroma = image.chroma.data + size_t(place.world) * 64 * across * image.chroma_down;
#pragma unroll
    for (int row = 0; row < 8; ++row) {
#pragma unroll
        for (int column = 0; column < JPEG_COLUMNS; ++column) {
            auto& pair = chroma[(8 * place.row + row) * 8 * across + 8 * place.column + place.first_column + column];
            pair[0] = (unsigned char)jpeg_byte(to_blue.at[row][column] + 128.0f);
            pair[1] = (unsigned char)jpeg_byte(to_red.at[row][column] + 128.0f);
        }
    }
}

// Both chromas of a pixel: those to red are above 2^16.
WARPCAM_DEVICE unsigned chroma_pair(const unsigned char* chroma, int pixel)
{
    const auto pair = load_vector<2>(chroma + 2 * pixel);
    return pair.at[0] | unsigned(pair.at[1]) << 16;
}

// Chroma of eight pixels of a column from a row on: of half resolution, 9/16 of the nearest and the rest of its
// neighbours, as libjpeg does.
template <int SCALE> WARPCAM_DEVICE void load_chroma(const unsigned char* chroma, int x, int top, int across, int down,
                                                     int stride, unsigned (&pairs)[8])
{
    if constexpr (SCALE == 1) {
#pragma unroll
        for (int row = 0; row < 8; ++row)
            pairs[row] = chroma_pair(chroma, (top + row) * stride + x);
    } else {
        const int column = x / 2, other = max(min(column + 2 * (x & 1) - 1, across - 1), 0);
        unsigned mixed[6];
#pragma unroll
        for (int k = 0; k < 6; ++k) {
            const int start = max(min(top / 2 - 1 + k, down - 1), 0) * stride;
            mixed[k] = 3 * chroma_pair(chroma, start + column) + chroma_pair(chroma, start + other);
        }
#pragma unroll
        for (int row = 0; row < 8; ++row) {
            const unsigned sums = 3 * mixed[row / 2 + 1] + mixed[row / 2 + 2 * (row & 1)];
            pairs[row] = (sums + 0x00080008u) >> 4 & 0x00ff00ffu;
        }
    }
}

// Codes a block of luma, and writes colours of it with the chroma.
template <int SCALE, class Mask, class Image, class Target>
WARPCAM_DEVICE void code_jpeg_luma(const Mask& mask, const Image& image, const Target& target, int index)
{
#if !defined(__CUDA_ARCH__)
#pragma clang fp contract(off)
#endif
    const int width = image.width, height = image.height;
    const JpegPlace place = jpeg_place(index, image.luma_across, image.luma_down);
    if (!mask.data[place.world])
        return;
    const size_t start = size_t(place.world) * width * height;
    const unsigned char* luma = image.luma.data + start;
    const int left = 8 * place.column + place.first_column, top = 8 * place.row;
    JpegBlock block;
#pragma unroll
    for (int row = 0; row < 8; ++row) {
#pragma unroll
        for (int column = 0; column < JPEG_COLUMNS; ++column)
            block.at[row][column] = luma[min(top + row, height - 1) * width + min(left + column, width - 1)] - 128.0f;
    }
    code_block(block, image.steps.data + 128 * place.world, place.first_column);
    const int stride = 8 * image.chroma_across, across = (width + 1) / 2, down = (height + 1) / 2;
    const size_t chroma_start = size_t(place.world) * 8 * stride * image.chroma_down;
    const auto* chroma = reinterpret_cast<const unsigned char*>(image.chroma.data + chroma_start);
#pragma unroll
    for (int column = 0; column < JPEG_COLUMNS; ++column) {
        const int x = left + column;
        if (x >= width)
            break;
        unsigned pairs[8];
        load_chroma<SCALE>(chroma, x, top, across, down, stride, pairs);
#pragma unroll
        for (int row = 0; row < 8; ++row) {
            if (top + row >= height)
                break;
            const float light = jpeg_byte(block.at[row][column] + 128.0f);
            const float to_blue = float(pairs[row] & 0xffu) - 128.0f, to_red = float(pairs[row] >> 16) - 128.0f;
            const size_t number = 3 * (start + (top + row) * width + x);
            set_number(target, number, jpeg_share(jpeg_byte(light + 1.402f * to_red)));
            const float green = light - 0.344136f * to_blue - 0.714136f * to_red;
            set_number(target, number + 1, jpeg_share(jpeg_byte(green)));
            set_number(target, number + 2, jpeg_share(jpeg_byte(light + 1.772f * to_blue)));
        }
    }
}

}  // namespace warpcam
