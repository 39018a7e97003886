// Whole images whose edges are smoothed where they were lit, on CUDA: a block writes the means of a picture's pixels
// when it has seen what all of them showed.
#pragma once
#include "antialiasing/samples.h"

#if defined(__CUDA_ARCH__)
namespace warpcam {

// Pixels with edges that a block lists, and of how many rows of tiles of a region all pixels surely fit.
constexpr int LISTED_IN_PLACE = 1560, BAND = (LISTED_IN_PLACE - THREADS + WARP_SIZE) / (64 * TILE_HEIGHT);

// Means of pixels that wait until nobody reads what they showed before, where images are smoothed in place: those of a
// band's last row until the next band is done.
struct Waiting {
    unsigned means[64];
    unsigned short places[64];
    int count;
};

// Packs what a pixel's samples show, with the pixel's position, into the bits of a ListedPixel whose samples are
// traced.
WARPCAM_DEVICE unsigned shown_bits(int place, const unsigned char (&shown)[SAMPLES])
{
    unsigned bits = unsigned(place) << 4 * SAMPLES;
    for (int sample = 0; sample < SAMPLES; ++sample)
        bits |= unsigned(shown[sample]) << 4 * sample;
    return bits;
}

// Writes the means of these pixels; `means` has room for them. Their band ends where the row `end` begins, and is the
// last of the region if `last`; `end` is 0 where there are no bands. With barriers, but after the last band.
template <int IMAGES, int LENS, class Bits, class Centres>
WARPCAM_DEVICE void put_in_place(const Bits* listed, int count, unsigned* means, Waiting& waiting, int end, bool last,
                                 const EdgeTester<LENS, Centres>& seen, const Region& region)
{
    const auto& target = seen.centres.target;
    const auto index = [&](unsigned place) {
        return seen.centres.of_images(region.left + int(place % 64), region.top + int(place / 64));
    };
#pragma unroll 1
    for (int k = threadIdx.x; k < count; k += THREADS) {
        const unsigned bits = listed[k].bits, place = bits >> 4 * SAMPLES;
        unsigned by[SAMPLES];
        for (int sample = 0; sample < SAMPLES; ++sample)
            by[sample] =
                seen.around(region.left + int(place % 64), region.top + int(place / 64), int(bits >> 4 * sample & 15));
        means[k] = mean_bytes<IMAGES>(seen.centres, by);
    }
    block_sync();
    if (end > 0) {
#pragma unroll 1
        for (int k = threadIdx.x; k < waiting.count; k += THREADS)
            put_bytes<IMAGES>(target, index(waiting.places[k]), waiting.means[k]);
        block_sync();
        if (threadIdx.x == 0)
            waiting.count = 0;
        block_sync();
    }
#pragma unroll 1
    for (int k = threadIdx.x; k < count; k += THREADS) {
        const unsigned place = listed[k].bits >> 4 * SAMPLES;
        if (!last && int(place / 64) == end - 1) {
            const int at = atomicAdd(&waiting.count, 1);
            waiting.places[at] = static_cast<unsigned short>(place);
            waiting.means[at] = means[k];
        } else {
            put_bytes<IMAGES>(target, index(place), means[k]);
        }
    }
    if (!last)
        block_sync();
}

}  // namespace warpcam
#endif
