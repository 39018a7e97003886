// Finds the parts of a block's region whose ground plane was visible in the previous image. The plane covers most of
// many images and was hidden in few places nearby: for 64 pixels at once a projection of four corners and two reads of
// bit rows decide what 128 reads of words would, with the same result for each pixel.
#pragma once
#include "output/hit_attributes.h"
#include "camera/shape_setup.h"

namespace warpcam {

// Words of 16 bits in a row of what is near: those of 64 pixels, and eight, so that the rows of a tile lie in different
// banks. The bits of ROW_START times the bytes of a row and those of COLUMN_START times the bytes of a word add up to a
// multiple of 2^32: the bits of a row and a column above these lead to a word with nothing taken off.
constexpr int NEAR_ROW = 72;
constexpr unsigned NEAR_BYTES = 2 * NEAR_ROW, TO_WRAP = -((NEAR_BYTES + 2) * 0x4b000000u);
constexpr float ROW_START = 8388608.0f + TO_WRAP / NEAR_BYTES, COLUMN_START = 8388608.0f + TO_WRAP % NEAR_BYTES / 2;

// Linear function over the image: value at pixel (0, 0), and change to the next pixel to the right and below.
struct Slope {
    float start, right, down;

    WARPCAM_DEVICE float at(float i, float j) const { return fma(down, j, fma(right, i, start)); }
};

// Plane history of a region of 64x64 pixels, in parts of 8x8.
struct FlowFloor {
    static constexpr int SIZE = 64, PART = 8, PARTS = SIZE * SIZE / (PART * PART);
    static constexpr int NONE = 255, OUTSIDE = 256;  // no shape has that id where words are short

    // A byte a part: 1 where it shows nothing but the floor. Of all that was seen, of what is seen in the same order,
    // and of the region's. Of images of one region that is known by constants, the words of such parts are not kept.
    const unsigned char* parts_then;
    unsigned char* parts_now;
    unsigned char* region_parts;
    unsigned long long rows[SIZE];  // of each row a bit a pixel that showed the floor
    int shape;  // or NONE
    bool moves;  // it is known to have moved in the image: parts are looked at
    float nearest;  // as the fourth of its rows has it
    Slope near, x, y, depth;  // one by its depth now, and its place and depth then times that
    // The floor's id where the last image showed nothing else where a part shows it, with OUTSIDE as far as that was
    // inside of it; or NONE.
    int seen[PARTS];

    // The part of a region, and of an image, that has a pixel; images have theirs region after region.
    WARPCAM_DEVICE static unsigned part_of(unsigned i, unsigned j)
    {
        constexpr unsigned ACROSS = SIZE / PART;
        return j / PART % ACROSS * ACROSS + i / PART % ACROSS;
    }
    WARPCAM_DEVICE static unsigned part_in(int width, unsigned i, unsigned j)
    {
        return (j / SIZE * (unsigned(width + SIZE - 1) / SIZE) + i / SIZE) * PARTS + part_of(i, j);
    }
    WARPCAM_DEVICE static unsigned parts_of(int width, int height)
    {
        return unsigned(width + SIZE - 1) / SIZE * (unsigned(height + SIZE - 1) / SIZE) * PARTS;
    }
    // True if the previous image showed nothing but the plane in these columns and rows, at most 16 of each. For images
    // of a single region each of two threads tests every second row.
    template <bool WHOLE> WARPCAM_DEVICE bool showed(int width, int first, int end, int above, int below, int odd) const
    {
        bool all = true;
        if constexpr (WHOLE) {
            const unsigned long long columns = ~0ull >> (SIZE - 1 - (end - first)) << first;
            for (int j = above + odd; j <= below; j += 2)
                all &= (columns & ~rows[j]) == 0ull;
        } else {
            for (int j = above & ~(PART - 1); j <= below; j += PART)
                for (int i = first & ~(PART - 1); i <= end; i += PART)
                    all &= parts_then[part_in(width, i, j)] != 0;
        }
        return all;
    }

