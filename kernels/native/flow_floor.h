// Which parts of a block's image see of its floor only what was seen in the last image. Of most images the floor is the
// largest part, and it was hidden in few places nearby: of 64 pixels at once one projection and two looks at rows of bits
// tell as much as 128 looks at words.
#pragma once
#include "hits.h"
#include "prepare.h"

namespace warpcam {

// Words of 16 bits in a row of what is near: those of 64 pixels, and eight, so that the rows of a tile lie in different
// banks. The bits of ROW_START times the bytes of a row and those of COLUMN_START times the bytes of a word add up to a
// multiple of 2^32: the bits of a row and a column above these lead to a word with nothing taken off.
constexpr int NEAR_ROW = 72;
constexpr unsigned NEAR_BYTES = 2 * NEAR_ROW, TO_WRAP = -((NEAR_BYTES + 2) * 0x4b000000u);
constexpr float ROW_START = 8388608.0f + TO_WRAP / NEAR_BYTES, COLUMN_START = 8388608.0f + TO_WRAP % NEAR_BYTES / 2;

// What is at an image's pixel (0, 0), and how much more of it at the next to the right and below.
struct alignas(16) Slope {
    float start, right, down;

    WARPCAM_FN float at(float i, float j) const { return muladd(down, j, muladd(right, i, start)); }
};

// Of an image of 64x64 pixels, in parts of 8x8.
struct FlowFloor {
    static constexpr int SIZE = 64, PART = 8, PARTS = SIZE * SIZE / (PART * PART);
    static constexpr int NONE = 255, OUTSIDE = 256;  // no shape has that id where words are brief

    unsigned long long rows[SIZE];  // of each row a bit a pixel that showed the floor; then of eight rows that all did
    // The floor's id where the last image showed nothing else where a part shows it, with OUTSIDE as far as that was inside
    // of it; or NONE.
    int seen[PARTS];
    Slope across, along, away;  // where the floor was, in homogeneous pixels

