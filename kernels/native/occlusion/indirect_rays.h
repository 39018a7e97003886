// One bounce of light: the rays around a pixel's surface find the nearest shapes, which are lit as those of mirrors are.
#pragma once
#include "occlusion/occlusion_rays.h"
#include "path/emitters.h"
#include "path/lit_surface.h"

namespace warpcam {

// A pixel before its filter: the mean light of its rays, then its normal as put_normal() has it, in the low bytes of a
// word, and above them how many rays meet nothing.
constexpr int OPEN_RAYS_SHIFT = 8 * NORMAL_BYTES;

// Highlights of lights on what rays meet are as wide as those of this roughness at least: few rays find smaller ones by
// chance, as spots (Kaplanyan and Dachsbacher, "Path Space Regularization for Holistic and Robust Light Transport", 2013).
constexpr float LEAST_HIGHLIGHT = 0.5f;

template <class Types, int FLAGS, class Scene_> struct IndirectLight : LitWorld<Types, FLAGS, Scene_> {
    using World_ = LitWorld<Types, FLAGS, Scene_>;
    using World_::scene, World_::hub, World_::world, World_::rows, World_::head, World_::trace, World_::light_of;

    // The light that comes along a ray around a normal from the shape that it meets; `open` counts those that meet none.
    WARPCAM_DEVICE Vec3 light_along(const PathRay& ray, Vec3 normal, const PathQuery& query, int& open) const
    {
        const PathHit hit = trace(ray, query);
        if (hit.slot < 0) {
            ++open;
            return { 0.0f, 0.0f, 0.0f };
        }
        PathSurface surface;
        find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, false, surface);
        PbrInputs<Vec3> inputs = pbr_inputs_of(surface.material);
        if (is_emitter<Types>(scene.frame, scene.shapes, scene.materials, scene.physical, world, hit.shape)) {
            const float other =
                emitter_density<Types>(scene.frame, scene.meshes, load_shape(scene.shapes, world, hit.shape),
                                       hub.origin, ray.point, surface.point, surface.outward, hit.face);
            inputs.emission =
                power_heuristic(max(dot(normal, ray.direction), 0.0f) * (1.0f / PI), other) * inputs.emission;
        }
        inputs.bsdf.square = max(inputs.bsdf.square, fourth_power(LEAST_HIGHLIGHT));
        return light_of(inputs, surface, hit.shape, -ray.direction);
    }

    // The light that comes straight from a place on a shape that shines. Rays around the normal find small ones by chance,
    // as spots, and places on large ones that are near give spots: each has the more of the light the more evenly its
    // rays lie there (Veach and Guibas 1995).
    WARPCAM_DEVICE Vec3 emitted_light(const OcclusionPoint& from, const PathQuery& asked, int id, Float2 at) const
    {
        const Vec3 none { 0.0f, 0.0f, 0.0f };
        const LampSample sample = draw_emitter<Types>(scene.frame, scene.meshes, load_shape(scene.shapes, world, id),
                                                      hub.origin, from.point, at.x, at.y);
        const float around = dot(from.normal, sample.direction) * (1.0f / PI);  // density of the other rays
        if (!(around > 0.0f && sample.weight > 0.0f && dot(from.facing, sample.direction) > 0.0f))
            return none;
        PathQuery query = asked;
        query.far = sample.distance * (1.0f + SAME_PLACE);
        const PathRay ray { from.point, sample.direction };
        const PathHit hit = trace(ray, query);
        if (hit.shape != id || hit.t < sample.distance * (1.0f - SAME_PLACE))
            return none;
        PathSurface surface;
        find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, false, surface);
        return power_heuristic(sample.density, around) * around * sample.weight * surface.material.emission;
    }

    // What arrives at a surface of that shape, as a pixel holds it.
    WARPCAM_DEVICE Float3Int arriving(const OcclusionPoint& from, const RayPattern& pattern, int shape) const
    {
        const PathQuery query = query_from(scene.shapes, shape, -1, scene.frame.backs != 0);
        Vec3 sum { 0.0f, 0.0f, 0.0f };
        int open = 0;
#pragma unroll 1
        for (int ray = 0; ray < OCCLUSION_RAYS; ++ray)
            sum = sum + light_along({ from.point, ray_around(from, pattern, ray) }, from.normal, query, open);
        const int* const emitters = head + FIRST_LAMP + head[NUM_LAMPS];
#pragma unroll 1
        for (int number = 0; number < OCCLUSION_RAYS * head[NUM_EMITTERS]; ++number) {
            const int ray = number % OCCLUSION_RAYS;
            sum = sum + emitted_light(from, query, emitters[number / OCCLUSION_RAYS], pattern.point(ray));
        }
        return make_float3_int((1.0f / OCCLUSION_RAYS) * sum, open << OPEN_RAYS_SHIFT);
    }
};

// Traces the rays of one pixel.
template <class Types, int LENS, int FLAGS, class Scene_, class Views>
WARPCAM_DEVICE void trace_indirect(const Scene_& scene, const Views& views, int index)
{
    const auto& frame = scene.frame;
    const unsigned pixels = unsigned(frame.width * frame.height);
    const int world = int(unsigned(index) / pixels), pixel = int(unsigned(index) - unsigned(world) * pixels);
    const int shape = frame.shape.data[index];
    if (!wp::index(frame.mask, world) || shape < 0)
        return;
    const int row = pixel / frame.width, column = pixel - row * frame.width;
    const Camera camera = load_camera(wp::index(views, world)), hub = upright(camera);
    const OcclusionPoint from = occlusion_point<Types, LENS>(frame, scene.shapes, scene.meshes, scene.fields, camera,
                                                             world, index, view_ray<LENS>(camera, column, row));
    const IndirectLight<Types, FLAGS, Scene_> tracer { {
        scene,
        camera,
        hub,
        world,
        reinterpret_cast<const Float3Int*>(wp::address(frame.rows, world, 0)),
        wp::address(frame.heads, world, 0),
    } };
    Float3Int found = tracer.arriving(from, RayPattern(column, row), shape);
    unsigned char normal[NORMAL_BYTES];
    put_normal(normal, transform_transposed(camera.rotation, from.normal));
    found.w |= normal[0] | normal[1] << 8;
    reinterpret_cast<Float3Int*>(frame.indirect_rays.data)[index] = found;
}

}  // namespace warpcam
