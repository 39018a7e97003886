// Paths of light from a pixel: unbiased, by next-event estimation with multiple importance sampling.
//
// At each surface one light is drawn and its light added, if nothing is in the way, and one direction of reflection is
// drawn, along which the path goes on. What both can find is weighted by the power heuristic (Veach and Guibas 1995). Where
// a path has little left to give it ends by Russian roulette.
#pragma once
#include "path/camera_path.h"
#include "path/lamps.h"
#include "path/path_sky.h"
#include "path/path_surface.h"
#include "path/random.h"
#include "path/reflection.h"

namespace warpcam {

constexpr int SURE_BOUNCES = 3;  // before roulette
constexpr float MOST_LIKELY = 0.95f;  // to go on

WARPCAM_DEVICE float power_heuristic(float own, float other)
{
    return own * own / max(own * own + other * other, MIN_NORMAL);
}

// The last place where a path was scattered.
struct Scattering {
    Vec3 point;
    ReflectedParts parts;  // what of light from the drawn direction arrives at the eye
    float density;  // of the direction [1/sr]; 0: lights cannot be drawn there
};

template <class Types, int FLAGS, class Scene_> struct PathTracer {
    static constexpr bool IMAGE = FLAGS & HAS_SKYBOX;

    const Scene_& scene;
    Camera camera, hub;
    int world;
    const Float3Int* rows;
    const int* head;
    RandomSource random;

    WARPCAM_DEVICE bool headlit() const { return headlight_shines(scene.physical.plain); }
    WARPCAM_DEVICE int num_lamps() const { return head[NUM_LAMPS] + headlit(); }

    // A light, the headlight after all others.
    WARPCAM_DEVICE AreaLight lamp_at(int number) const
    {
        if (number < head[NUM_LAMPS])
            return load_area_light<true>(scene.physical, hub, world, head[FIRST_LAMP + number], 0);
        AreaLight lamp {};
        const Mat3& turn = camera.rotation;
        const int first = headlight_of<FLAGS>(world);
        const auto& colors = scene.physical.plain.headlight;
        lamp.place = { turn.at[0][2], turn.at[1][2], turn.at[2][2], 0 };
        lamp.diffuse = make_float3_int(as_vec3(wp::index(colors, first + 1)), 0);
        lamp.specular = make_float3_int(as_vec3(wp::index(colors, first + 2)), 0);
        return lamp;
    }

    WARPCAM_DEVICE static Vec3 colored(const AreaLight& lamp, const ReflectedParts& parts)
    {
        return mul(parts.matt, as_vec3(lamp.diffuse)) + mul(parts.gloss, as_vec3(lamp.specular));
    }

    WARPCAM_DEVICE PathHit trace(const PathRay& ray, const PathQuery& query) const
    {
        return trace_path<Types>(rows, head[NUM_SHAPES], scene.meshes, scene.fields, ray, query);
    }

    WARPCAM_DEVICE int convex_of(int shape) const
    {
        const int type = wp::index(scene.shapes.types, shape);
        return type == MESH || type == HEIGHT_FIELD ? -1 : shape;
    }

    // Light that nothing holds up; what is partly transparent does so by chance.
    WARPCAM_DEVICE bool reaches(PathRay ray, PathQuery query)
    {
        query.any = !(FLAGS & HAS_TRANSPARENT);
        while (true) {
            const PathHit hit = trace(ray, query);
            if (hit.slot < 0)
                return true;
            if constexpr (!(FLAGS & HAS_TRANSPARENT))
                return false;
            PathSurface met;
            find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, false, met);
            if (random.next().x < met.alpha)
                return false;
            go_through(met, hit, ray, query);
        }
    }

    // Behind what it went through.
    WARPCAM_DEVICE void go_through(const PathSurface& met, const PathHit& hit, PathRay& ray, PathQuery& query) const
    {
        ray.point = met.point + met.margin * ray.direction;
        query.far -= hit.t + met.margin;
        query.convex = convex_of(hit.shape);
    }