    // Word stored for a pixel that shows the plane: no depths tell its parts apart.
    WARPCAM_DEVICE static unsigned word(int shape) { return unsigned(shape) << 8; }
};

// Room for that, if it is wanted.
struct NoFloor {};
template <bool WANTED> struct FloorOf {
    using type = FlowFloor;
};
template <> struct FloorOf<false> {
    using type = NoFloor;
};

#if defined(__CUDA_ARCH__)

// Four bits: which of four words of 16 bits show a shape.
WARPCAM_DEVICE unsigned showing(unsigned two, unsigned more, unsigned fours)
{
    const unsigned other = __byte_perm(two, more, 0x7531) ^ fours;
    const unsigned none = ~(((other & 0x7f7f7f7fu) + 0x7f7f7f7fu) | other) & 0x80808080u;
    return none * 0x00204081u >> 28;
}

// The first plane of a scene of at most as many shapes as a warp has lanes, for a warp.
template <class Shapes> WARPCAM_DEVICE int floor_of(const Shapes& shapes, int count)
{
    const int lane = threadIdx.x % WARP_SIZE;
    const unsigned planes = __ballot_sync(FULL_WARP, lane < count && wp::index(shapes.types, lane) == PLANE
                                                         && wp::index(shapes.places, lane) >= 0);
    return planes ? ctz(planes) : FlowFloor::NONE;
}

// Finds the pixels of a row of the previous image that showed the plane, for a thread that has fetched the row's words.
template <class Places> WARPCAM_DEVICE void find_row(Places& places, int row, int shape)
{
    const unsigned fours = unsigned(shape) * 0x01010101u;
    unsigned halves[2] = { 0, 0 };
    for (int k = 0; k < FlowFloor::SIZE / 8; ++k) {
        const uint4 words = *reinterpret_cast<const uint4*>(places.near_words + NEAR_ROW * row + 8 * k);
        const unsigned eight = showing(words.x, words.y, fours) | showing(words.z, words.w, fours) << 4;
        halves[k / 4] |= eight << 8 * (k % 4);
    }
    places.floor.rows[row] = static_cast<unsigned long long>(halves[1]) << 32 | halves[0];
}

// For a thread for each part of the region.
template <class Places, class History>
WARPCAM_DEVICE void begin_floor(Places& places, const History& history, const Region& region, int part, int shape)
{
    FlowFloor& floor = places.floor;
    floor.seen[part] = FlowFloor::NONE;
    if (part == 0)
        floor.shape = shape;
    unsigned char* parts = floor.parts_now + FlowFloor::part_in(history.width, region.left, region.top);
    parts[part] = 1;
    if (part == 0)
        floor.region_parts = parts;
}

// For a thread: how the floor has moved, by its rows.
template <class Places, class Rows, class Shapes>
WARPCAM_DEVICE void find_slopes(Places& places, const Rows& rows, const Shapes& shapes, const Camera& camera, int world,
                                int shape)
{
    FlowFloor& floor = places.floor;
    floor.moves = false;
    if (shape == FlowFloor::NONE)
        return;
    const Float3Int last = rows.at(3), a = rows.at(0), b = rows.at(1), c = rows.at(2);
    const auto r = wp::index(shapes.rotations, world, shape);
    const Vec3 normal = transform_transposed(camera.rotation, { r.data[0][2], r.data[1][2], r.data[2][2] });
    const Vec3 away =
        transform_transposed(camera.rotation, as_vec3(wp::index(shapes.positions, world, shape)) - camera.origin);
    const float rate = 1.0f / dot(normal, away);
    Slope near { 0.0f, rate * normal.x * camera.scale_x, -rate * normal.y * camera.scale_y };
    near.start = near.right * (0.5f - camera.center_x) + near.down * (0.5f - camera.center_y) - rate * normal.z;
    const auto slope = [&](const Float3Int& row) {
        const float w = as_float(row.w);
        return Slope { row.z + w * near.start, row.x + w * near.right, row.y + w * near.down };
    };
    floor.near = near;
    floor.x = slope(a);
    floor.y = slope(b);
    floor.depth = slope(c);
    floor.nearest = last.z;
    floor.moves = !Places::Keeps::rests(last);
}

// For a warp or the block, when it has met after all of this: which parts see what was seen. Two threads have a part.
// Until a warp is done with it, the others look at words.
template <int WARP_OR_ONE, class Places>
WARPCAM_DEVICE void find_seen_floor(Places& places, const Region& region, int width, int height, int thread)
{
    static_assert(2 * FlowFloor::PARTS % WARP_OR_ONE == 0);
    FlowFloor& floor = places.floor;
    if (!floor.moves)
        return;
    const Slope near = floor.near, x = floor.x, y = floor.y, depth = floor.depth;
    const float span = float(width) * abs(near.right) + float(height) * abs(near.down);
    const float least = 1.0e-2f * (abs(near.start) + span);  // where it is farther rounding tells too much
    constexpr float SLACK = 0.0625f;  // pixels, more than all rounding
    const float last_i = float(width) - 1.0f, last_j = float(height) - 1.0f;
#pragma unroll 1
    for (int half = thread; half < 2 * FlowFloor::PARTS; half += WARP_OR_ONE) {
        const int part = half / 2;
        float left = MISS, right = -MISS, top = MISS, bottom = -MISS;
        bool seen = true;
        const float j = float(region.top + part / 8 * FlowFloor::PART + (thread & 1 ? FlowFloor::PART - 1 : 0));
        for (int corner = 0; corner < 2; ++corner) {
            const float i = float(region.left + part % 8 * FlowFloor::PART + (corner ? FlowFloor::PART - 1 : 0));
            const float far = near.at(i, j), by = depth.at(i, j), scale = rcp(by);
            seen = seen & (far > least) & (by > floor.nearest * far) & (by > 0.0f);
            const float across = x.at(i, j) * scale, along = y.at(i, j) * scale;
            left = min(left, across);
            right = max(right, across);
            top = min(top, along);
            bottom = max(bottom, along);
        }
        left = min(left, __shfl_xor_sync(FULL_WARP, left, 1));
        right = max(right, __shfl_xor_sync(FULL_WARP, right, 1));
        top = min(top, __shfl_xor_sync(FULL_WARP, top, 1));
        bottom = max(bottom, __shfl_xor_sync(FULL_WARP, bottom, 1));
        const unsigned both = __ballot_sync(FULL_WARP, seen) >> (thread % WARP_SIZE & ~1) & 3u;
        seen = both == 3u;
        left += 0.25f - SLACK, top += 0.25f - SLACK, right += 0.75f + SLACK, bottom += 0.75f + SLACK;
        const bool inside = (left >= 0.0f) & (top >= 0.0f) & (right < last_i + 1.0f) & (bottom < last_j + 1.0f);
        seen = seen & (right > -MISS) & (bottom > -MISS) & (left < MISS) & (top < MISS);  // numbers
        const int first = int(min(max(left, 0.0f), last_i + 1.0f)), above = int(min(max(top, 0.0f), last_j + 1.0f));
        const int end = int(max(min(right, last_i), -1.0f)), below = int(max(min(bottom, last_j), -1.0f));
        if (seen && first <= end && above <= below)
            seen = below - above < 2 * FlowFloor::PART && end - first < 2 * FlowFloor::PART
                   && floor.showed<Places::WHOLE>(width, first, end, above, below, thread & 1);
        const bool other = __shfl_xor_sync(FULL_WARP, seen, 1);
        if (seen && other && !(thread & 1))
            *const_cast<volatile int*>(floor.seen + part) = inside ? floor.shape : floor.shape | FlowFloor::OUTSIDE;
    }
}

#endif

}  // namespace warpcam
