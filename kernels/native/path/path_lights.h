// Light that comes straight from lights to a surface of a path: one light is drawn; lights that a drawn direction meets.
#pragma once
#include "path/dielectric.h"
#include "path/emitters.h"
#include "path/path_sky.h"
#include "path/path_surface.h"

namespace warpcam {

// The last place where a path was scattered.
struct Scattering {
    Vec3 point;
    ReflectedParts parts;  // what of light from the drawn direction arrives at the eye
    float density;  // of the direction [1/sr]; 0: lights cannot be drawn there
};

// A ray to a light that was drawn.
struct LightRay {
    Vec3 light;  // that arrives if nothing is in the way
    Vec3 direction;
    float far;  // how far the light is
    int emitter;  // the shape that shines, or -1
    bool held_up;  // by what is in the way

    WARPCAM_DEVICE bool shines() const { return light.x + light.y + light.z > 0.0f; }
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
    WARPCAM_INLINED auto sky_cells() const
    {
        if constexpr (ENVIRONMENT)
            return environment_cells(scene.physical.environments, world);
        else
            return SkyCells { scene.frame.sky_sums.data, IMAGE ? scene.frame.sky_side : 0 };
    }
    WARPCAM_DEVICE int num_lights() const { return num_lamps() + head[NUM_EMITTERS] + sky_cells().shines(); }

    // A light, the headlight after all others.
    WARPCAM_INLINED AreaLight lamp_at(int number) const
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

    WARPCAM_INLINED PathHit trace(const PathRay& ray, const PathQuery& query) const
    {
        return trace_path<Types>(rows, head[NUM_SHAPES], scene.meshes, scene.fields, ray, query);
    }

    WARPCAM_DEVICE int convex_of(int shape) const
    {
        const int type = wp::index(scene.shapes.types, shape);
        return type == MESH || type == HEIGHT_FIELD ? -1 : shape;
    }

    // Behind what it went through.
    WARPCAM_INLINED void go_through(const PathSurface& met, const PathHit& hit, PathRay& ray, PathQuery& query) const
    {
        ray.point = met.point + met.margin * ray.direction;
        query.far -= hit.t + met.margin;
        query.convex = convex_of(hit.shape);
    }

    // One lamp, the sky's image or a shining shape, and what is on average all light from them if it arrives.
    WARPCAM_INLINED LightRay drawn_light(const PathSurface& surface, const Reflector& reflector, Vec3 to_eye,
                                         float share)
    {
        const int count = num_lights();
        if (count == 0)
            return {};
        const Random4 drawn = random.next();
        const int number = min(int(drawn.x * float(count)), count - 1);
        const bool sky_drawn = number >= num_lamps() + head[NUM_EMITTERS], lamp_drawn = number < num_lamps();
        LightRay found { {}, {}, 0.0f, -1, true };
        float density;
        Vec3 matt, gloss;  // the light's colours
        if (lamp_drawn) {
            const AreaLight lamp = lamp_at(number);
            const LampSample sample = draw_lamp(lamp, surface.point, drawn.y, drawn.z);
            found.direction = sample.direction;
            found.far = sample.distance;
            found.held_up = lamp.diffuse.w & CASTS;
            density = sample.density;
            matt = sample.weight * as_vec3(lamp.diffuse);
            gloss = sample.weight * as_vec3(lamp.specular);
        } else if (sky_drawn) {
            found.direction = sky_cells().draw(drawn.w, drawn.y, drawn.z);
            found.far = MAX_RAY_T;
            density = sky_cells().density(found.direction);
            const float weight = density > 0.0f ? 1.0f / density : 0.0f;
            matt = gloss = weight > 0.0f ? weight * sky(found.direction) : Vec3 { 0.0f, 0.0f, 0.0f };
        } else {
            found.emitter = head[FIRST_LAMP + head[NUM_LAMPS] + number - num_lamps()];
            const LampSample sample =
                draw_emitter<Types>(scene.frame, scene.meshes, load_shape(scene.shapes, world, found.emitter),
                                    hub.origin, surface.point, drawn.y, drawn.z);
            found.direction = sample.direction;
            found.far = sample.distance;
            density = sample.density;
            matt = gloss = { sample.weight, sample.weight, sample.weight };  // times what it emits there
        }
        const Vec3 facing = surface.front ? surface.outward : -surface.outward;
        const float cosine = dot(surface.normal, found.direction);
        if (!(cosine > 0.0f && dot(facing, found.direction) > 0.0f))
            return {};
        const ReflectedParts parts = reflector.value(surface.normal, to_eye, found.direction);
        const float other = reflector.density(surface.normal, to_eye, found.direction, share);
        const float weight = density > 0.0f ? power_heuristic(density / float(count), other) : 1.0f;
        found.light = weight * cosine * float(count) * (mul(parts.matt, matt) + mul(parts.gloss, gloss));
        return found;
    }

    // The share of a drawn light that arrives at the start of its ray, times what a shape that shines emits. What is partly
    // transparent holds it up by chance. `query`: of the path there.
    WARPCAM_INLINED Vec3 arriving(const LightRay& drawn, Vec3 start, float margin, PathQuery query)
    {
        const Vec3 all { 1.0f, 1.0f, 1.0f }, none { 0.0f, 0.0f, 0.0f };
        if (!drawn.held_up)
            return all;
        const bool is_shape = drawn.emitter >= 0;
        PathRay ray { start, drawn.direction };
        query.far = is_shape ? drawn.far * (1.0f + SAME_PLACE) + margin : drawn.far;
        query.any = !is_shape && !(FLAGS & HAS_TRANSPARENT);
        float left = drawn.far * (1.0f - SAME_PLACE) - margin;
        while (true) {
            const PathHit hit = trace(ray, query);
            if (hit.slot < 0)
                return is_shape ? none : all;
            const bool there = is_shape && hit.shape == drawn.emitter && hit.t >= left;
            if (!there && !(FLAGS & HAS_TRANSPARENT))
                return none;
            PathSurface met;
            find_path_surface<Types, FLAGS>(scene, hub, world, ray, hit, rows, false, met);
            if (there)
                return met.alpha * met.material.emission;
            if (random.next().x < met.alpha)
                return none;
            left -= hit.t + met.margin;
            go_through(met, hit, ray, query);
        }
    }

    // Light from all around, with what lights give to it.
    WARPCAM_INLINED Vec3 sky(Vec3 direction) const
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

    // The part of the sky's light along a drawn direction that is not drawn as a light's.
    WARPCAM_INLINED float weight_of_sky(const Scattering& last, Vec3 direction) const
    {
        if (!(sky_cells().shines() && last.density > 0.0f))
            return 1.0f;
        return power_heuristic(last.density, sky_cells().density(direction) / float(num_lights()));
    }

    // The part of a met surface's own light that is not drawn as a light's.
    WARPCAM_INLINED float weight_of_met(const Scattering& last, const PathSurface& met, const PathHit& hit) const
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
    WARPCAM_INLINED Vec3 met_lamps(const Scattering& last, Vec3 direction, float far) const
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
