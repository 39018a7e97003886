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
    using Lights_::arriving, Lights_::convex_of, Lights_::drawn_light, Lights_::go_through, Lights_::met_lamps,
        Lights_::trace;
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
    WARPCAM_INLINED bool cross_at(const PathSurface& surface, const PathHit& hit, bool inside, Random4 drawn,
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

    // A path on its way.
    struct Path {
        PathRay ray;
        PathQuery query;
        float x, y;  // of the view's ray: CameraPath
        bool blind;
        bool covered;  // it saw a surface
        Vec3 sum, throughput;
        Scattering last;
        float travelled;
        int bounce;
    };

    template <int LENS> WARPCAM_INLINED void begin(int i, int j, Path& path)
    {
        const Random4 place = random.next();
        const CameraPath from = camera_path<LENS>(camera, i, j, place.x, place.y);
        path = { from.ray, { from.far, false, false, true, -1, -1 }, from.x, from.y, from.blind };
        path.throughput = { 1.0f, 1.0f, 1.0f };
    }

    // To the next surface, and its light; false where the path ends, with its radiance in `sum`.
    template <int LENS> WARPCAM_INLINED bool go_on(int i, int j, Path& path)
    {
        PathRay& ray = path.ray;
        PathQuery& query = path.query;
        Vec3& throughput = path.throughput;
        Scattering& last = path.last;
        PathHit hit { query.far, -1, -1, -1 };
        if (!(head[FAULTY] || path.blind))
            hit = trace(ray, query);
        if (path.bounce > 0)
            path.sum = path.sum + met_lamps(last, ray.direction, hit.slot < 0 ? MAX_RAY_T : path.travelled + hit.t);
        if (hit.slot < 0) {
            const Vec3 light = path.bounce == 0 ? background<LENS>(i, j, path)
                                                : weight_of_sky(last, ray.direction) * sky(ray.direction);
            path.sum = path.sum + mul(throughput, light);
            return false;
        }
        PathSurface surface;
        const bool inside = hit.shape == query.inside;
        find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, inside, surface);
        path.travelled += hit.t;
        if ((FLAGS & HAS_TRANSPARENT) && surface.alpha < 1.0f && random.next().x >= surface.alpha) {
            go_through(surface, hit, ray, query);
            path.travelled += surface.margin;
            return true;
        }
        path.covered = true;
        SurfaceMaterial& material = surface.material;
        if (material.reflectance < 0.0f) {  // UNLIT
            material.emission = material.color;
            material.color = { 0.0f, 0.0f, 0.0f };
            material.reflectance = 0.0f;
        }
        if (material.emission.x + material.emission.y + material.emission.z > 0.0f)
            path.sum = path.sum + weight_of_met(last, surface, hit) * mul(throughput, material.emission);
        if (path.bounce >= scene.frame.most_bounces)
            return false;
        const Vec3 to_eye = -ray.direction, facing = surface.front ? surface.outward : -surface.outward;
        if (surface.transmission > 0.0f) {
            const Random4 drawn = random.next();
            if (drawn.w < surface.transmission) {
                if (!cross_at(surface, hit, inside, drawn, throughput, ray, query))
                    return false;
                if (++path.bounce >= SURE_BOUNCES && !survives(throughput))
                    return false;
                last = { surface.point, { { 0.0f, 0.0f, 0.0f }, throughput }, 0.0f };
                path.travelled = 0.0f;
                return true;
            }
        }
        const Reflector reflector(material.color, material.roughness, material.metallic, material.reflectance,
                                  AlbedoTable { scene.frame.albedo.data });
        const float share = reflector.facet_share(dot(surface.normal, to_eye));
        const LightRay to_light = drawn_light(surface, reflector, to_eye, share);
        const Vec3 light = mul(throughput, to_light.light);
        query = { MAX_RAY_T, false, scene.frame.backs != 0, false, convex_of(hit.shape), query.inside };
        ray.point = surface.point + surface.margin * facing;
        const bool goes_on = reflect(surface, reflector, to_eye, facing, share, path);
        if (to_light.shines())  // looked for when the surface is done with
            path.sum = path.sum + mul(light, arriving(to_light, ray.point, surface.margin, query));
        path.travelled = 0.0f;
        return goes_on;
    }

    // Draws the direction in which the path goes on; false where it ends.
    WARPCAM_INLINED bool reflect(const PathSurface& surface, const Reflector& reflector, Vec3 to_eye, Vec3 facing,
                                 float share, Path& path)
    {
        const Random4 drawn = random.next();
        const Vec3 direction =
            normalized(reflector.sample(FrameAxes(surface.normal), to_eye, share, drawn.x, drawn.y, drawn.z));
        path.ray.direction = direction;
        const float density = reflector.density(surface.normal, to_eye, direction, share);
        if (!(density > 0.0f && dot(facing, direction) > 0.0f))
            return false;
        const ReflectedParts parts = reflector.value(surface.normal, to_eye, direction);
        const float rate = dot(surface.normal, direction) / density;
        Vec3& throughput = path.throughput;
        Scattering& last = path.last;
        last = { surface.point, { mul(throughput, rate * parts.matt), mul(throughput, rate * parts.gloss) }, density };
        throughput = last.parts.matt + last.parts.gloss;
        const float before = throughput.x + throughput.y + throughput.z;
        if (!(before > 0.0f) || (++path.bounce >= SURE_BOUNCES && !survives(throughput)))
            return false;
        const float raised = (throughput.x + throughput.y + throughput.z) / before;
        last.parts = { raised * last.parts.matt, raised * last.parts.gloss };
        return true;
    }

    // What a pixel shows that sees nothing.
    template <int LENS> WARPCAM_INLINED Vec3 background(int i, int j, const Path& path) const
    {
        if constexpr ((FLAGS & SHOWS_ENVIRONMENT) != 0)
            return environment_along(load_environment(scene.physical.environments, world), path.ray.direction);
        const auto& behind = background_of<FLAGS>(scene, world);
        const auto color = [&](const auto& seen_by) {
            return srgb_to_linear(
                background_color<LENS, FLAGS>(scene.textures, behind, seen_by, scene.frame.horizon, path.x, path.y));
        };
        Vec3 light;
        if constexpr (has_table(LENS))
            light = color(camera_at<LENS>(camera, i, j));
        else
            light = color(camera);
        return IMAGE ? mul(as_vec3(per_world(scene.physical.sky, world, SKY_TERMS)), light) : light;
    }
};

