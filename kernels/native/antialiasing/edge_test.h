// Edges of an image, and which of its pixels shows what a sample beside a pixel's centre has hit.
#pragma once
#include "camera/shape_setup.h"
#include "camera/sample_offsets.h"
#if !defined(__CUDA_ARCH__)
#include "core/simd8.h"
#endif

namespace warpcam {

// A surface has an edge where its slope, of depth over width, changes by more than this from pixel to pixel.
constexpr float EDGE_SLOPE = 1.0f;
// Colours that differ by so much or less are about the same [levels of 255], at an edge of a shape and within one. Of a
// pixel's mean a sample is a quarter.
constexpr int COLOR_TOLERANCE = 12, TOLERANCE_WITHIN = 24, TOLERANCE_OF_SIDES = 32;
// Weight of distance in depth against distance in the image: among pixels that may show a sample's surface, one that is
// this many pixel widths apart in depth counts as one that is a pixel width aside.
constexpr float DEPTH_WEIGHT = 8.0f;
// One whose surface is turned by a right angle is as bad as one that lies so many pixels' widths aside, squared.
constexpr float NORMAL_WEIGHT = 2.0f;
// Extrapolation limits beyond the depths around a sample: in parts of their range, and in pixel widths.
constexpr float BEYOND = 2.5f, ASIDE = 4.0f;
constexpr int ITSELF = 4;  // of the nine pixels around one
constexpr unsigned EVERY_SAMPLE = (1u << SAMPLES) - 1;
// Bit beside those of a pixel's samples: all neighbours that show the pixel's shape have about its colour.
constexpr unsigned PLAIN = 1u << SAMPLES;
// Images: bits in the order of antialiasing.py.
constexpr int SMOOTH_RGB = 1, SMOOTH_RGBA = 2, SMOOTH_HDR = 4;

struct Neighbour {
    int right, down;  // of a pixel [pixels]
};

// Returns the k-th nearest of the nine pixels around one to a sample, by its offset from the centre pixel.
WARPCAM_DEVICE Neighbour near_sample(Offset offset, int k)
{
    // 1 being the pixel's own line and 2 that on the sample's side: bits by twos for the direction in which the sample
    // is farther from the centre, and for the other
    constexpr unsigned FARTHER = 0x999, OTHER = 0x90a5;
    const bool upright = abs(offset.down) > abs(offset.right);
    const int x = offset.right > 0.0f ? 1 : -1, y = offset.down > 0.0f ? 1 : -1;
    const int farther = int(FARTHER >> 2 * k & 3) - 1, other = int(OTHER >> 2 * k & 3) - 1;
    return { x * (upright ? other : farther), y * (upright ? farther : other) };
}
WARPCAM_DEVICE int number_of(const Neighbour& place)
{
    return 3 * (place.down + 1) + place.right + 1;
}  // see PixelSource::around()

// Depths between which a sample's hit is looked for, on shapes that take long: about those that the pixels around have.
struct Band {
    float first, last;  // the first is greater where there are none

    WARPCAM_DEVICE void include(float depth)
    {
        first = min(first, depth);
        last = max(last, depth);
    }

