// Shapes that shine: places on them, drawn evenly, and the density with which they are drawn.
//
// Balls, boxes and meshes can be drawn. What else shines is met by chance, which is as right and takes more paths.
#pragma once
#include "path/lamps.h"
#include "path/trace_path.h"

namespace warpcam {

constexpr float SAME_PLACE = 1.0e-3f;  // part of a distance within which two places are one

WARPCAM_DEVICE float power_heuristic(float own, float other)
{
    return own * own / max(own * own + other * other, MIN_NORMAL);
}

// Whether a shape can be drawn as a light. Frame_::faces: rows of Meshes.faces by mesh, with where each mesh begins.
template <class Types, class Frame_, class Shapes, class Materials, class Physical>
WARPCAM_DEVICE bool is_emitter(const Frame_& frame, const Shapes& shapes, const Materials& materials,
                               const Physical& physical, int world, int id)
{
    const int material = material_of(shapes, materials, world, id);
    if (material < 0 || per_world(physical.reflectance, world, material) < 0.0f)
        return false;
    const Vec3 emission = as_vec3(per_world(physical.emissive, world, material));
    if (!(emission.x + emission.y + emission.z + per_world(materials.emission, world, material) > 0.0f))
        return false;
    const int type = wp::index(shapes.types, id), asset = per_world(shapes.assets, world, id);
    if (Types::has(MESH) && type == MESH)
        return asset >= 0 && asset + 1 < frame.face_starts.shape[0]
               && wp::index(frame.face_starts, asset + 1) > wp::index(frame.face_starts, asset);
    return type == SPHERE || type == BOX;
}

// A place on a shape, from the camera along the world's axes.
struct EmitterPlace {
    Vec3 point;
    Vec3 normal;  // unit
    float area;   // of which it is one, over the chance that it was this one [m^2]
};

struct EmitterTriangle {
    Vec3 origin, edge1, edge2;

    WARPCAM_DEVICE EmitterPlace place(float u, float v, float count) const
    {
        const float root = wp::sqrt(u);
        const Vec3 normal = cross(edge1, edge2);
        const float twice = wp::sqrt(dot(normal, normal));
        return { origin + (root * (1.0f - v)) * edge1 + (root * v) * edge2, 1.0f / max(twice, MIN_NORMAL) * normal,
                 0.5f * twice * count };
    }
};

template <class Types, class Meshes>
WARPCAM_DEVICE EmitterTriangle emitter_triangle(const Meshes& meshes, const Shape& shape, int face, Vec3 camera)
{
    const unsigned row = unsigned(wp::index(meshes.face_start, shape.asset)) + unsigned(FACE_ROWS * face);
    const auto corner = [&](int k) {
        const Vec3 own = as_vec3(load(meshes.faces.data, row + k));
        return transform(shape.rotation, Types::has(PER_SHAPE_SCALE) ? mul(own, shape.size) : own);
    };
    const Vec3 first = corner(0);
    return { first + shape.position - camera, corner(1) - first, corner(2) - first };
}

WARPCAM_DEVICE float box_area(Vec3 half) { return 8.0f * (half.x * half.y + half.y * half.z + half.z * half.x); }

WARPCAM_DEVICE EmitterPlace box_place(const Shape& shape, Vec3 camera, float choice, float u, float v)
{
    const Vec3 h = shape.size;
    const float area = box_area(h);
    float at = choice * area * 0.125f;
    int axis = 0;
    if (at >= h.y * h.z) {
        at -= h.y * h.z;
        axis = 1;
        if (at >= h.z * h.x) {
            at -= h.z * h.x;
            axis = 2;
        }
    }
    const float of = axis == 0 ? h.y * h.z : axis == 1 ? h.z * h.x : h.x * h.y, side = at < 0.5f * of ? -1.0f : 1.0f;
    const float a = 2.0f * u - 1.0f, b = 2.0f * v - 1.0f;
    const Vec3 unit = axis == 0 ? Vec3 { side, a, b } : axis == 1 ? Vec3 { b, side, a } : Vec3 { a, b, side };
    return { shape.position - camera + transform(shape.rotation, mul(unit, h)),
             transform(shape.rotation, axis_vector(axis, side)), area };
}

// A ball as a lamp of its size.
WARPCAM_DEVICE AreaLight ball_lamp(const Shape& shape, Vec3 camera)
{
    AreaLight lamp {};
    lamp.place = make_float3_int(shape.position - camera, 0);
    lamp.axis = { 0.0f, 0.0f, 1.0f, as_int(-2.0f) };
    lamp.across.w = FORM_SPHERE;
    lamp.size.x = shape.size.x;
    lamp.diffuse.w = SPOT;
    return lamp;
}

// Direction and distance from `from` to a place of the shape; `density`: of the direction [1/sr].
template <class Types, class Frame_, class Meshes>
WARPCAM_DEVICE LampSample draw_emitter(const Frame_& frame, const Meshes& meshes, const Shape& shape, Vec3 camera,
                                       Vec3 from, float choice, float u, float v)
{
    if (shape.type == SPHERE)
        return draw_lamp(ball_lamp(shape, camera), from, u, v);
    EmitterPlace place;
    if (Types::has(MESH) && shape.type == MESH) {
        const int start = wp::index(frame.face_starts, shape.asset);
        const int count = wp::index(frame.face_starts, shape.asset + 1) - start;
        const int face = wp::index(frame.faces, start + min(int(choice * float(count)), count - 1));
        place = emitter_triangle<Types>(meshes, shape, face, camera).place(u, v, float(count));
    } else {
        place = box_place(shape, camera, choice, u, v);
    }
    const Vec3 away = place.point - from;
    const float square = max(dot(away, away), 1.0e-20f), distance = wp::sqrt(square);
    const Vec3 direction = 1.0f / distance * away;
    const float cosine = abs(dot(direction, place.normal));
    const float density = square / max(cosine * place.area, MIN_NORMAL);
    return { direction, distance, cosine * place.area > 1.0e-20f ? 1.0f / density : 0.0f, density };
}

// The density with which it would have drawn the direction to a place that a ray met; `face` and `normal` are what is there.
template <class Types, class Frame_, class Meshes>
WARPCAM_DEVICE float emitter_density(const Frame_& frame, const Meshes& meshes, const Shape& shape, Vec3 camera,
                                     Vec3 from, Vec3 point, Vec3 normal, int face)
{
    const Vec3 away = point - from;
    const float square = dot(away, away);
    if (shape.type == SPHERE) {
        const Vec3 middle = shape.position - camera - from;
        const float far = dot(middle, middle), radius = shape.size.x * shape.size.x;
        return cap_density(far > radius ? cap_height(radius / far) : 2.0f);
    }
    float area = box_area(shape.size);
    if (Types::has(MESH) && shape.type == MESH) {
        const float count =
            float(wp::index(frame.face_starts, shape.asset + 1) - wp::index(frame.face_starts, shape.asset));
        area = emitter_triangle<Types>(meshes, shape, face, camera).place(0.0f, 0.0f, count).area;
    }
    const float cosine = abs(dot(away, normal)) / wp::sqrt(max(square, MIN_NORMAL));
    return square / max(cosine * area, MIN_NORMAL);
}

}  // namespace warpcam
