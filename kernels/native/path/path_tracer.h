// Paths of light from a pixel: unbiased, by next-event estimation with multiple importance sampling.
//
// At each surface one light is drawn and its light added, if nothing is in the way, and one direction of reflection is
// drawn, along which the path goes on. What both can find is weighted by the power heuristic (Veach and Guibas 1995). Where
// a path has little left to give it ends by Russian roulette.
#pragma once
#include "path/camera_path.h"
#include "path/path_lights.h"

namespace warpcam {

constexpr int SURE_BOUNCES = 3;  // before roulette
constexpr float MOST_LIKELY = 0.95f;  // to go on

template <class Types, int FLAGS, class Scene_> struct PathTracer : PathLights<Types, FLAGS, Scene_> {
    using Lights_ = PathLights<Types, FLAGS, Scene_>;
    using Lights_::convex_of, Lights_::drawn_light, Lights_::go_through, Lights_::met_lamps, Lights_::trace;
    using Lights_::scene, Lights_::camera, Lights_::hub, Lights_::world, Lights_::rows, Lights_::head, Lights_::random;
    using Lights_::sky, Lights_::weight_of_met, Lights_::weight_of_sky, Lights_::IMAGE;

    // Roulette: false where the path ends; what goes on stands for what does not.
    WARPCAM_DEVICE bool survives(Vec3& throughput)
    {
        const float likely = min(max(max(throughput.x, throughput.y), throughput.z), MOST_LIKELY);
        if (!(random.next().x < likely))
            return false;
        throughput = 1.0f / likely * throughput;
        return true;
    }

    // Goes on at the border of a clear material; false where no light comes from there.
    WARPCAM_DEVICE bool cross_at(const PathSurface& surface, const PathHit& hit, bool inside, Random4 drawn,
                                 Vec3& throughput, PathRay& ray, PathQuery& query) const
    {
        const Vec3 facing = surface.front ? surface.outward : -surface.outward;
        const bool thin = wp::index(scene.shapes.types, hit.shape) == PLANE;
        const float index = refractive_index(surface.material.reflectance);
        const BorderStep step = cross_border(surface.normal, -ray.direction, inside ? 1.0f / index : index,
                                             surface.material.roughness, thin, drawn);
        const float side = dot(step.direction, facing);
        if (!(step.weight > 0.0f) || (step.through ? side >= 0.0f : side <= 0.0f))
            return false;
        throughput = step.weight * throughput;
        if (step.through) {  // each of two borders takes its part of the colour
            const Vec3 color = surface.material.color;
            const Vec3 part { wp::sqrt(max(color.x, 0.0f)), wp::sqrt(max(color.y, 0.0f)),
                              wp::sqrt(max(color.z, 0.0f)) };
            throughput = mul(throughput, thin ? color : part);
        }
        const int within = step.through && !thin ? (inside ? -1 : hit.shape) : query.inside;
        ray = { surface.point + (step.through ? -surface.margin : surface.margin) * facing, step.direction };
        query = { MAX_RAY_T, false, scene.frame.backs != 0, false, convex_of(hit.shape), within };
        return true;
    }

    // Radiance of one path, and whether it saw a surface.
    template <int LENS> WARPCAM_DEVICE Vec3 radiance(int i, int j, bool& covered)
    {
        const Random4 place = random.next();
        const CameraPath from = camera_path<LENS>(camera, i, j, place.x, place.y);
        Vec3 sum { 0.0f, 0.0f, 0.0f }, throughput { 1.0f, 1.0f, 1.0f };
        PathRay ray = from.ray;
        PathQuery query { from.far, false, false, true, -1, -1 };
        Scattering last {};
        float travelled = 0.0f;
        covered = false;
        for (int bounce = 0;;) {
            PathHit hit { query.far, -1, -1, -1 };
            if (!(head[FAULTY] || from.blind))
                hit = trace(ray, query);
            if (bounce > 0)
                sum = sum + met_lamps(last, ray.direction, hit.slot < 0 ? MAX_RAY_T : travelled + hit.t);
            if (hit.slot < 0) {
                const Vec3 light = bounce == 0 ? background<LENS>(i, j, from)
                                               : weight_of_sky(last, ray.direction) * sky(ray.direction);
                return sum + mul(throughput, light);
            }
            PathSurface surface;
            const bool inside = hit.shape == query.inside;
            find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, inside, surface);
            travelled += hit.t;
            if ((FLAGS & HAS_TRANSPARENT) && surface.alpha < 1.0f && random.next().x >= surface.alpha) {
                go_through(surface, hit, ray, query);
                travelled += surface.margin;
                continue;
            }
            covered = true;
            SurfaceMaterial& material = surface.material;
            if (material.reflectance < 0.0f) {  // UNLIT
                material.emission = material.color;
                material.color = { 0.0f, 0.0f, 0.0f };
                material.reflectance = 0.0f;
            }
            if (material.emission.x + material.emission.y + material.emission.z > 0.0f)
                sum = sum + weight_of_met(last, surface, hit) * mul(throughput, material.emission);
            if (bounce >= scene.frame.most_bounces)
                return sum;
            const Vec3 to_eye = -ray.direction, facing = surface.front ? surface.outward : -surface.outward;
            if (surface.transmission > 0.0f) {
                const Random4 drawn = random.next();
                if (drawn.w < surface.transmission) {
                    if (!cross_at(surface, hit, inside, drawn, throughput, ray, query))
                        return sum;
                    if (++bounce >= SURE_BOUNCES && !survives(throughput))
                        return sum;
                    last = { surface.point, { { 0.0f, 0.0f, 0.0f }, throughput }, 0.0f };
                    travelled = 0.0f;
                    continue;
                }
            }
            const Reflector reflector(material.color, material.roughness, material.metallic, material.reflectance,
                                      AlbedoTable { scene.frame.albedo.data });
            const float share = reflector.facet_share(dot(surface.normal, to_eye));
            query = { MAX_RAY_T, false, scene.frame.backs != 0, false, convex_of(hit.shape), query.inside };
            sum = sum + mul(throughput, drawn_light(surface, reflector, to_eye, share, query));

            const Random4 drawn = random.next();
            const Vec3 direction =
                normalized(reflector.sample(FrameAxes(surface.normal), to_eye, share, drawn.x, drawn.y, drawn.z));
            const float density = reflector.density(surface.normal, to_eye, direction, share);
            if (!(density > 0.0f && dot(facing, direction) > 0.0f))
                return sum;
            const ReflectedParts parts = reflector.value(surface.normal, to_eye, direction);
            const float rate = dot(surface.normal, direction) / density;
            last = { surface.point,
                     { mul(throughput, rate * parts.matt), mul(throughput, rate * parts.gloss) },
                     density };
            throughput = last.parts.matt + last.parts.gloss;
            const float before = throughput.x + throughput.y + throughput.z;
            if (!(before > 0.0f) || (++bounce >= SURE_BOUNCES && !survives(throughput)))
                return sum;
            const float raised = (throughput.x + throughput.y + throughput.z) / before;
            last.parts = { raised * last.parts.matt, raised * last.parts.gloss };
            ray = { surface.point + surface.margin * facing, direction };
            travelled = 0.0f;
        }
    }