    // With room for slopes that grow beyond the pixels' centres; `width` is that of a pixel at a depth of 1 m. What is
    // widths_at() is written out here and below: of a call the compiler makes a second load of the width.
    template <int LENS> WARPCAM_DEVICE Band widened(float width) const
    {
        const float margin = BEYOND * (last - first)
                             + ASIDE * width
                                   * (LENS == RAY_TABLE_WITH_ORIGINS ? 1.0f + last
                                      : LENS != ORTHOGRAPHIC         ? last
                                                                     : 1.0f);
        return { first - margin, last + margin };
    }
};

// True if three depths of rays with own origins are not on one plane. Such rays diverge or start apart: 1 / depth is
// linear, or depth.
template <class Number> WARPCAM_DEVICE auto is_bent(Number a, Number b, Number c, float width)
{
    const Number apart = EDGE_SLOPE * width * widths_at<RAY_TABLE_WITH_ORIGINS>(b);
    return (abs(a + c - 2.0f * b) > apart) & (abs(b * (a + c) - 2.0f * a * c) > apart * b);
}

constexpr Band NOWHERE { MISS, -MISS };

// The ground is not looked for where it lies so far behind all else around a pixel that it must be what is seen there
// where nothing else is: `ground` and `others` are their depths, `sky` that nothing is seen around, too; `width` as
// above.
template <int LENS> WARPCAM_DEVICE bool is_behind(const Band& ground, const Band& others, bool sky, float width)
{
    return !sky && others.last > 0.0f
           && ground.first > others.last
                                 + ASIDE * width
                                       * (LENS == RAY_TABLE_WITH_ORIGINS ? 1.0f + others.last
                                          : LENS != ORTHOGRAPHIC         ? others.last
                                                                         : 1.0f);
}

// A pixel's colour of 8 bits a channel; alpha is 0 where only rgb is smoothed.
template <int IMAGES, class Target> WARPCAM_DEVICE unsigned load_bytes(const Target& target, unsigned pixel)
{
    constexpr int CHANNELS = IMAGES & SMOOTH_RGBA ? 4 : 3;  // the first three are the same in both
    const unsigned char* image = (IMAGES & SMOOTH_RGBA ? target.rgba : target.rgb).data + CHANNELS * size_t(pixel);
    if (CHANNELS == 4)
        return *reinterpret_cast<const unsigned*>(image);
    unsigned bytes = 0;
    for (int k = 0; k < CHANNELS; ++k)
        bytes |= unsigned(image[k]) << 8 * k;
    return bytes;
}

// True if two such colours differ by more than `levels` in any channel.
WARPCAM_DEVICE bool bytes_differ(unsigned one, unsigned other, int levels)
{
#if defined(__CUDA_ARCH__)
    constexpr unsigned EVERY_BYTE = 0x01010101, LOWER = 0x7f * EVERY_BYTE, HIGHEST_BITS = 0x80 * EVERY_BYTE;
    const unsigned apart = __vabsdiffu4(one, other);
    return ((apart | ((apart & LOWER) + EVERY_BYTE * unsigned(0x7f - levels))) & HIGHEST_BITS) != 0;
#else
    // two channels at once, in 16 bits each: 256 and what one has more than the other, then the highest bit is set if
    // that is above the range, or not below it
    constexpr unsigned EVERY_OTHER = 0x00ff00ff, BOTH = 0x00010001, HIGHEST = 0x80008000;
    const unsigned even = ((one & EVERY_OTHER) | 256 * BOTH) - (other & EVERY_OTHER);
    const unsigned odd = ((one >> 8 & EVERY_OTHER) | 256 * BOTH) - (other >> 8 & EVERY_OTHER);
    const unsigned above = BOTH * unsigned(0x7fff - 256 - levels), from = BOTH * unsigned(0x8000 - 256 + levels);
    return (((even + above) | (odd + above) | ~(even + from) | ~(odd + from)) & HIGHEST) != 0;
#endif
}

// A pixel's colour in the images.
template <int IMAGES> struct Colour {
    unsigned bytes;
    float hdr[3];

    // True if the colours differ by more than `levels` of 255 in any channel.
    WARPCAM_DEVICE bool differs(const Colour& other, int levels) const
    {
        bool found = false;
        for (int k = 0; k < 3 && (IMAGES & SMOOTH_HDR); ++k)
            found |= 255.0f * abs(hdr[k] - other.hdr[k]) > float(levels);
        if (IMAGES & (SMOOTH_RGB | SMOOTH_RGBA))
            found |= bytes_differ(bytes, other.bytes, levels);
        return found;
    }
};

#if !defined(__CUDA_ARCH__)

// Bit mask of the colours, of eight, that differ.
template <int IMAGES>
inline unsigned which_differ(const Colour<IMAGES>& its, const Colour<IMAGES> (&others)[SIMD_WIDTH], int levels)
{
    unsigned found = 0;
    for (int k = 0; k < SIMD_WIDTH && (IMAGES & SMOOTH_HDR); ++k)
        found |= unsigned(its.differs(others[k], levels)) << k;
    if constexpr (!(IMAGES & SMOOTH_HDR)) {
        typedef unsigned char Bytes __attribute__((ext_vector_type(4 * SIMD_WIDTH)));
        Int8 words;
        for (int k = 0; k < SIMD_WIDTH; ++k)
            words[k] = int(others[k].bytes);
        const Bytes theirs = (Bytes)words, own = (Bytes)(Int8) int(its.bytes);
        const Bytes apart = __builtin_elementwise_sub_sat(theirs, own) | __builtin_elementwise_sub_sat(own, theirs);
        const Bytes most = static_cast<unsigned char>(levels);
        found = movemask((Int8)__builtin_elementwise_sub_sat(apart, most) != 0);
    }
    return found;
}

#endif

// Trace results and colours at the centres of a view's pixels, read from its images. A pixel is an index into these.
template <class Target> struct PixelSource {
    static constexpr bool BORDERED = false;  // there are no pixels outside of the image
    static constexpr bool PLACED = false;  // whether bytes_around() is there

    const Target& target;
    unsigned first;  // the view's first pixel

    WARPCAM_DEVICE unsigned at(int i, int j) const { return first + unsigned(j * target.width + i); }
    WARPCAM_DEVICE unsigned line() const { return unsigned(target.width); }
    // True if four_ids() is available: the ids of four pixels, from a multiple of four on, form one word.
    WARPCAM_DEVICE bool has_fours() const { return sizeof(target.shape.data[0]) == 1 && target.width % 4 == 0; }
    WARPCAM_DEVICE unsigned four_ids(int i, int j) const
    {
        const int column = max(min(i, target.width - 4), 0), row = max(min(j, target.height - 1), 0);
        return reinterpret_cast<const unsigned*>(target.shape.data)[at(column, row) / 4];
    }
    WARPCAM_DEVICE unsigned of_images(unsigned pixel) const { return pixel; }
    WARPCAM_DEVICE unsigned of_images(int i, int j) const { return at(i, j); }
    WARPCAM_DEVICE int shape(unsigned pixel) const { return target.shape.data[pixel]; }
    WARPCAM_DEVICE float depth(unsigned pixel) const { return target.depth.data[pixel]; }
    template <int IMAGES> WARPCAM_DEVICE unsigned bytes(unsigned pixel) const
    {
        return load_bytes<IMAGES>(target, pixel);
    }

    WARPCAM_DEVICE bool shows(int i, int j, int shape_) const
    {
        const bool inside = i >= 0 && i < target.width && j >= 0 && j < target.height;
        return inside & (shape(inside ? at(i, j) : first) == shape_);
    }

    // One of the nine pixels around one, row after row: the nearest of the image.
    WARPCAM_DEVICE unsigned around(int i, int j, int k) const
    {
        const int column = i + k % 3 - 1, row = j + k / 3 - 1;
        return at(column < 0 ? 0 : min(column, target.width - 1), row < 0 ? 0 : min(row, target.height - 1));
    }
};

// PixelSource together with what the samples of its pixels show. `Centres` holds the pixels: see PixelSource.
template <int LENS, class Centres> struct EdgeTester {
    const Centres& centres;
    float scale_x, scale_y;  // width and height of a pixel, at a depth of 1 m or everywhere [m]

    WARPCAM_DEVICE unsigned at(int i, int j) const { return centres.at(i, j); }
    WARPCAM_DEVICE int shape(unsigned pixel) const { return centres.shape(pixel); }
    WARPCAM_DEVICE float depth(unsigned pixel) const { return centres.depth(pixel); }
    WARPCAM_DEVICE unsigned around(int i, int j, int k) const { return centres.around(i, j, k); }

    // True if three pixels in a row are not on one plane. On a plane 1 / depth is linear in a pinhole image.
    WARPCAM_DEVICE bool turns(unsigned before, unsigned here, unsigned after, float scale) const
    {
        return turns_at(depth(before), depth(here), depth(after), scale);
    }
    WARPCAM_DEVICE bool turns_at(float a, float b, float c, float scale) const
    {
        if (LENS == RAY_TABLE_WITH_ORIGINS)
            return is_bent(a, b, c, scale);
        if (LENS != ORTHOGRAPHIC)
            return abs(b * (a + c) - 2.0f * a * c) > EDGE_SLOPE * scale * (a * c);
        return abs(a + c - 2.0f * b) > EDGE_SLOPE * scale;
    }

    // The samples in whose pair, the pixel beside and the one across, any bit of a ring is set: see edge().
    WARPCAM_DEVICE static unsigned of_pairs(unsigned ring)
    {
        return unsigned((ring & 0x03) != 0) | unsigned((ring & 0xc0) != 0) << 1 | unsigned((ring & 0x0c) != 0) << 2
               | unsigned((ring & 0x30) != 0) << 3;
    }

    template <int IMAGES> WARPCAM_DEVICE Colour<IMAGES> colour(unsigned pixel) const
    {
        Colour<IMAGES> found {};
        if (IMAGES & SMOOTH_HDR)
            for (int k = 0; k < 3; ++k)
                found.hdr[k] = centres.target.hdr.data[3 * size_t(centres.of_images(pixel)) + k];
        if (IMAGES & (SMOOTH_RGB | SMOOTH_RGBA))
            found.bytes = centres.template bytes<IMAGES>(pixel);
        return found;
    }

    // Bit mask of the pixel's samples that may hit something else than the pixel's centre does.
    //
    // A pixel has an edge if one of its four neighbours shows another shape: then the mask holds the samples whose
    // triangle, of the pixel's centre, that of a neighbour and that of one across, has another shape at a corner, as
    // three pixels that show one shape have no edge between them. A pixel whose surface is bent has an edge, too: then
    // the mask holds all samples. In both cases the edge must be visible:
    template <int IMAGES, class HasSides> WARPCAM_DEVICE unsigned edge(int i, int j, const HasSides& has_sides) const
    {
        const unsigned pixel = at(i, j), line = centres.line();
        const bool has_left = i > 0, has_right = i + 1 < centres.target.width;
        const bool has_up = j > 0, has_down = j + 1 < centres.target.height;
        constexpr bool BORDERED = Centres::BORDERED;
        const unsigned west = BORDERED || has_left ? pixel - 1 : pixel,
                       east = BORDERED || has_right ? pixel + 1 : pixel;
        const unsigned above = BORDERED || has_up ? line : 0, below = BORDERED || has_down ? line : 0;
        // the pixels around, from the one below on by way of the left: as bits, too
        const unsigned ring[8] { pixel + below, west + below, west, west - above,
                                 pixel - above, east - above, east, east + below };
        const int here = shape(pixel);
        unsigned other = 0;  // that show another shape
#pragma unroll
        for (int k = 0; k < 8; k += 2)
            other |= unsigned(shape(ring[k]) != here) << k;
        const bool within = !other, sided = !within && has_sides(here);
        unsigned samples = 0;
        if (!within) {
#pragma unroll
            for (int k = 1; k < 8; k += 2)
                other |= unsigned(shape(ring[k]) != here) << k;
            samples = of_pairs(other);
        } else if (here >= 0
                   && ((has_left && has_right && turns(west, pixel, east, scale_x))
                       || (has_up && has_down && turns(ring[4], pixel, ring[0], scale_y)))) {
            samples = EVERY_SAMPLE;
        }
        if (samples || sided) {
            Colour<IMAGES> its {}, around[8] {};
            if constexpr (Centres::PLACED) {
                unsigned nine[9];
                centres.template bytes_around<IMAGES>(i, j, nine);
                constexpr int places[8] { 7, 6, 3, 0, 1, 2, 5, 8 };
                its.bytes = nine[4];
#pragma unroll
                for (int k = 0; k < 8; ++k)
                    around[k].bytes = nine[places[k]];
            } else {
                its = colour<IMAGES>(pixel);
#pragma unroll
                for (int k = 0; k < 8; ++k)
                    around[k] = colour<IMAGES>(ring[k]);
            }
            unsigned gaps = 0, wide_gaps = 0;
#if defined(__CUDA_ARCH__)
#pragma unroll
            for (int k = 0; k < 8; ++k) {
                const Colour<IMAGES>& beside = around[k];
                gaps |= unsigned(its.differs(beside, within ? TOLERANCE_WITHIN : COLOR_TOLERANCE)) << k;
                wide_gaps |= unsigned(its.differs(beside, TOLERANCE_OF_SIDES)) << k;
            }
#else
            gaps = which_differ(its, around, within ? TOLERANCE_WITHIN : COLOR_TOLERANCE);
            wide_gaps = sided ? which_differ(its, around, TOLERANCE_OF_SIDES) : 0;
#endif
            samples &= of_pairs(gaps | gaps >> 1 | gaps << 7);
            if (sided)  // of which two may meet in the triangle
                samples |= of_pairs(wide_gaps) & ~of_pairs(other);
            if (samples && !within && !(gaps & ~other))
                samples |= PLAIN;
        }
        return samples;
    }

    // Selects, from the nine pixels around (i, j), the one nearest to a sample that shows a given shape, or nothing, as
    // shown() does.
    WARPCAM_DEVICE int nearest(int i, int j, int sample, int hit_shape) const
    {
        return shown<0>(i, j, sample_offset(sample), 0.0f, hit_shape, false, [](int, int, unsigned) { return 0.0f; });
    }

    // Distance in depth between a hit and what a pixel shows.
    WARPCAM_DEVICE float apart(unsigned pixel, float hit_depth) const
    {
        return abs(depth(pixel) - hit_depth) * rcp(DEPTH_WEIGHT * scale_x * widths_at<LENS>(hit_depth));
    }

    // Selects, from the nine pixels around (i, j), the one that shows what a sample has hit: the nearest by position
    // and, for a shape with sides, by depth and by normal_cost(i, j, pixel), how far its surface turns from the one
    // hit, if the pixels differ in colour. Returns the pixel itself if none shows the hit. Numbers are those of
    // around().
    template <int IMAGES, class NormalCost> WARPCAM_DEVICE int shown(int i, int j, Offset offset, float hit_depth,
                                                                     int hit_shape, bool sided,
                                                                     const NormalCost& normal_cost) const
    {
        unsigned left = 0;  // those that show the shape, from near to far
#pragma unroll
        for (int k = 0; k < 9; ++k) {
            const Neighbour at_k = near_sample(offset, k);
            left |= unsigned(centres.shows(i + at_k.right, j + at_k.down, hit_shape)) << k;
        }
        return left ? select<IMAGES>(left, i, j, offset, hit_depth, sided, normal_cost) : ITSELF;
    }

    // Selects likewise from the pixels in `left`, numbered from near to far.
    template <int IMAGES, class NormalCost> WARPCAM_DEVICE int select(unsigned left, int i, int j, Offset offset,
                                                                      float hit_depth, bool sided,
                                                                      const NormalCost& normal_cost) const
    {
        const auto aside = [&](int k) { return near_sample(offset, k); };
        if (!sided)
            return number_of(aside(ctz(left)));

        const auto pixel_of = [&](const Neighbour& place) { return at(i + place.right, j + place.down); };
        const auto apart_from = [&](const Neighbour& place) {
            const float right = float(place.right) - offset.right, down = float(place.down) - offset.down;
            return right * right + down * down;
        };
        const auto cost_of = [&](const Neighbour& place, float most) {  // or what it is at least, if that is so much
            const float its = apart_from(place) + apart(pixel_of(place), hit_depth);
            return its < most ? its + normal_cost(i + place.right, j + place.down, pixel_of(place)) : its;
        };
        Neighbour best_at = aside(ctz(left));
        Colour<IMAGES> best_colour = colour<IMAGES>(pixel_of(best_at));
        float best = MISS;  // not known before some other pixel has another colour
        for (left &= left - 1; left; left &= left - 1) {
            const Neighbour place = aside(ctz(left));
            if (apart_from(place) >= best)
                break;
            const Colour<IMAGES> its = colour<IMAGES>(pixel_of(place));
            if (!best_colour.differs(its, COLOR_TOLERANCE))
                continue;
            if (best == MISS)
                best = cost_of(best_at, MISS);
            const float cost = cost_of(place, best);
            if (cost < best) {
                best = cost;
                best_colour = its;
                best_at = place;
            }
        }
        return number_of(best_at);
    }
};

}  // namespace warpcam
