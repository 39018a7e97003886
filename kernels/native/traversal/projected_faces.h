// Faces of moving meshes that are small beside an image's pixels, on CUDA: each is projected into the region, and meets
// the rays of the pixels in the rectangle around it. Where as many faces as pixels are seen that takes a fraction of
// the tests that rays make on their way down a tree. What a ray meets is the same: see meet_face().
#pragma once
#include "traversal/cooperative_leaf_test.h"
#include "traversal/shape_list.h"

namespace warpcam {

constexpr int MOST_FACES_A_PIXEL = 10;  // of a region; of meshes with more each ray finds its way through their trees

// True if a trace that projects faces projects a mesh's. It reads nothing of its tree then, which may be an old one.
template <class Meshes>
WARPCAM_DEVICE bool projects_mesh(const ShapeRecord& record, const Meshes& meshes, const Region& region)
{
    return wp::index(meshes.num_faces, record.axis_z.w) <= MOST_FACES_A_PIXEL * region.width * region.height;
}

#if defined(__CUDA_ARCH__)

constexpr int PROJECTED_PIXELS = 64 * 32;  // of the largest region
constexpr int MANY_PIXELS = 12;  // in a face's rectangle, which the warp shares out

// A face as a region's pixels see it: columns and rows of those in the rectangle around it; empty if width is 0.
struct PixelBox {
    int left, top, width, height;
};

// What projects a mesh's points into a region's pixels, counted from its corner: rows that give column and row times
// depth, and depth, of a point from the camera on.
struct RegionProjection {
    Vec3 column, row, depth;
    float columns, rows, near;  // the region's last ones
    float reach_x, reach_y;  // pixels of one unit at depth 1 and to the corner, of which rounding is a share

    template <class Types>
    WARPCAM_DEVICE static RegionProjection of(const ShapeRecord& record, const Camera& camera, const Region& region)
    {
        const Vec3 a = as_vec3(record.axis_x), b = as_vec3(record.axis_y), c = as_vec3(record.axis_z);
        Vec3 across { a.x, b.x, c.x }, up { a.y, b.y, c.y }, back { a.z, b.z, c.z };  // rows to the camera's frame
        if constexpr (Types::has(PER_SHAPE_SCALE)) {
            const Vec3 first = cross(b, c), second = cross(c, a), third = cross(a, b);
            const float rate = rcp(dot(a, first));
            across = rate * Vec3 { first.x, second.x, third.x };
            up = rate * Vec3 { first.y, second.y, third.y };
            back = rate * Vec3 { first.z, second.z, third.z };
        }
        const float rate_x = rcp(camera.scale_x), from_x = camera.center_x - 0.5f - float(region.left);
        const float rate_y = -rcp(camera.scale_y), from_y = camera.center_y - 0.5f - float(region.top);
        return { rate_x * across - from_x * back, rate_y * up - from_y * back, { -back.x, -back.y, -back.z },
                 float(region.width - 1),         float(region.height - 1),    camera.near,
                 abs(rate_x) + abs(from_x),       abs(rate_y) + abs(from_y) };
    }

