// Light that comes straight from lights to a surface of a path: one light is drawn; lights that a drawn direction meets.
#pragma once
#include "path/dielectric.h"
#include "path/emitters.h"
#include "path/path_sky.h"
#include "path/path_surface.h"

namespace warpcam {

constexpr float SAME_PLACE = 1.0e-3f;  // part of a distance within which two places are one

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

// One path's scene and numbers, and the light at its surfaces that comes straight from lights.
template <class Types, int FLAGS, class Scene_> struct PathLights {
    static constexpr bool IMAGE = FLAGS & HAS_SKYBOX, ENVIRONMENT = FLAGS & HAS_ENVIRONMENT;

    const Scene_& scene;
    Camera camera, hub;
    int world;
    const Float3Int* rows;
    const int* head;
    RandomSource random;

    WARPCAM_DEVICE bool headlit() const { return headlight_shines(scene.physical.plain); }
    WARPCAM_DEVICE int num_lamps() const { return head[NUM_LAMPS] + headlit(); }
    // The sky's image as a light that is drawn.
    WARPCAM_DEVICE auto sky_cells() const
    {
        if constexpr (ENVIRONMENT)
            return environment_cells(scene.physical.environments, world);
        else
            return SkyCells { scene.frame.sky_sums.data, IMAGE ? scene.frame.sky_side : 0 };
    }
    WARPCAM_DEVICE int num_lights() const { return num_lamps() + head[NUM_EMITTERS] + sky_cells().shines(); }

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

    // Light of one lamp or shining shape at a surface, on average all that arrives from them.
    WARPCAM_DEVICE Vec3 drawn_light(const PathSurface& surface, const Reflector& reflector, Vec3 to_eye, float share,
                                    const PathQuery& from)
    {
        const Vec3 none { 0.0f, 0.0f, 0.0f };
        const int count = num_lights();
        if (count == 0)
            return none;
        const Random4 drawn = random.next();
        const int number = min(int(drawn.x * float(count)), count - 1);
        if (number >= num_lamps() + head[NUM_EMITTERS])
            return sky_light(surface, reflector, to_eye, share, from, drawn);
        if (number >= num_lamps())
            return emitter_light(surface, reflector, to_eye, share, from,
                                 head[FIRST_LAMP + head[NUM_LAMPS] + number - num_lamps()], drawn);
        const AreaLight lamp = lamp_at(number);
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

    // Light from all around, with what lights give to it.
    WARPCAM_DEVICE Vec3 sky(Vec3 direction) const
    {
        Vec3 light;
        if constexpr (ENVIRONMENT)
            light = as_vec3(wp::index(scene.physical.plain.headlight, headlight_of<FLAGS>(world)))
                    + environment_along(load_environment(scene.physical.environments, world), direction);
        else
            light = path_sky<IMAGE>(scene.physical, scene.textures, background_of<FLAGS>(scene, world), world,
                                    headlight_of<FLAGS>(world), direction);
        for (int number = 0; number < head[NUM_LAMPS]; ++number)
            light = light + as_vec3(per_world(scene.physical.plain.ambient, world, head[FIRST_LAMP + number]));
        return light;
    }

    // Light of the sky's image.
    WARPCAM_DEVICE Vec3 sky_light(const PathSurface& surface, const Reflector& reflector, Vec3 to_eye, float share,
                                  PathQuery query, Random4 drawn)
    {
        const Vec3 none { 0.0f, 0.0f, 0.0f };
        const Vec3 direction = sky_cells().draw(drawn.w, drawn.y, drawn.z);
        const Vec3 facing = surface.front ? surface.outward : -surface.outward;
        const float cosine = dot(surface.normal, direction);
        const float own = sky_cells().density(direction) / float(num_lights());
        if (!(own > 0.0f && cosine > 0.0f && dot(facing, direction) > 0.0f))
            return none;
        query.far = MAX_RAY_T;
        if (!reaches({ surface.point + surface.margin * facing, direction }, query))
            return none;
        const ReflectedParts parts = reflector.value(surface.normal, to_eye, direction);
        const float weight = power_heuristic(own, reflector.density(surface.normal, to_eye, direction, share));
        return weight * cosine / own * mul(parts.matt + parts.gloss, sky(direction));
    }

    // The part of the sky's light along a drawn direction that is not drawn as a light's.
    WARPCAM_DEVICE float weight_of_sky(const Scattering& last, Vec3 direction) const
    {
        if (!(sky_cells().shines() && last.density > 0.0f))
            return 1.0f;
        return power_heuristic(last.density, sky_cells().density(direction) / float(num_lights()));
    }

    // Light of a shape that shines.
    WARPCAM_DEVICE Vec3 emitter_light(const PathSurface& surface, const Reflector& reflector, Vec3 to_eye, float share,
                                      PathQuery query, int id, Random4 drawn)
    {
        const Vec3 none { 0.0f, 0.0f, 0.0f };
        const float count = float(num_lights());
        const Shape shape = load_shape(scene.shapes, world, id);
        const LampSample sample =
            draw_emitter<Types>(scene.frame, scene.meshes, shape, hub.origin, surface.point, drawn.w, drawn.y, drawn.z);
        const Vec3 facing = surface.front ? surface.outward : -surface.outward;
        const float cosine = dot(surface.normal, sample.direction);
        if (!(sample.weight > 0.0f && cosine > 0.0f && dot(facing, sample.direction) > 0.0f))
            return none;
        PathRay ray { surface.point + surface.margin * facing, sample.direction };
        query.far = sample.distance * (1.0f + SAME_PLACE) + surface.margin;
        float left = sample.distance * (1.0f - SAME_PLACE) - surface.margin;
        while (true) {
            const PathHit hit = trace(ray, query);
            if (hit.slot < 0)
                return none;
            const bool there = hit.shape == id && hit.t >= left;
            if (!there && !(FLAGS & HAS_TRANSPARENT))
                return none;
            PathSurface met;
            find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, false, met);
            if (there) {
                const ReflectedParts parts = reflector.value(surface.normal, to_eye, sample.direction);
                const float other = reflector.density(surface.normal, to_eye, sample.direction, share);
                const float weight = met.alpha * power_heuristic(sample.density / count, other);
                return weight * cosine * sample.weight * count * mul(parts.matt + parts.gloss, met.material.emission);
            }
            if (random.next().x < met.alpha)
                return none;
            left -= hit.t + met.margin;
            go_through(met, hit, ray, query);
        }
    }

    // The part of a met surface's own light that is not drawn as a light's.
    WARPCAM_DEVICE float weight_of_met(const Scattering& last, const PathSurface& met, const PathHit& hit) const
    {
        if (!(last.density > 0.0f)
            || !is_emitter<Types>(scene.frame, scene.shapes, scene.materials, scene.physical, world, hit.shape))
            return 1.0f;
        const float other =
            emitter_density<Types>(scene.frame, scene.meshes, load_shape(scene.shapes, world, hit.shape), hub.origin,
                                   last.point, met.point, met.outward, hit.face);
        return power_heuristic(last.density, other / float(num_lights()));
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
            const float other = met.density / float(num_lights());
            const float weight = last.density > 0.0f ? power_heuristic(last.density, other) : 1.0f;
            sum = sum + weight * strength * colored(lamp, last.parts);
        }
        return sum;
    }
};

}  // namespace warpcam