    // Light of one lamp at a surface, of all that arrives from lamps on average.
    WARPCAM_DEVICE Vec3 lamp_light(const PathSurface& surface, const Reflector& reflector, Vec3 to_eye, float share,
                                   const PathQuery& from)
    {
        const Vec3 none { 0.0f, 0.0f, 0.0f };
        const int count = num_lamps();
        if (count == 0)
            return none;
        const Random4 drawn = random.next();
        const AreaLight lamp = lamp_at(min(int(drawn.x * float(count)), count - 1));
        const LampSample sample = draw_lamp(lamp, surface.point, drawn.y, drawn.z);
        const Vec3 facing = surface.front ? surface.outward : -surface.outward;
        const float cosine = dot(surface.normal, sample.direction);
        if (!(sample.weight > 0.0f && cosine > 0.0f && dot(facing, sample.direction) > 0.0f))
            return none;
        const ReflectedParts parts = reflector.value(surface.normal, to_eye, sample.direction);
        const Vec3 light = cosine * sample.weight * float(count) * colored(lamp, parts);
        if (!(light.x + light.y + light.z > 0.0f))
            return none;
        PathQuery query = from;
        query.far = sample.distance;
        const PathRay ray { surface.point + surface.margin * facing, sample.direction };
        if ((lamp.diffuse.w & CASTS) && !reaches(ray, query))
            return none;
        const float other = reflector.density(surface.normal, to_eye, sample.direction, share);
        const float own = sample.density / float(count);
        return (sample.density > 0.0f ? power_heuristic(own, other) : 1.0f) * light;
    }

    // Light of the lamps that a drawn ray meets before `far` from where it was drawn.
    WARPCAM_DEVICE Vec3 met_lamps(const Scattering& last, Vec3 direction, float far) const
    {
        Vec3 sum { 0.0f, 0.0f, 0.0f };
        const int count = head[NUM_LAMPS];
        for (int number = 0; number < count; ++number) {
            const AreaLight lamp = lamp_at(number);
            const LampMeeting met = meet_lamp(lamp, last.point, direction);
            if (!(met.distance < MISS) || ((lamp.diffuse.w & CASTS) && met.distance > far))
                continue;
            const float strength = is_distant(lamp) ? 1.0f / lamp.size.x : share_of_cone(lamp, direction);
            const float other = met.density / float(num_lamps());
            const float weight = last.density > 0.0f ? power_heuristic(last.density, other) : 1.0f;
            sum = sum + weight * strength * colored(lamp, last.parts);
        }
        return sum;
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
                const Vec3 light =
                    bounce == 0 ? background<LENS>(i, j, from)
                                : path_sky<IMAGE>(scene.physical, scene.textures, background_of<FLAGS>(scene, world),
                                                  world, headlight_of<FLAGS>(world), ray.direction);
                return sum + mul(throughput, light);
            }
            PathSurface surface;
            find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, false, surface);
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
            sum = sum + mul(throughput, material.emission);
            if (bounce >= scene.frame.most_bounces)
                return sum;
            const Vec3 to_eye = -ray.direction, facing = surface.front ? surface.outward : -surface.outward;
            const Reflector reflector(material.color, material.roughness, material.metallic, material.reflectance,
                                      AlbedoTable { scene.frame.albedo.data });
            const float share = reflector.facet_share(dot(surface.normal, to_eye));
            query = { MAX_RAY_T, false, scene.frame.backs != 0, false, convex_of(hit.shape), -1 };
            sum = sum + mul(throughput, lamp_light(surface, reflector, to_eye, share, query));

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
            const float left = max(max(throughput.x, throughput.y), throughput.z);
            if (++bounce >= SURE_BOUNCES) {
                const float likely = min(left, MOST_LIKELY);
                if (!(drawn.w < likely))
                    return sum;
                throughput = 1.0f / likely * throughput;
                last.parts = { 1.0f / likely * last.parts.matt, 1.0f / likely * last.parts.gloss };
            } else if (!(left > 0.0f)) {
                return sum;
            }
            ray = { surface.point + surface.margin * facing, direction };
            travelled = 0.0f;
        }
    }

    // What a pixel shows that sees nothing.
    template <int LENS> WARPCAM_DEVICE Vec3 background(int i, int j, const CameraPath& from) const
    {
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
    PathTracer<Types, FLAGS, Scene_> tracer {
        scene,
        camera,
        upright(camera),
        world,
        reinterpret_cast<const Float3Int*>(wp::address(frame.rows, world, 0)),
        wp::address(frame.heads, world, 0),
        {},
    };
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
    const unsigned word = to_bytes(linear_to_srgb(mean));
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