    // The pixels around a face that may show it.
    WARPCAM_DEVICE PixelBox around(const Float3Int& origin, const Float3Int (&corners)[3]) const
    {
        constexpr PixelBox NONE { 0, 0, 0, 0 };
        float c[3], r[3], d[3];  // column and row times depth
#pragma unroll
        for (int k = 0; k < 3; ++k) {
            const Vec3 from { corners[k].x - origin.x, corners[k].y - origin.y, corners[k].z - origin.z };
            c[k] = dot(column, from);
            r[k] = dot(row, from);
            d[k] = dot(depth, from);
        }
        const float nearest = min(min(d[0], d[1]), d[2]), farthest = max(max(d[0], d[1]), d[2]);
        if (!(farthest > near))
            return NONE;
        float left = 0.0f, right = columns, top = 0.0f, bottom = rows;
        if (nearest > 0.5f * near && nearest > 1.0e-3f * farthest) {
#pragma unroll
            for (int k = 0; k < 3; ++k) {
                const float rate = rcp(d[k]);
                c[k] *= rate;
                r[k] *= rate;
            }
            const float least_c = min(min(c[0], c[1]), c[2]), most_c = max(max(c[0], c[1]), c[2]);
            const float least_r = min(min(r[0], r[1]), r[2]), most_r = max(max(r[0], r[1]), r[2]);
            // more than rounding moves a point
            const float aside = 0.015625f + 8.0e-6f * (abs(least_c) + abs(most_c) + reach_x);
            const float below = 0.015625f + 8.0e-6f * (abs(least_r) + abs(most_r) + reach_y);
            left = max(left, ceil(least_c - aside));
            right = min(right, floor(most_c + aside));
            top = max(top, ceil(least_r - below));
            bottom = min(bottom, floor(most_r + below));
            if (!(left <= right && top <= bottom))
                return NONE;
        } else {  // it runs past the camera: it shows nowhere if all corners lie beyond one side of the region
            const float aside = (0.5f + 1.0e-4f * reach_x) * farthest, below = (0.5f + 1.0e-4f * reach_y) * farthest;
            bool beyond[4] = { true, true, true, true };
#pragma unroll
            for (int k = 0; k < 3; ++k) {
                beyond[0] &= c[k] < -aside;
                beyond[1] &= c[k] > columns * d[k] + aside;
                beyond[2] &= r[k] < -below;
                beyond[3] &= r[k] > rows * d[k] + below;
            }
            if (beyond[0] || beyond[1] || beyond[2] || beyond[3])
                return NONE;
        }
        return { int(left), int(top), int(right) - int(left) + 1, int(bottom) - int(top) + 1 };
    }
};

// Nearest hits of a region's rays on projected faces: of each pixel the depth, the mesh's rank and the face.
struct ProjectedFaces {
    static constexpr unsigned long long NONE = ~0ull;
    static constexpr int FACE_BITS = 24;

    unsigned long long hits[PROJECTED_PIXELS];  // by row * 64 + column
    unsigned waiting_faces[THREADS / WARP_SIZE][2 * WARP_SIZE];  // of each warp, with their pixels
    unsigned short waiting_pixels[THREADS / WARP_SIZE][2 * WARP_SIZE];
    unsigned ranks[4];  // bits of the meshes that are projected

    // Projects the faces of all listed meshes that are small enough; a block, between barriers. ray_of(place): a
    // pixel's ray.
    template <class Types, class List, class Meshes, class RayOf>
    WARPCAM_DEVICE void find(const List& list, const Meshes& meshes, const Camera& camera, const Region& region,
                             const RayOf& ray_of)
    {
        for (int place = threadIdx.x; place < 64 * region.height; place += THREADS)
            hits[place] = NONE;
        if (threadIdx.x < 4)
            ranks[threadIdx.x] = 0;
        block_sync();
        for (int rank = 0; rank < list.count; ++rank) {
            const ShapeRecord& record = list.at_rank(rank);
            if (!is_mesh<Types>(record) || !projects_mesh(record, meshes, region))
                continue;
            const int faces = wp::index(meshes.num_faces, record.axis_z.w);
            if (threadIdx.x == 0)
                ranks[rank / WARP_SIZE] |= 1u << rank % WARP_SIZE;
            project<Types>(record, rank, faces, meshes, RegionProjection::of<Types>(record, camera, region), ray_of);
        }
        block_sync();
    }

    // Tests a face against a pixel's ray.
    template <class Types, class Meshes, class RayOf>
    WARPCAM_DEVICE void test(const ShapeRecord& record, int rank, const Meshes& meshes, float near, const RayOf& ray_of,
                             unsigned face, int place)
    {
        const float t = meet_face<Types>(record, meshes, ray_of(place), int(face), near, MISS);
        if (t < MISS)
            atomicMin(&hits[place],
                      static_cast<unsigned long long>(unsigned(as_int(t))) << 32 | unsigned(rank) << FACE_BITS | face);
    }

