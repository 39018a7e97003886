// Edges of an image, and which of its pixels shows what a sample beside a pixel's centre has hit.
#pragma once
#include "prepare.h"

namespace warpcam {

// A surface has an edge where its slope, of depth over width, changes by more than this from pixel to pixel.
constexpr float CREASE = 1.0f;
// Colours that differ by so much or less are about the same [levels of 255], at an edge of a shape and within one. Of a
// pixel's mean a sample is a quarter.
constexpr int FAINT = 8, FAINT_WITHIN = 24, FAINT_SIDES = 32;
// Of the pixels that may show a sample's surface one whose plane lies apart from it by so many pixels' widths in depth
// is as bad as one that lies a pixel's width aside.
constexpr float STEEP = 1.0f;
// One whose surface is turned by a right angle is as bad as one that lies so many pixels' widths aside, squared.
constexpr float TURNED = 2.0f;
// How far beyond the depths around a sample is followed: parts of their range, and pixels' widths.
constexpr float BEYOND = 2.5f, ASIDE = 4.0f;
constexpr int SAMPLES = 4;  // of a pixel
constexpr unsigned EVERY_SAMPLE = (1u << SAMPLES) - 1;
// Images: bits in the order of antialias.py.
constexpr int SMOOTH_RGB = 1, SMOOTH_RGBA = 2, SMOOTH_HDR = 4;

struct Offset {
    float right, down;  // from the pixel's centre [pixels]
};

struct Place {
    int right, down;  // of a pixel [pixels]
};

// Where OpenGL's implementations have a pixel's samples (antialias.py has the same numbers).
WARPCAM_FN Offset sample_offset(int sample)
{
    const bool upright = sample == 0 || sample == 3;
    const float sign = sample < 2 ? 1.0f : -1.0f;
    return { sign * (upright ? -0.125f : 0.375f), sign * (upright ? 0.375f : 0.125f) };
}

// Depths between which a sample's hit is looked for, on shapes that take long: about those that the pixels around have.
struct Band {
    float first, last;  // the first is greater where there are none

    WARPCAM_FN void include(float depth)
    {
        first = lower(first, depth);
        last = upper(last, depth);
    }

