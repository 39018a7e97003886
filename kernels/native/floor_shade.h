// Which parts of a floor the casters of a light may shade, by the numbers of pixels alone.
#pragma once
#include "casters.h"

namespace warpcam {

// A plane by its unit normal, in the world's axes, and how far along that it is from the camera.
struct Floor {
    Vec normal;
    float away;
    int shape;  // id, or -1
};

#if defined(__CUDA_ARCH__)

template <class Shapes> WARPCAM_FN Floor load_floor(const Shapes& shapes, const Camera& camera, int world, int id)
{
    if (id < 0)
        return { { 0.0f, 0.0f, 1.0f }, 0.0f, -1 };
    const Shape shape = load_shape(shapes, world, id);
    const Matrix& r = shape.rotation;
    const Vec normal { r.at[0][2], r.at[1][2], r.at[2][2] };
    return { normal, dot(normal, { shape.position.x - camera.origin.x, shape.position.y - camera.origin.y,
                                   shape.position.z - camera.origin.z }), id };
}

// Four neighbours as they are loaded, in as many words as one has bytes.
template <class Value> WARPCAM_FN Several<unsigned, sizeof(Value)> four_at(const Value* from)
{
    return several<sizeof(Value)>(reinterpret_cast<const unsigned*>(from));
}

// Whether all four are the same number.
template <int BYTES> WARPCAM_FN bool all_are(const Several<unsigned, BYTES>& words, int number)
{
    const unsigned wanted = BYTES == 1 ? (unsigned(number) & 0xffu) * 0x01010101u
        : BYTES == 2 ? (unsigned(number) & 0xffffu) * 0x00010001u : unsigned(number);
    bool all = true;
#pragma unroll
    for (int k = 0; k < BYTES; ++k)
        all &= words.at[k] == wanted;
    return all;
}

// Strips of 32x4 pixels that a warp looks through, four bits each of which the lowest counts.
constexpr unsigned EACH_STRIP = 0x11111111u;

// By how much a pixel of the plane lies on one side of a straight line in the image, times something positive: changes from
// column to column and from row to row, and of the pixel of a strip that lies farthest on that side, for the strip at the
// image's first pixel.
struct ImageSide {
    float across, down, start;

    // Half a pixel more on each side than the strip has, which is more than all rounding.
    WARPCAM_FN static ImageSide of(Vec in)
    {
        return { in.x, in.y, in.z + 15.5f * in.x + 16.0f * magnitude(in.x) + 1.5f * in.y + 2.0f * magnitude(in.y) };
    }

    // Whether all of the strip that begins at column i and row j lies on the other one.
    WARPCAM_FN bool beyond(float i, float j) const { return start + i * across + j * down < 0.0f; }
};

// Where a light sees what a pixel shows of a plane: u / whole and v / whole, of which each is linear in columns and rows.
struct FloorPlaces {
    Vec u, v, whole;
    bool known;  // else all of that means nothing

    WARPCAM_FN ImageSide left(float edge) const { return ImageSide::of(u - edge * whole); }
    WARPCAM_FN ImageSide right(float edge) const { return ImageSide::of(edge * whole - u); }
    WARPCAM_FN ImageSide bottom(float edge) const { return ImageSide::of(v - edge * whole); }
    WARPCAM_FN ImageSide top(float edge) const { return ImageSide::of(edge * whole - v); }
};

template <class View>
WARPCAM_FN FloorPlaces floor_places(const View& view, const Floor& floor, const Region& region, int lane)
{
    const float side = floor.away < 0.0f ? -1.0f : 1.0f, away = side * floor.away;
    const auto& ray = view.sight;
    const auto& lit = view.lit;
    // A ray's way to the plane is `away` over this; all is multiplied by it, as it is not negative where the plane is seen.
    const Vec rate { side * dot(floor.normal, ray.across), side * dot(floor.normal, ray.down),
                     side * dot(floor.normal, ray.start) };
    const auto place = [&](float across, float down, float start, float along) {
        return Vec { away * across + along * rate.x, away * down + along * rate.y, away * start + along * rate.z };
    };
    FloorPlaces places { place(lit.across.x, lit.down.x, lit.start.x, lit.along.x),
                         place(lit.across.y, lit.down.y, lit.start.y, lit.along.y), rate, floor.shape >= 0 };
    if (!view.light.distant) {
        places.whole = place(lit.across.z, lit.down.z, lit.start.z, lit.along.z);
        // All of the region's plane must lie clearly before the light.
        const float i = float(lane & 1 ? region.left + region.width : region.left - 1);
        const float j = float(lane & 2 ? region.top + region.height : region.top - 1);
        const auto value = [&](const Vec& of) { return of.z + i * of.x + j * of.y; };
        const bool before = value(places.whole) > 1.0e-3f * (magnitude(value(places.u)) + magnitude(value(places.v)));
        places.known = __all_sync(ALL, places.known & before);
    }
    return places;
}

// Which of a warp's eight strips of a plane, `floors`, no caster of a list shades. `corner(strip)` is where one begins: column
// and row, as a Pair.
template <class List, class Corner>
WARPCAM_FN unsigned not_shaded(const List& list, const FloorPlaces& places, unsigned floors, int lane, const Corner& corner)
{
    if (!places.known || !floors)
        return 0;
    // Four lanes a strip look at one side each of what all casters cover together.
    const Window all = list.bounds;
    const ImageSide side = lane & 2 ? (lane & 1 ? places.top(all.top) : places.bottom(all.bottom))
                               : (lane & 1 ? places.right(all.right) : places.left(all.left));
    const Pair own = corner(lane / 4);
    unsigned missed = __ballot_sync(ALL, side.beyond(own.x, own.y));
    missed |= missed >> 1;
    missed = (missed | missed >> 2) & floors;
    if constexpr (List::WORDS == 1) {  // of the others each lane looks at a caster
        const Window window = list.windows[lane];
        const ImageSide sides[4] = { places.left(window.left), places.right(window.right), places.bottom(window.bottom),
                                places.top(window.top) };
        for (unsigned left = floors & ~missed; left; left &= left - 1) {
            const int bit = lowest_bit(left);
            const Pair at = corner(bit / 4);
            bool beyond = lane >= list.count;
#pragma unroll
            for (int n = 0; n < 4; ++n)
                beyond |= sides[n].beyond(at.x, at.y);
            missed |= __all_sync(ALL, beyond) ? 1u << bit : 0u;
        }
    }
    return missed;
}

#endif

}  // namespace warpcam
