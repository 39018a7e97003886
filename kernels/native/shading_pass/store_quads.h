// Four pixels beside each other, which a CUDA thread draws, and what of images is stored of them at once.
#pragma once
#include "shading/appearance.h"
#include "output/pixel_store.h"

namespace warpcam {

// Images that are drawn by four pixels: colours without alpha, with it or both, or one of radiance or albedo.
constexpr bool in_quads(int images)
{
    return images == RGB || images == RGBA || images == (RGB | RGBA) || images == HDR || images == ALBEDO;
}

#if defined(__CUDA_ARCH__)

constexpr int QUAD = 4;

// A number of 0 to 255 in the lowest byte.
WARPCAM_DEVICE unsigned low_byte(float unit) { return unsigned(as_int(saturate(unit) * 255.0f + WHOLE_NUMBERS)); }

WARPCAM_DEVICE unsigned four_bytes(unsigned a, unsigned b, unsigned c, unsigned d)
{
    return __byte_perm(__byte_perm(a, b, 0x0040), __byte_perm(c, d, 0x0040), 0x5410);
}

// Four pixels as they are stored: where there is alpha each is a word.
template <int IMAGES> struct Quad {
    static constexpr int WORDS = IMAGES & HDR ? 3 * QUAD : IMAGES & RGBA ? QUAD : 3;
    unsigned words[WORDS];

    WARPCAM_DEVICE void fill(const Vec3 (&colors)[QUAD])
    {
        unsigned bytes[QUAD][3];
#pragma unroll
        for (int k = 0; k < QUAD; ++k) {
            if constexpr ((IMAGES & HDR) != 0) {
                words[3 * k] = unsigned(as_int(colors[k].x));
                words[3 * k + 1] = unsigned(as_int(colors[k].y));
                words[3 * k + 2] = unsigned(as_int(colors[k].z));
            } else {
                bytes[k][0] = low_byte(colors[k].x);
                bytes[k][1] = low_byte(colors[k].y);
                bytes[k][2] = low_byte(colors[k].z);
            }
            if constexpr ((IMAGES & RGBA) != 0)
                words[k] = four_bytes(bytes[k][0], bytes[k][1], bytes[k][2], 255u);
        }
        if constexpr (WORDS == 3) {
            words[0] = four_bytes(bytes[0][0], bytes[0][1], bytes[0][2], bytes[1][0]);
            words[1] = four_bytes(bytes[1][1], bytes[1][2], bytes[2][0], bytes[2][1]);
            words[2] = four_bytes(bytes[2][2], bytes[3][0], bytes[3][1], bytes[3][2]);
        }
    }

    // Word `n` of the twelve bytes without alpha.
    WARPCAM_DEVICE unsigned bare(int n) const
    {
        if constexpr (WORDS == 3)
            return words[n];
        return __byte_perm(words[n], words[n + 1], n == 0 ? 0x4210 : n == 1 ? 0x5421 : 0x6542);
    }
};

// Columns and rows of an image from a strip's first pixel on.
struct ImagePart {
    int columns, rows;
};

// Stores what a warp has drawn of a strip that is 32 pixels wide and a tile high; where pixels have three numbers all
// of it that is in the image, WHOLE if all is. `own`: number of a lane's first pixel. Of three numbers sixteen bytes
// are stored by each of 24 lanes: `first` is the number of the pixel that a lane's row of such begins with, `piece` the
// lane's place in it; `corner` that of the strip. Rows of bytes that are not WHOLE may begin at any word.
template <bool WHOLE, int IMAGES, class Images_>
WARPCAM_DEVICE void store_quads(const Images_& images, const Quad<IMAGES>& quad, bool drawn, unsigned own,
                                unsigned first, int piece, unsigned corner, const ImagePart& part, int width, int lane,
                                float* row_of_lanes)
{
    if constexpr ((IMAGES & RGBA) != 0)
        if (drawn)
            *reinterpret_cast<uint4*>(images.rgba.data + 4 * size_t(own)) =
                uint4 { quad.words[0], quad.words[1], quad.words[2], quad.words[3] };
    if constexpr ((IMAGES & (RGB | ALBEDO)) != 0) {
        unsigned char* image = IMAGES & RGB ? images.rgb.data : images.albedo.data;
        for (int n = 0; n < 3; ++n)
            row_of_lanes[3 * lane + n] = as_float(int(quad.bare(n)));
        __syncwarp();
        if constexpr (WHOLE) {
            if (lane < 24)
                *reinterpret_cast<float4*>(image + 3 * size_t(first) + 16 * piece) =
                    *reinterpret_cast<const float4*>(row_of_lanes + 4 * lane);
        } else {
            for (int word = lane; word < 3 * WARP_SIZE; word += WARP_SIZE)
                if (const int row = word / 24, place = word % 24; row < part.rows && 4 * place < 3 * part.columns)
                    reinterpret_cast<float*>(image + 3 * size_t(corner + unsigned(row * width)))[place] =
                        row_of_lanes[word];
        }
        __syncwarp();
    }
    if constexpr ((IMAGES & HDR) != 0)
        for (int row = 0; row < TILE_HEIGHT; ++row) {  // there is room for one
            if (lane / TILE_WIDTH == row)
                for (int n = 0; n < quad.WORDS; ++n)
                    row_of_lanes[quad.WORDS * (lane % TILE_WIDTH) + n] = as_float(int(quad.words[n]));
            __syncwarp();
            if (lane < 24 && (WHOLE || (row < part.rows && 4 * lane < 3 * part.columns)))
                reinterpret_cast<float4*>(images.hdr.data + 3 * size_t(corner + unsigned(row * width)))[lane] =
                    reinterpret_cast<const float4*>(row_of_lanes)[lane];
            __syncwarp();
        }
}

#endif

}  // namespace warpcam