    // With room for slopes that grow beyond the pixels' centres; `width` is that of a pixel at a depth of 1 m.
    template <int LENS> WARPCAM_FN Band widened(float width) const
    {
        const float margin = BEYOND * (last - first) + ASIDE * width * (LENS != ORTHOGRAPHIC ? last : 1.0f);
        return { first - margin, last + margin };
    }
};

constexpr Band NOWHERE { FAR_AWAY, -FAR_AWAY };

// What a view has found in the centres of its pixels.
template <int LENS, class Target> struct Seen {
    const Target& target;
    unsigned first;  // the view's first pixel
    float scale_x, scale_y;  // width and height of a pixel, at a depth of 1 m or everywhere [m]

    WARPCAM_FN unsigned at(int i, int j) const { return first + unsigned(j * target.width + i); }
    WARPCAM_FN bool inside(int i, int j) const { return i >= 0 && i < target.width && j >= 0 && j < target.height; }
    WARPCAM_FN int shape(unsigned pixel) const { return target.shape.data[pixel]; }
    WARPCAM_FN float depth(unsigned pixel) const { return target.depth.data[pixel]; }

    // The nearest pixel of the image.
    WARPCAM_FN unsigned near(int i, int j) const
    {
        return at(i < 0 ? 0 : lower_int(i, target.width - 1), j < 0 ? 0 : lower_int(j, target.height - 1));
    }

    // The same for one of the nine pixels around, row after row.
    WARPCAM_FN unsigned around(int i, int j, int k) const { return near(i + k % 3 - 1, j + k / 3 - 1); }

    // Are three pixels in a row not on one plane? Of a plane 1 / depth is linear in a pinhole's image.
    WARPCAM_FN bool turns(unsigned before, unsigned here, unsigned after, float scale) const
    {
        const float a = depth(before), b = depth(here), c = depth(after);
        if (LENS != ORTHOGRAPHIC)
            return magnitude(b * (a + c) - 2.0f * a * c) > CREASE * scale * (a * c);
        return magnitude(a + c - 2.0f * b) > CREASE * scale;
    }

    // Do the colours of two pixels differ by more levels, in any channel?
    template <int IMAGES> WARPCAM_FN bool differ(unsigned one, unsigned other, int levels) const
    {
        constexpr int CHANNELS = IMAGES & SMOOTH_RGBA ? 4 : 3;  // the first three are the same in both
        bool found = false;
        if (IMAGES & SMOOTH_HDR)
            for (int k = 0; k < 3; ++k)
                found |= magnitude(target.hdr.data[3 * size_t(one) + k] - target.hdr.data[3 * size_t(other) + k])
                    > float(levels) * (1.0f / 255.0f);
        if (IMAGES & (SMOOTH_RGB | SMOOTH_RGBA)) {
            const unsigned char* image = IMAGES & SMOOTH_RGBA ? target.rgba.data : target.rgb.data;
            for (int k = 0; k < CHANNELS; ++k) {
                const int rise = int(image[CHANNELS * size_t(other) + k]) - int(image[CHANNELS * size_t(one) + k]);
                found |= rise > levels || -rise > levels;
            }
        }
        return found;
    }

    // Which of the pixel's samples may hit what its centre does not, by bit. A pixel has an edge if one of its four
    // neighbours is another shape: then those that have another shape at a corner of the triangle that they lie in, of
    // the pixel's centre, that of a neighbour and that of one across, for three pixels that show the same shape have no
    // edge between them. Or if its surface is bent: then all. In both cases it must show: where the three other pixels
    // that a sample lies among have about the colour of its own, nothing is traced. Beside another shape, where bends are not
    // looked for, colours alone tell them, of shapes of which has_sides(id) says that they have any.
    template <int IMAGES, class HasSides>
    WARPCAM_FN unsigned edge(int i, int j, const HasSides& has_sides) const
    {
        const unsigned pixel = at(i, j), line = unsigned(target.width);
        const bool has_left = i > 0, has_right = i + 1 < target.width;
        const bool has_up = j > 0, has_down = j + 1 < target.height;
        const unsigned left = has_left ? pixel - 1 : pixel, right = has_right ? pixel + 1 : pixel;
        const unsigned up = has_up ? pixel - line : pixel, down = has_down ? pixel + line : pixel;
        const int here = shape(pixel), west = has_left ? -1 : 0, east = has_right ? 1 : 0;
        const bool at_left = shape(left) != here, at_right = shape(right) != here;
        const bool at_up = shape(up) != here, at_down = shape(down) != here;
        const bool within = !(at_left | at_right | at_up | at_down);
        unsigned samples = 0;
        if (!within) {
            const bool down_left = shape(down + west) != here, down_right = shape(down + east) != here;
            const bool up_left = shape(up + west) != here, up_right = shape(up + east) != here;
            samples = unsigned(at_down | down_left) | unsigned(at_right | down_right) << 1
                | unsigned(at_left | up_left) << 2 | unsigned(at_up | up_right) << 3;
        } else if (here >= 0
                   && ((has_left && has_right && turns(left, pixel, right, scale_x))
                       || (has_up && has_down && turns(up, pixel, down, scale_y)))) {
            samples = EVERY_SAMPLE;
        }
        if (samples) {
            const int levels = within ? FAINT_WITHIN : FAINT;
            const auto differs = [&](unsigned other) { return differ<IMAGES>(pixel, other, levels); };
            const auto keep = [&](int sample, unsigned beside, unsigned across, unsigned other) {
                if ((samples >> sample & 1) && !(differs(beside) || differs(across) || differs(other)))
                    samples &= ~(1u << sample);
            };
            keep(0, down, down + west, left);
            keep(1, right, down + east, down);
            keep(2, left, up + west, up);
            keep(3, up, up + east, right);
        }
        if (!within && has_sides(here)) {  // of which two may meet in the triangle
            const auto add = [&](int sample, unsigned beside, unsigned across) {
                if (!(samples >> sample & 1) && shape(beside) == here && shape(across) == here
                    && (differ<IMAGES>(pixel, beside, FAINT_SIDES) || differ<IMAGES>(pixel, across, FAINT_SIDES)))
                    samples |= 1u << sample;
            };
            add(0, down, down + west);
            add(1, right, down + east);
            add(2, left, up + west);
            add(3, up, up + east);
        }
        return samples;
    }

    // What is linear in the image of a plane.
    WARPCAM_FN float level(float depth) const { return LENS != ORTHOGRAPHIC ? reciprocal(depth) : depth; }

    // How much the level of a pixel's surface rises towards a hit, from this pixel to the next, which is at `toward`: as
    // the pixel on the side away tells, or else that one; 0 if both show other shapes. All is loaded at once: tests on
    // the way would cost more.
    WARPCAM_FN float rise(unsigned pixel, float here, bool has_away, unsigned away, bool has_toward, unsigned toward,
                          int hit_shape) const
    {
        away = has_away ? away : pixel;
        toward = has_toward ? toward : pixel;
        const bool on_away = has_away & (shape(away) == hit_shape);
        const bool on_toward = has_toward & (shape(toward) == hit_shape);
        const float far = depth(away), close = depth(toward), other = level(on_away ? far : close);
        return on_away ? here - other : on_toward ? other - here : 0.0f;
    }

    // How far a hit lies from the plane of a pixel's surface, in pixels' widths. The pixels on the side away from the
    // hit, which is (x, y) pixels before the centre, tell the plane, or those on its side where these show other shapes.
    WARPCAM_FN float off_plane(int i, int j, float x, float y, float hit_depth, int hit_shape) const
    {
        const unsigned pixel = at(i, j);
        const float here = level(depth(pixel));
        const int right = x > 0.0f ? 1 : -1, down = y > 0.0f ? 1 : -1;
        const float found = here
            + magnitude(x) * rise(pixel, here, inside(i + right, j), at(i + right, j), inside(i - right, j), at(i - right, j),
                                  hit_shape)
            + magnitude(y) * rise(pixel, here, inside(i, j + down), at(i, j + down), inside(i, j - down), at(i, j - down),
                                  hit_shape);
        const float apart = magnitude(found - level(hit_depth));
        return (LENS != ORTHOGRAPHIC ? apart * hit_depth : apart) * reciprocal(STEEP * scale_x);
    }

    // Which of the nine pixels around shows what a sample of pixel (i, j) has hit: the nearest, by place, by depth and by
    // turned(i, j, pixel), how far its surface turns from the one hit, if they differ in colour. It is the pixel itself if none
    // does.
    template <int IMAGES, class Turned>
    WARPCAM_FN unsigned shown(int i, int j, Offset offset, float hit_depth, int hit_shape, const Turned& turned) const
    {
        // The nine from near to far, 1 being the pixel's own line and 2 that on the sample's side: bits by twos for the
        // direction in which the sample is farther from the centre, and for the other.
        constexpr unsigned FARTHER = 0x999, OTHER = 0x90a5;
        const bool upright = magnitude(offset.down) > magnitude(offset.right);
        const int x = offset.right > 0.0f ? 1 : -1, y = offset.down > 0.0f ? 1 : -1;
        const auto aside = [&](int k) {
            const int farther = int(FARTHER >> 2 * k & 3) - 1, other = int(OTHER >> 2 * k & 3) - 1;
            return Place { x * (upright ? other : farther), y * (upright ? farther : other) };
        };
        unsigned left = 0;  // those that show the shape, by number
#pragma unroll
        for (int k = 0; k < 9; ++k) {
            const Place at_k = aside(k);
            const bool there = inside(i + at_k.right, j + at_k.down);
            left |= unsigned(there & (shape(there ? at(i + at_k.right, j + at_k.down) : at(i, j)) == hit_shape)) << k;
        }
        const auto cost_of = [&](const Place& at_k) {
            const float right = float(at_k.right) - offset.right, down = float(at_k.down) - offset.down;
            float cost = right * right + down * down;
            if (hit_shape >= 0)
                cost += off_plane(i + at_k.right, j + at_k.down, right, down, hit_depth, hit_shape)
                    + turned(i + at_k.right, j + at_k.down, at(i + at_k.right, j + at_k.down));
            return cost;
        };
        if (!left)
            return at(i, j);
        Place best_at = aside(lowest_bit(left));
        unsigned chosen = at(i + best_at.right, j + best_at.down);
        float best = FAR_AWAY;  // not known before some other pixel has another colour
        for (left &= left - 1; left; left &= left - 1) {
            const Place at_k = aside(lowest_bit(left));
            const float right = float(at_k.right) - offset.right, down = float(at_k.down) - offset.down;
            const unsigned pixel = at(i + at_k.right, j + at_k.down);
            if (!differ<IMAGES>(chosen, pixel, FAINT))
                continue;
            if (best == FAR_AWAY)
                best = cost_of(best_at);
            if (right * right + down * down >= best)
                break;
            const float cost = cost_of(at_k);
            if (cost < best) {
                best = cost;
                chosen = pixel;
            }
        }
        return chosen;
    }
};

}  // namespace warpcam