    template <class Types, class Meshes, class RayOf>
    WARPCAM_DEVICE void project(const ShapeRecord& record, int rank, int faces, const Meshes& meshes,
                                const RegionProjection& projection, const RayOf& ray_of)
    {
        const int lane = threadIdx.x % WARP_SIZE, warp = threadIdx.x / WARP_SIZE;
        unsigned* const faces_here = waiting_faces[warp];
        unsigned short* const pixels_here = waiting_pixels[warp];
        const float near = projection.near;
        const auto rows = reinterpret_cast<const Float3Int*>(meshes.faces.data) + unsigned(as_int(record.size.z));
        int queued = 0;
        Float3Int corners[3] {};  // of the lane's next face, which are on their way while the last is looked at
        const auto fetch = [&](int face) {
            if (face < faces)
#pragma unroll
                for (int k = 0; k < 3; ++k)
                    corners[k] = load(rows, unsigned(face * FACE_ROWS + k));
        };
        fetch(warp * WARP_SIZE + lane);
        for (int first = warp * WARP_SIZE; first < faces; first += THREADS) {
            const int face = first + lane;
            PixelBox box { 0, 0, 0, 0 };
            if (face < faces)
                box = projection.around(record.origin, corners);
            fetch(face + THREADS);
            const int pixels = box.width * box.height;
            for (unsigned many = __ballot_sync(FULL_WARP, pixels > MANY_PIXELS); many; many &= many - 1) {
                const int from = ctz(many), left = __shfl_sync(FULL_WARP, box.left, from),
                          top = __shfl_sync(FULL_WARP, box.top, from), width = __shfl_sync(FULL_WARP, box.width, from),
                          count = width * __shfl_sync(FULL_WARP, box.height, from);
                for (int k = lane; k < count; k += WARP_SIZE)
                    test<Types>(record, rank, meshes, near, ray_of, unsigned(first + from),
                                (top + k / width) * 64 + left + k % width);
            }
            __syncwarp();
            int left = pixels > MANY_PIXELS ? 0 : pixels, column = 0, place = box.top * 64 + box.left;
            for (unsigned some = __ballot_sync(FULL_WARP, left > 0); some; some = __ballot_sync(FULL_WARP, left > 0)) {
                if (left > 0) {
                    const int at = queued + __popc(some & ((1u << lane) - 1));
                    faces_here[at] = unsigned(face);
                    pixels_here[at] = static_cast<unsigned short>(place);
                    --left;
                    const bool ends = ++column == box.width;
                    place += ends ? 65 - box.width : 1;
                    column = ends ? 0 : column;
                }
                queued += __popc(some);
                __syncwarp();
                if (queued >= WARP_SIZE) {
                    test<Types>(record, rank, meshes, near, ray_of, faces_here[lane], pixels_here[lane]);
                    queued -= WARP_SIZE;
                    const unsigned next_face = faces_here[lane + WARP_SIZE];
                    const unsigned short next_pixel = pixels_here[lane + WARP_SIZE];
                    __syncwarp();
                    faces_here[lane] = next_face;
                    pixels_here[lane] = next_pixel;
                    __syncwarp();
                }
            }
        }
        if (lane < queued)
            test<Types>(record, rank, meshes, near, ray_of, faces_here[lane], pixels_here[lane]);
        __syncwarp();
    }

    // Takes the hit at a place if it is nearer.
    template <class List> WARPCAM_DEVICE void take(const List& list, int place, Hit& hit) const
    {
        const unsigned long long key = hits[place];
        const float depth = as_float(int(key >> 32));
        if (key != NONE && depth < hit.depth) {
            const unsigned code = unsigned(key);
            hit = { depth, list.at_rank(int(code >> FACE_BITS)).axis_y.w, int(code & ((1u << FACE_BITS) - 1)) };
        }
    }
};

#endif

}  // namespace warpcam