// The pixel that a thread of a world's image has: threads of a CUDA warp have a tile of 8x4, where images consist of these,
// as paths of near pixels meet the same shapes for longer.
WARPCAM_DEVICE int path_pixel(int thread, int width, int height)
{
#if defined(__CUDA_ARCH__)
    if (width % 8 == 0 && height % 4 == 0) {
        const int tile = thread / 32, lane = thread % 32, across = width / 8;
        return (tile / across * 4 + lane / 8) * width + tile % across * 8 + lane % 8;
    }
#endif
    return thread;
}

// Adds paths to one pixel, and writes its means.
template <class Types, int LENS, int FLAGS, class Scene_, class Views>
WARPCAM_INLINED void trace_paths(const Scene_& scene, const Views& views, int index)
{
    const auto& frame = scene.frame;
    const auto& images = scene.images;
    const unsigned pixels = unsigned(frame.width * frame.height);
    const int world = int(unsigned(index) / pixels), begin = int(unsigned(world) * pixels);
    if (!wp::index(frame.mask, world))
        return;
    const int pixel = path_pixel(index - begin, frame.width, frame.height);
    const int j = pixel / frame.width, i = pixel - j * frame.width;
    index = begin + pixel;
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
    // A thread whose path has ended begins its next one while its neighbours' go on.
    typename PathTracer<Types, FLAGS, Scene_>::Path path;
    int sample = 0;
    for (bool fresh = true; sample < count;) {
        if (fresh) {
            tracer.random = { unsigned(wp::index(frame.seeds, world)), unsigned(pixel), unsigned(first + sample), 0u };
            tracer.template begin<LENS>(i, j, path);
        }
        fresh = !tracer.template go_on<LENS>(i, j, path);
        if (fresh) {
            if (abs(path.sum.x + path.sum.y + path.sum.z) < MISS)
                sum = sum + path.sum;
            seen += path.covered ? 1.0f : 0.0f;
            ++sample;
        }
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
