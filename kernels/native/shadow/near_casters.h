// The casters that may shade something in a region, in scenes most of whose shapes do not, on CUDA.
#pragma once
#include "shadow/receivers.h"

namespace warpcam {
#if defined(__CUDA_ARCH__)

// Places among the drawn shapes, from `start` on, of those whose spheres may be wanted. Spheres are asked for by rounds
// of the block, of which several go by without a barrier.
struct NearPlaces {
    static constexpr int ROUNDS = 4, ENOUGH = 512, CAPACITY = ENOUGH + ROUNDS * THREADS;
    static constexpr int REACH =
        0x10000 - ROUNDS * THREADS;  // after so many shapes their places take more than 16 bits

    unsigned short offset[CAPACITY];
    int start, count;
};

// True if the sphere around a shape's place that holds it is wanted as a caster. Asks for less than the shape itself,
// not for its rotation, and is true for all that are wanted.
template <class Types, class Wanted, class Meshes, class HeightFields>
WARPCAM_DEVICE bool may_be_wanted(const Shape& shape, const Wanted& wanted, const LightView& light,
                                  const Camera& camera, const Meshes& meshes, const HeightFields& fields)
{
    LocalBounds extent {};
    Vec3 scale;
    Caster caster;
    if (!shape_bounds<Types>(shape, meshes, fields, extent, scale, caster.record))
        return false;
    if (!(extent.half.x >= 0.0f))
        return true;  // an endless plane
    const Vec3 far { abs(extent.center.x) + extent.half.x, abs(extent.center.y) + extent.half.y,
                     abs(extent.center.z) + extent.half.z };
    const float radius = (1.0f + 1.0e-5f) * sqrt(dot(far, far));
    const Vec3 c { shape.position.x - camera.origin.x, shape.position.y - camera.origin.y,
                   shape.position.z - camera.origin.z };
    const Mat3 upright { { { 1.0f, 0.0f, 0.0f }, { 0.0f, 1.0f, 0.0f }, { 0.0f, 0.0f, 1.0f } } };
    caster.bounds_uv =
        bounds_uv_of(light, SPHERE, c, upright, { { 0.0f, 0.0f, 0.0f }, { radius, radius, radius } }, caster.height);
    return wanted.has(caster);
}

// Finds more of them, from shape `begin` on, until there are enough; returns where to go on. Called by a block.
template <class Types, class Wanted, class Shapes, class Meshes, class HeightFields>
WARPCAM_DEVICE int find_near(NearPlaces& places, int begin, const Wanted& wanted, const Shapes& shapes,
                             const Meshes& meshes, const HeightFields& fields, const LightView& light,
                             const Camera& camera, int world, int thread)
{
    const int total = shapes.drawn.shape[0], lane = thread % WARP_SIZE;
    if (thread == 0) {
        places.start = begin;
        places.count = 0;
    }
    block_sync();
    const int start = begin;
    bool enough = false;
    while (begin < total && !enough) {
        const int end = min(begin + NearPlaces::ROUNDS * THREADS, total);
#pragma unroll 2
        for (int first = begin + thread - lane; first < end; first += THREADS) {
            const int i = first + lane;
            const bool may_be = i < end
                                && may_be_wanted<Types>(load_shape(shapes, world, wp::index(shapes.drawn, i)), wanted,
                                                        light, camera, meshes, fields);
            const unsigned found = __ballot_sync(FULL_WARP, may_be);
            const int slot = __shfl_sync(FULL_WARP, lane == 0 ? atomicAdd(&places.count, __popc(found)) : 0, 0);
            if (may_be)
                places.offset[slot + __popc(found & ((1u << lane) - 1u))] = static_cast<unsigned short>(i - start);
        }
        begin = end;
        block_sync();
        enough = places.count > NearPlaces::ENOUGH || begin - start > NearPlaces::REACH;
        block_sync();
    }
    return begin;
}

// Builds the list from such places, from the one numbered `first` on, as far as there is room. Called by a block.
template <class Types, class Wanted, class List, class Shapes, class Materials, class Meshes, class HeightFields>
WARPCAM_DEVICE void gather_near(List& list, const NearPlaces& places, int first, const Wanted& wanted,
                                const Shapes& shapes, const Materials& materials, const Meshes& meshes,
                                const HeightFields& fields, const LightView& light, const Camera& camera, int world,
                                int thread)
{
    const int end = min(first + List::CAPACITY, places.count);
    for (int number = first + thread; number < end; number += THREADS)
        put_caster<Types>(list, places.start + places.offset[number], wanted, shapes, materials, meshes, fields, light,
                          camera, world);
    end_casters<THREADS>(list, thread);
    close_list(list, thread);
}

#endif
}  // namespace warpcam