    WARPCAM_FN static unsigned part_of(unsigned i, unsigned j) { return j / PART * (SIZE / PART) + i / PART; }
    // What all of a pixel's words is, of the floor: no depths tell its parts apart.
    WARPCAM_FN static unsigned word(int shape) { return unsigned(shape) << 8; }
};

// Room for that, if it is wanted.
struct NoFloor { };
template <bool WANTED> struct FloorOf {
    using type = FlowFloor;
};
template <> struct FloorOf<false> {
    using type = NoFloor;
};

#if defined(__CUDA_ARCH__)

// Four bits: which of four words of 16 bits show a shape.
WARPCAM_FN unsigned showing(unsigned two, unsigned more, unsigned fours)
{
    const unsigned other = __byte_perm(two, more, 0x7531) ^ fours;
    const unsigned none = ~(((other & 0x7f7f7f7fu) + 0x7f7f7f7fu) | other) & 0x80808080u;
    return none * 0x00204081u >> 28;
}

// The first plane of a scene of at most as many shapes as a warp has lanes, for a warp.
template <class Shapes> WARPCAM_FN int floor_of(const Shapes& shapes, int count)
{
    const int lane = threadIdx.x % LANES;
    const unsigned planes = __ballot_sync(ALL, lane < count && wp::index(shapes.types, lane) == PLANE
                                                   && wp::index(shapes.places, lane) >= 0);
    return planes ? lowest_bit(planes) : FlowFloor::NONE;
}

// What of a row of the last image showed the floor, for a thread that has fetched its words. All of the new image's words,
// and whether its pixels were seen, are made to be as the floor's that was: then nothing is to be written where this is so.
template <class Places> WARPCAM_FN void find_floor(Places& places, unsigned char* valid, int row, int shape)
{
    FlowFloor& floor = places.floor;
    const unsigned fours = unsigned(shape) * 0x01010101u;
    unsigned halves[2] = { 0, 0 };
    for (int k = 0; k < FlowFloor::SIZE / 8; ++k) {
        const uint4 words = *reinterpret_cast<const uint4*>(places.near_words + NEAR_ROW * row + 8 * k);
        const unsigned eight = showing(words.x, words.y, fours) | showing(words.z, words.w, fours) << 4;
        halves[k / 4] |= eight << 8 * (k % 4);
    }
    floor.rows[row] = static_cast<unsigned long long>(halves[1]) << 32 | halves[0];
    constexpr unsigned ONES = 0x01010101u;
    const unsigned word = FlowFloor::word(shape) * 0x00010001u;
    for (int k = 0; k < 8; ++k)
        reinterpret_cast<uint4*>(places.kept)[FlowFloor::SIZE * k + row] = make_uint4(word, word, word, word);
    for (int k = 0; k < 4; ++k)
        reinterpret_cast<uint4*>(valid)[FlowFloor::SIZE * k + row] = make_uint4(ONES, ONES, ONES, ONES);
}

// For a warp, once it has composed the motions.
template <bool VALID, class Places, class Shapes>
WARPCAM_FN void find_seen_floor(Places& places, const Shapes& shapes, const Camera& camera, int world, int shape)
{
    FlowFloor& floor = places.floor;
    const int lane = threadIdx.x % LANES;
    floor.seen[lane] = floor.seen[lane + LANES] = FlowFloor::NONE;
    if (shape == FlowFloor::NONE)
        return;
    const auto rows = places.of_shape(shape);
    const Row last = rows.at(3);
    if (Places::Keeps::rests(last))
        return;
    if constexpr (VALID) {
        // Of eight rows, those of a lane and those 32 further down.
        unsigned long long upper_rows = floor.rows[lane], lower_rows = floor.rows[lane + LANES];
        for (int step = 1; step < FlowFloor::PART; step *= 2) {
            const unsigned long long one = __shfl_sync(ALL, upper_rows, lane + step), other = __shfl_sync(ALL, lower_rows, lane + step);
            const bool further = lane + step >= LANES;
            upper_rows &= further ? other : one;
            lower_rows &= further ? 0ull : other;
        }
        __syncwarp();
        floor.rows[lane] = upper_rows;
        floor.rows[lane + LANES] = lower_rows;
    }
    // One by the depth that the floor has now at a pixel, and its place and depth then times that.
    const auto r = wp::index(shapes.rotations, world, shape);
    const Vec normal = turned_back(camera.rotation, { r.data[0][2], r.data[1][2], r.data[2][2] });
    const Vec away = turned_back(camera.rotation, to_vec(wp::index(shapes.positions, world, shape)) - camera.origin);
    const float rate = 1.0f / dot(normal, away);
    Slope near { 0.0f, rate * normal.x * camera.scale_x, -rate * normal.y * camera.scale_y };
    near.start = near.right * (0.5f - camera.center_x) + near.down * (0.5f - camera.center_y) - rate * normal.z;
    const auto slope = [&](const Row& row) {
        const float w = as_float(row.w);
        return Slope { row.z + w * near.start, row.x + w * near.right, row.y + w * near.down };
    };
    const Slope x = slope(rows.at(0)), y = slope(rows.at(1)), depth = slope(rows.at(2));
    if (lane == 0) {
        floor.across = x;
        floor.along = y;
        floor.away = depth;
    }
    __syncwarp();
    const float least = 0.02f * (magnitude(near.start) + FlowFloor::SIZE * (magnitude(near.right) + magnitude(near.down)));
    constexpr float SLACK = 0.0625f, END = FlowFloor::SIZE;
#pragma unroll 1
    for (int part = lane; part < FlowFloor::PARTS; part += LANES) {
        float left = FAR_AWAY, right = -FAR_AWAY, top = FAR_AWAY, bottom = -FAR_AWAY;
        bool seen = true, inside = true;
        for (int corner = 0; corner < 4; ++corner) {
            const float i = float(part % 8 * FlowFloor::PART + (corner & 1 ? FlowFloor::PART - 1 : 0));
            const float j = float(part / 8 * FlowFloor::PART + (corner & 2 ? FlowFloor::PART - 1 : 0));
            const float far = near.at(i, j), by = depth.at(i, j), scale = reciprocal(by);
            seen = seen & (far > least) & (by > last.z * far) & (by > 0.0f);
            const float across = x.at(i, j) * scale, along = y.at(i, j) * scale;
            left = lower(left, across);
            right = upper(right, across);
            top = lower(top, along);
            bottom = upper(bottom, along);
        }
        if constexpr (VALID) {
            left += 0.25f - SLACK, top += 0.25f - SLACK, right += 0.75f + SLACK, bottom += 0.75f + SLACK;
            inside = (left >= 0.0f) & (top >= 0.0f) & (right < END) & (bottom < END);
            const int first = int(upper(left, 0.0f)), above = int(upper(top, 0.0f));
            const int end = int(lower(right, END - 1.0f)), below = int(lower(bottom, END - 1.0f));
            seen = seen & (right > -END) & (bottom > -END) & (left < 2.0f * END) & (top < 2.0f * END);
            if (seen && first <= end && above <= below) {
                const unsigned long long columns = ~0ull >> (FlowFloor::SIZE - 1 - (end - first)) << first;
                const int begin = lower_int(above, FlowFloor::SIZE - FlowFloor::PART), other = upper_int(below - (FlowFloor::PART - 1), 0);
                seen = below - above < 2 * FlowFloor::PART && (columns & ~(floor.rows[begin] & floor.rows[other])) == 0ull;
            }
        }
        if (seen)
            floor.seen[part] = inside ? shape : shape | FlowFloor::OUTSIDE;
    }
}

#endif

}  // namespace warpcam