    // What a pixel shows that sees nothing.
    template <int LENS> WARPCAM_DEVICE Vec3 background(int i, int j, const CameraPath& from) const
    {
        if constexpr ((FLAGS & SHOWS_ENVIRONMENT) != 0)
            return environment_along(load_environment(scene.physical.environments, world), from.ray.direction);
        const auto& behind = background_of<FLAGS>(scene, world);
        const auto color = [&](const auto& seen_by) {
            return srgb_to_linear(
                background_color<LENS, FLAGS>(scene.textures, behind, seen_by, scene.frame.horizon, from.x, from.y));
        };
        Vec3 light;
        if constexpr (has_table(LENS))
            light = color(camera_at<LENS>(camera, i, j));
        else
            light = color(camera);
        return IMAGE ? mul(as_vec3(per_world(scene.physical.sky, world, SKY_TERMS)), light) : light;
    }
};

// Adds paths to one pixel, and writes its means.
template <class Types, int LENS, int FLAGS, class Scene_, class Views>
WARPCAM_DEVICE void trace_paths(const Scene_& scene, const Views& views, int index)
{
    const auto& frame = scene.frame;
    const auto& images = scene.images;
    const unsigned pixels = unsigned(frame.width * frame.height);
    const int world = int(unsigned(index) / pixels), pixel = int(unsigned(index) - unsigned(world) * pixels);
    if (!wp::index(frame.mask, world))
        return;
    const int j = pixel / frame.width, i = pixel - j * frame.width;
    const Camera camera = load_camera(wp::index(views, world));
    PathTracer<Types, FLAGS, Scene_> tracer { {
        scene,
        camera,
        upright(camera),
        world,
        reinterpret_cast<const Float3Int*>(wp::address(frame.rows, world, 0)),
        wp::address(frame.heads, world, 0),
        {},
    } };
    const int first = wp::index(frame.begun, world), count = wp::index(frame.wanted, world);
    Vec3 sum { 0.0f, 0.0f, 0.0f };
    float seen = 0.0f;
    for (int sample = 0; sample < count; ++sample) {
        tracer.random = { unsigned(wp::index(frame.seeds, world)), unsigned(pixel), unsigned(first + sample), 0u };
        bool covered;
        const Vec3 light = tracer.template radiance<LENS>(i, j, covered);
        if (abs(light.x + light.y + light.z) < MISS)
            sum = sum + light;
        seen += covered ? 1.0f : 0.0f;
    }
    Float3Int& total = *reinterpret_cast<Float3Int*>(frame.sums.data + index);
    Float3Int own = make_float3_int(sum, as_int(seen));
    if (first > 0)
        own = make_float3_int(as_vec3(total) + sum, as_int(as_float(total.w) + seen));
    total = own;
    const float rate = 1.0f / float(max(first + count, 1));
    const Vec3 mean = exposed<FLAGS>(scene, world, rate * as_vec3(own));
    if (images.hdr.data)
        put_three(images.hdr.data, unsigned(index), mean);
    const unsigned word = to_bytes(display_color<FLAGS>(mean));
    if (images.rgb.data)
        for (int channel = 0; channel < 3; ++channel)
            images.rgb.data[3 * size_t(index) + channel] = static_cast<unsigned char>(word >> 8 * channel);
    if (images.rgba.data) {
        const unsigned all = word | to_byte(rate * as_float(own.w)) << 24;
        for (int channel = 0; channel < 4; ++channel)
            images.rgba.data[4 * size_t(index) + channel] = static_cast<unsigned char>(all >> 8 * channel);
    }
}

}  // namespace warpcam
